"""Conduction into a half-space (V01, V02): erf, and its integral for a flux."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.reference.semi_infinite import surface_flux, surface_step
from tests.bodies import bar, depth, on_top, single_body_scene


CONDUCTIVITY = 45.0
STEEL = jt.Material(conductivity=CONDUCTIVITY, density=7800.0, specific_heat=460.0)
START = 293.15
HELD = 373.15
HOT_END = jt.Side(normal=(-1.0, 0.0, 0.0))
"""All other sides carry no term: they are insulated."""


@pytest.fixture(scope="module")
def fine_bar():
    """15 cells a centimetre; 0.22 m long, eight diffusion lengths of V01 at 60 s."""
    return bar(330, 0.01 / 15)


@pytest.fixture(scope="module")
def prescribed():
    """V01 at 20.6 cells per diffusion length, x = 1 cm on a node."""
    grid = bar(165, 0.01 / 7.5)
    term = jt.FixedTemperature(HELD, on=HOT_END)
    scene = single_body_scene(grid, STEEL, START, term)
    return grid, jt.simulate(scene, 60.0)


def test_prescribed_surface_everywhere_within_a_thousandth_of_the_step(prescribed):
    grid, solution = prescribed
    temperature = np.asarray(solution.surface_temperature)[0, on_top(grid)]
    exact = surface_step(
        depth(grid), 60.0, initial=START, surface=HELD, diffusivity=STEEL.diffusivity
    )
    assert np.abs(temperature - exact).max() < 1e-3 * (HELD - START)


def test_prescribed_surface_at_one_centimetre(prescribed):
    grid, solution = prescribed
    node = on_top(grid)[7]
    assert depth(grid)[7] == pytest.approx(0.01)
    celsius = float(solution.surface_temperature[0, node]) - 273.15
    assert celsius == pytest.approx(83.726865, abs=0.08)


def _with_flux(grid, material, start, times):
    scene = single_body_scene(grid, material, start, jt.HeatFlux(3.2e5, on=HOT_END))
    solution = jt.simulate(scene, times[-1], save_at=times)
    return np.asarray(solution.surface_temperature)[:, on_top(grid)]


@pytest.fixture(scope="module")
def heated(fine_bar):
    return _with_flux(fine_bar, material=STEEL, start=START, times=[1.0, 10.0, 60.0])


def test_heated_first_node_is_at_half_a_cell(fine_bar, heated):
    exact = surface_flux(
        0.5 * fine_bar.pitch,
        np.array([1.0, 10.0, 60.0]),
        initial=START,
        heat_flux=3.2e5,
        conductivity=CONDUCTIVITY,
        diffusivity=STEEL.diffusivity,
    )
    assert np.abs(heated[:, 0] - exact).max() < 0.2


def test_heated_surface_half_a_cell_further_out(fine_bar, heated):
    half_cell = 3.2e5 * fine_bar.pitch / (2 * 45.0)
    surface = heated[:, 0] + half_cell - 273.15
    assert_allclose(surface, [48.416629, 109.86127, 240.11426], atol=0.2)


def test_holman_4_2(fine_bar):
    material = jt.Material(conductivity=45.0, density=8000.0, specific_heat=401.79)
    celsius = (
        _with_flux(fine_bar, material=material, start=273.15 + 35.0, times=[30.0])[
            0, 37
        ]
        - 273.15
    )
    assert depth(fine_bar)[37] == pytest.approx(0.025)
    assert celsius == pytest.approx(79.313554, abs=0.02)
