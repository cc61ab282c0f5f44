"""Discrete eigenmodes (V09): explicit Euler shrinks each by 1 - lambda dt a step."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.reference.slab import decay_explicit_euler, sine_rate_of_cells
from tests.bodies import bar, depth, on_top, single_body_scene


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
    scene = single_body_scene(
        rod, MATERIAL, lambda points: 300.0 + shape(points[:, 0] + LENGTH / 2), *terms
    )
    solution = jt.simulate(scene, 50.0, solver=jt.ForwardEuler(dt=0.5))
    return np.asarray(solution.surface_temperature)[0, on_top(rod)] - 300.0


def test_rate_of_twenty_cells():
    rate = sine_rate_of_cells(MATERIAL.diffusivity, LENGTH, CELLS)
    assert rate == pytest.approx(0.009849327523889818, rel=1e-13)


@pytest.mark.parametrize(
    ("wave", "mode", "terms"),
    [(np.sin, 1, BOTH_ENDS), (np.sin, 3, BOTH_ENDS), (np.cos, 1, ()), (np.cos, 4, ())],
    ids=["held, 1", "held, 3", "insulated, 1", "insulated, 4"],
)
def test_modes_of_held_and_insulated_ends_decay_as_cells_say(rod, wave, mode, terms):
    """Sine between faces held through half a cell, cosine in an insulated bar."""
    temperature = _run(rod, lambda x: wave(mode * np.pi * x / LENGTH), terms)
    rate = sine_rate_of_cells(
        MATERIAL.diffusivity, length=LENGTH, cells=CELLS, mode=mode
    )
    left = decay_explicit_euler(rate, 0.5, 100)
    exact = left * wave(mode * np.pi * depth(rod) / LENGTH)
    error = np.abs(temperature - exact).max()
    assert error < 1e-10 * left


def test_first_sine_mode_has_the_listed_amplitude(rod):
    temperature = _run(rod, lambda x: np.sin(np.pi * x / LENGTH), BOTH_ENDS)
    amplitude = temperature / np.sin(np.pi * depth(rod) / LENGTH)
    assert_allclose(amplitude, 0.61037425, atol=5e-9)
