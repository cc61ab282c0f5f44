"""Emission as a linear law where the user allows it and the range is small enough."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import jaxthermo as jt
from jaxthermo.physics.flux_law import Forcing
from jaxthermo.physics.radiation.emission import _linear_error
from tests.bodies import single_body_scene


METAL = jt.Material(50.0, density=2000.0, specific_heat=500.0, emissivity=0.8)
GRID = jt.voxelize(jt.shapes.box((0.03, 0.03, 0.03)), 0.01)


def _run(start, within, t1=400.0):
    term = jt.Surroundings(300.0, linear_within=within)
    scene = single_body_scene(GRID, METAL, start, term)
    return jt.simulate(scene, t1, solver=jt.ForwardEuler())


def test_it_is_used_where_it_is_good_enough_and_off_by_no_more():
    exact = _run(310.0, None)
    linear = _run(310.0, 0.06)
    assert any("off by up to 4.9 %" in note for note in linear.receipt.notes)
    drop = [310.0 - float(run.mean_temperature[0, 0]) for run in (exact, linear)]
    assert drop[1] != drop[0]
    assert drop[1] == pytest.approx(drop[0], rel=0.06)


def test_it_is_not_used_where_it_is_not():
    exact = _run(400.0, None)
    asked = _run(400.0, 0.06)
    assert any("not used" in note for note in asked.receipt.notes)
    assert_array_equal(exact.mean_temperature, asked.mean_temperature)


def test_the_error_is_that_of_the_laws():
    for surroundings, low, high in ((300.0, 280.0, 330.0), (250.0, 250.0, 290.0)):
        t = np.array([low, high]) + 1e-9
        ratio = 4 * surroundings**3 * (surroundings - t) / (surroundings**4 - t**4)
        exact = np.abs(ratio - 1).max()
        reach = Forcing(highest=high, lowest=low)
        assert _linear_error(surroundings, reach, 1.0) == pytest.approx(exact, rel=1e-5)


def test_a_fraction_is_asked_for():
    with pytest.raises(jt.InputError, match="give a fraction"):
        jt.Surroundings(300.0, linear_within=2.0)
