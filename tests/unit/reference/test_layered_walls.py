"""Closed forms of walls, ground and rooms against fine differences and limits."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from jaxthermo.reference.radiation import between_plates
from jaxthermo.reference.semi_infinite import surface_convection
from jaxthermo.reference.slab import slab_convection
from tests import wall_forms
from tests.wall_forms import Air, WallLayer


BRICK = WallLayer(0.2, conductivity=0.8, capacity=1.4e6)
FOAM = WallLayer(0.05, conductivity=0.035, capacity=4e4)
STEEL = WallLayer(0.01, conductivity=50.0, capacity=3.6e6)
INSIDE = Air(293.15, 8.0)
OUTSIDE = Air(263.15, 25.0)


def cells_of(layers, count):
    """Middles, resistances of halves and capacities of cells, `count` a layer."""
    thickness = np.concatenate([[w.thickness / count] * count for w in layers])
    conductivity = np.repeat([w.conductivity for w in layers], count)
    capacity = np.repeat([w.capacity for w in layers], count) * thickness
    edges = np.concatenate([[0.0], np.cumsum(thickness)])
    return (edges[1:] + edges[:-1]) / 2, thickness / conductivity / 2, capacity


def by_differences(layers, time, initial, first, second, count=60):
    """Temperatures of cells, exact in time by the matrix exponential."""
    position, half, capacity = cells_of(layers, count)
    link = 1 / (half[1:] + half[:-1])
    to_first = 1 / (1 / first.heat_transfer_coefficient + half[0])
    to_second = 1 / (1 / second.heat_transfer_coefficient + half[-1])
    matrix = np.diag(np.r_[to_first, link] + np.r_[link, to_second])
    matrix -= np.diag(link, 1) + np.diag(link, -1)
    load = np.zeros(len(position))
    load[0] += to_first * first.temperature
    load[-1] += to_second * second.temperature
    steady = np.linalg.solve(matrix, load)
    decay = expm(-matrix / capacity[:, None] * time)
    return position, steady + decay @ (initial - steady)


@pytest.mark.parametrize("layers", [(BRICK, FOAM), (FOAM, BRICK), (STEEL, FOAM, BRICK)])
@pytest.mark.parametrize("time", [600.0, 7200.0, 86400.0])
def test_layered_wall_agrees_with_differences(layers, time):
    load = {"initial": 293.15, "first": INSIDE, "second": OUTSIDE}
    position, cells = by_differences(layers, time, **load)
    exact = wall_forms.layered_wall(position, time, layers=layers, **load)
    assert np.ptp(exact) > 1
    assert_allclose(cells, exact, atol=0.02)


def test_layered_wall_of_one_material_is_a_slab():
    position = np.linspace(-0.2, 0.2, 9)
    air = Air(300.0, 8.0)
    temperature = wall_forms.layered_wall(
        position + 0.2,
        20000.0,
        initial=310.0,
        first=air,
        layers=(BRICK, BRICK._replace(thickness=0.15), BRICK._replace(thickness=0.05)),
        second=air,
    )
    fourier = 0.8 / 1.4e6 * 20000.0 / 0.2**2
    exact = slab_convection(position / 0.2, fourier, 8.0 * 0.2 / 0.8)
    assert_allclose(temperature, 300.0 + 10.0 * exact, rtol=0, atol=1e-10)


def test_thick_wall_is_a_half_space_at_first():
    depth = np.array([0.0, 0.01, 0.03])
    temperature = wall_forms.layered_wall(
        depth,
        1500.0,
        initial=293.15,
        first=OUTSIDE,
        layers=(BRICK, FOAM),
        second=Air(293.15, 0.0),
    )
    exact = surface_convection(
        depth,
        1500.0,
        initial=293.15,
        ambient=OUTSIDE.temperature,
        heat_transfer_coefficient=25.0,
        conductivity=0.8,
        diffusivity=0.8 / 1.4e6,
    )
    assert_allclose(temperature, exact, atol=1e-6)


def test_every_eigenvalue_of_a_wall_is_there():
    layers = (STEEL, FOAM, BRICK)
    # The series gives the initial state near t = 0 only if no term is missing.
    position = np.linspace(0.001, 0.259, 40)
    temperature = wall_forms.layered_wall(
        position,
        20.0,
        initial=293.15,
        first=Air(263.15, 8.0),
        layers=layers,
        second=Air(293.15, 8.0),
    )
    middle = (position > 0.03) & (position < 0.2)
    assert_allclose(temperature[middle], 293.15, atol=1e-6)


def test_steady_flow_through_a_wall():
    pane = (WallLayer(0.004, conductivity=1.0, capacity=2e6),)
    flow = wall_forms.through_wall(INSIDE, pane, OUTSIDE)
    assert flow.transmittance == pytest.approx(1 / (1 / 8 + 0.004 + 1 / 25))
    assert flow.heat_flux == pytest.approx(30 * flow.transmittance)
    drop = flow.first_surface - flow.second_surface
    assert drop == pytest.approx(flow.heat_flux * 0.004)
    at_end = wall_forms.layered_wall(
        np.array([0.0, 0.004]),
        1e6,
        initial=280.0,
        first=INSIDE,
        layers=pane,
        second=OUTSIDE,
    )
    assert_allclose(at_end, [flow.first_surface, flow.second_surface], rtol=1e-12)


def soil_wave(depth, **options):
    """Response of soil to the day."""
    return wall_forms.periodic_ground(
        depth, period=86400.0, conductivity=1.2, capacity=2e6, **options
    )


def test_deep_ground_carries_a_damped_wave():
    x = np.array([0.0, 0.1, 0.3])
    wave = soil_wave(x)
    depth = np.sqrt(1.2 / 2e6 * 86400 / np.pi)
    assert_allclose(wave, np.exp(-(1 + 1j) * x / depth), rtol=1e-12)
    for is_held in (False, True):
        limit = soil_wave(x, thickness=20.0, is_held_below=is_held)
        assert_allclose(limit, wave, rtol=1e-12)


@pytest.mark.parametrize("is_held", [False, True])
@pytest.mark.parametrize("coefficient", [np.inf, 12.0])
def test_shallow_ground_agrees_with_differences(is_held, coefficient):
    layer = WallLayer(0.3, conductivity=1.2, capacity=2e6)
    position, half, capacity = cells_of((layer,), 600)
    link = 1 / (half[1:] + half[:-1])
    above = 1 / (1 / coefficient + half[0])
    below = 1 / half[-1] if is_held else 0.0
    matrix = np.diag(np.r_[above, link] + np.r_[link, below]).astype(complex)
    matrix -= np.diag(link, 1) + np.diag(link, -1)
    matrix += np.diag(2j * np.pi / 86400 * capacity)
    load = np.zeros(len(position), complex)
    load[0] = above
    exact = soil_wave(
        position,
        thickness=0.3,
        is_held_below=is_held,
        heat_transfer_coefficient=coefficient,
    )
    assert_allclose(np.linalg.solve(matrix, load), exact, atol=1e-5)


def test_room_agrees_with_the_matrix_exponential():
    rates = np.array([[-(3.0 + 2.0) / 500.0, 2.0 / 500.0], [2.0 / 80.0, -2.5 / 80.0]])
    steady = np.linalg.solve(rates, [-40.0 / 500.0, 0.0])
    time = np.array([0.0, 30.0, 300.0])
    room = wall_forms.room_of_air(
        time,
        initial_wall=300.0,
        initial_air=290.0,
        outside=280.0,
        wall_capacity=500.0,
        air_capacity=80.0,
        outer_conductance=3.0,
        inner_conductance=2.0,
        ventilation=0.5,
        heat_rate=40.0,
    )
    for number, moment in enumerate(time):
        excess = steady + expm(rates * moment) @ (np.array([20.0, 10.0]) - steady)
        assert room.wall[number] == pytest.approx(280 + excess[0], rel=1e-12)
        assert room.air[number] == pytest.approx(280 + excess[1], rel=1e-12)
    assert_allclose(
        np.sort(1 / room.time_constants), np.sort(-np.linalg.eigvals(rates)), rtol=1e-12
    )
    assert room.time_constants[0] > room.time_constants[1]


def test_shield_halves_the_radiation_between_plates():
    bare = between_plates(600.0, 300.0, 0.8, 0.8)
    shielded = wall_forms.between_shielded_plates(
        600.0,
        300.0,
        emissivity_hot=0.8,
        emissivity_cold=0.8,
        emissivity_to_hot=0.8,
        emissivity_to_cold=0.8,
    )
    assert shielded.heat_flux == pytest.approx(bare / 2)
    assert shielded.shield**4 == pytest.approx((600.0**4 + 300.0**4) / 2)


def test_shield_is_where_both_gaps_pass_the_same_flux():
    shielded = wall_forms.between_shielded_plates(
        600.0,
        300.0,
        emissivity_hot=0.9,
        emissivity_cold=0.5,
        emissivity_to_hot=0.1,
        emissivity_to_cold=0.3,
    )
    warm = between_plates(600.0, shielded.shield, 0.9, 0.1)
    cool = between_plates(shielded.shield, 300.0, 0.3, 0.5)
    assert warm == pytest.approx(shielded.heat_flux)
    assert cool == pytest.approx(shielded.heat_flux)
