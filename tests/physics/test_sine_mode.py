"""Discrete eigenmodes (V09): explicit Euler shrinks each by 1 - lambda dt a step."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.reference.slab import decay_explicit_euler, sine_rate_of_cells
from tests.bodies import bar, depth, on_top


LENGTH = 0.1
CELLS = 20
MATERIAL = jt.Material(conductivity=10.0, density=1000.0, specific_heat=1000.0)
BOTH_ENDS = tuple(
    jt.FixedTemperature(300.0, on=jt.Side((side, 0.0, 0.0))) for side in (-1.0, 1.0)
)


@pytest.fixture(scope="module")
def rod():
    return bar(CELLS, LENGTH / CELLS)


def _run(rod, shape, terms):
    body = jt.Body(
        jt.FullVolume(rod),
        MATERIAL,
        temperature=lambda points: 300.0 + shape(points[:, 0] + LENGTH / 2),
    )
    scene = jt.Scene((body,), terms, dtype="float64")
    solution = jt.simulate(scene, 50.0, solver=jt.ForwardEuler(dt=0.5))
    return np.asarray(solution.surface_temperature)[0, on_top(rod)] - 300.0


def test_rate_of_twenty_cells():
    rate = sine_rate_of_cells(MATERIAL.diffusivity, LENGTH, CELLS)
    assert rate == pytest.approx(0.009849327523889818, rel=1e-13)


@pytest.mark.parametrize("mode", [1, 3])
def test_sine_between_faces_held_through_half_a_cell(rod, mode):
    temperature = _run(rod, lambda x: np.sin(mode * np.pi * x / LENGTH), BOTH_ENDS)
    rate = sine_rate_of_cells(
        MATERIAL.diffusivity, length=LENGTH, cells=CELLS, mode=mode
    )
    left = decay_explicit_euler(rate, 0.5, 100)
    exact = left * np.sin(mode * np.pi * depth(rod) / LENGTH)
    error = np.abs(temperature - exact).max()
    print(f"V09 sine mode {mode}: left {left:.8f}, error {error}")
    assert error < 1e-10 * left


def test_first_sine_mode_has_the_listed_amplitude(rod):
    temperature = _run(rod, lambda x: np.sin(np.pi * x / LENGTH), BOTH_ENDS)
    amplitude = temperature / np.sin(np.pi * depth(rod) / LENGTH)
    np.testing.assert_allclose(amplitude, 0.61037425, atol=5e-9)


@pytest.mark.parametrize("mode", [1, 4])
def test_cosine_in_an_insulated_bar(rod, mode):
    temperature = _run(rod, lambda x: np.cos(mode * np.pi * x / LENGTH), ())
    rate = sine_rate_of_cells(
        MATERIAL.diffusivity, length=LENGTH, cells=CELLS, mode=mode
    )
    left = decay_explicit_euler(rate, 0.5, 100)
    exact = left * np.cos(mode * np.pi * depth(rod) / LENGTH)
    print(f"V09 cosine mode {mode}: error {np.abs(temperature - exact).max()}")
    assert np.abs(temperature - exact).max() < 1e-10 * left
