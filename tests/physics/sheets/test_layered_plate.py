"""A wall of two layers after a step of the air, a pane, and soil over a day."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from tests.sheet_bodies import BACK, FRONT, plate
from tests.wall_forms import (
    Air,
    WallLayer,
    layered_wall,
    periodic_ground,
    through_wall,
)


def material_of(layer):
    """Material of a layer of the closed form, with a density of 1000 kg/m^3."""
    return jt.Material(
        layer.conductivity, density=1000.0, specific_heat=layer.capacity / 1000.0
    )


def stack_of(layers):
    """Layers of a sheet."""
    return tuple(jt.Layer(material_of(layer), layer.thickness) for layer in layers)


def faces_of(sheet, temperature):
    """Mean surface temperature of the front and of the back, time by time [K]."""
    face = np.asarray(sheet.grid.fragment_face)
    values = np.asarray(temperature, float)
    return values[:, face == 0].mean(axis=1), values[:, face == 1].mean(axis=1)


BRICK = WallLayer(0.10, conductivity=0.8, capacity=1.4e6)
WOOD = WallLayer(0.03, conductivity=0.15, capacity=1.0e6)
INSIDE = Air(293.15, 8.0)
OUTSIDE = Air(263.15, 25.0)


@pytest.mark.parametrize(
    "layers", [(BRICK, WOOD), pytest.param((WOOD, BRICK), marks=pytest.mark.slow)]
)
def test_two_layers_follow_their_series_after_a_step_of_the_air(layers):
    # Denser cells at the faces than by default: a step has no shortest time.
    sheet = jt.Sheet(plate(0.4, 0.4), stack_of(layers), pitch=0.2, cells=24)
    terms = (
        jt.Convection(INSIDE.heat_transfer_coefficient, INSIDE.temperature, on=FRONT),
        jt.Convection(OUTSIDE.heat_transfer_coefficient, OUTSIDE.temperature, on=BACK),
    )
    scene = jt.Scene((jt.Body(sheet, temperature=293.15),), terms, dtype="float64")
    times = np.array([60.0, 300.0, 1800.0, 7200.0, 28800.0, 172800.0])
    solution = jt.simulate(scene, times[-1], save_at=list(times))
    front, back = faces_of(sheet, solution.surface_temperature)
    ends = np.array([0.0, sum(layer.thickness for layer in layers)])
    exact = np.array(
        [
            layered_wall(
                ends, t, initial=293.15, first=INSIDE, layers=layers, second=OUTSIDE
            )
            for t in times
        ]
    )
    scale = np.ptp(exact)
    assert scale > 20
    assert np.abs(front - exact[:, 0]).max() < 0.01 * scale
    assert np.abs(back - exact[:, 1]).max() < 0.01 * scale


def test_pane_between_two_airs_has_its_u_value_and_surface_temperatures():
    pane = WallLayer(0.004, conductivity=1.0, capacity=2.0e6)
    sheet = jt.Sheet(plate(0.5, 0.4), stack_of((pane,)), pitch=0.1)
    terms = (
        jt.Convection(INSIDE.heat_transfer_coefficient, INSIDE.temperature, on=FRONT),
        jt.Convection(OUTSIDE.heat_transfer_coefficient, OUTSIDE.temperature, on=BACK),
    )
    scene = jt.Scene((jt.Body(sheet, temperature=280.0),), terms, dtype="float64")
    solution = jt.steady(scene)
    exact = through_wall(INSIDE, (pane,), OUTSIDE)
    front, back = faces_of(sheet, solution.surface_temperature)
    assert_allclose(front, exact.first_surface, atol=1e-6)
    assert_allclose(back, exact.second_surface, atol=1e-6)
    gain = INSIDE.heat_transfer_coefficient * (INSIDE.temperature - front) * 0.2
    assert_allclose(gain, exact.heat_flux * 0.2, rtol=1e-6)


SOIL = WallLayer(1.0, conductivity=1.2, capacity=2.0e6)
DAY = 86400.0


def day_wave(time):
    """Temperature of the surface of the ground [K]."""
    return 288.15 + 10.0 * np.sin(2 * np.pi * time / DAY)


@pytest.mark.parametrize(
    "is_held_below", [False, pytest.param(True, marks=pytest.mark.slow)]
)
def test_day_wave_goes_into_soil(is_held_below):
    thickness = 1.0 if is_held_below else 0.2
    sheet = jt.Sheet(
        plate(0.4, 0.4), (jt.Layer(material_of(SOIL), thickness),), pitch=0.4
    )
    times = np.linspace(0.0, 12 * DAY, 12 * 48 + 1)
    air = jt.Table(times, day_wave(times))
    warm = jt.Convection(15.0, air, on=FRONT)
    held = jt.FixedTemperature(288.15, on=BACK)
    scene = jt.Scene(
        (jt.Body(sheet, temperature=288.15),),
        (warm, held) if is_held_below else (warm,),
        dtype="float64",
    )
    # The last day: the start is forgotten.
    saved = 11 * DAY + np.arange(0.0, 24.0) * 3600.0
    solution = jt.simulate(scene, saved[-1], save_at=list(saved))
    front, back = faces_of(sheet, solution.surface_temperature)
    angle = 2 * np.pi * saved / DAY
    wave = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    for face, depth in ((front, 0.0), (back, thickness)):
        response = periodic_ground(
            depth,
            period=DAY,
            conductivity=SOIL.conductivity,
            capacity=SOIL.capacity,
            thickness=thickness,
            is_held_below=is_held_below,
            heat_transfer_coefficient=15.0,
        )
        real, imaginary = np.linalg.lstsq(wave, face - 288.15, rcond=None)[0]
        assert abs(complex(real, imaginary) - 10.0 * complex(response)) < 0.01 * 10.0
