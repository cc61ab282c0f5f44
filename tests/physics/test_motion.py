"""Bodies and sources that move: contact begins when they meet, shadows travel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.scene.motion import Motion, PoseTable
from tests.bodies import body_at, single_body_scene


METAL = jt.Material(200.0, density=2000.0, specific_heat=500.0, emissivity=0.5)
GRID = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
SAVES = [5.0, 10.0, 20.0]


def _approaching(arrival):
    """A hot cube that stands 4 cm off and meets a cold one at the given time [s]."""
    far = jt.Pose((0.08, 0.0, 0.0))
    near = jt.Pose((0.04, 0.0, 0.0))
    path = PoseTable((0.0, arrival - 1e-6, arrival), (far, far, near))
    still = jt.Body(jt.FullVolume(GRID), METAL, temperature=300.0)
    moving = jt.Body(jt.FullVolume(GRID), METAL, temperature=400.0, pose=Motion(path))
    return jt.Scene((still, moving), (jt.Contact(500.0),), dtype="float64")


@pytest.fixture(scope="module")
def scene():
    return _approaching(10.0)


@pytest.fixture(scope="module")
def solution(scene):
    return jt.simulate(scene, 20.0, SAVES, solver=jt.ForwardEuler())


def test_heat_flows_from_when_they_meet(scene, solution):
    swapped = np.asarray(solution.energy.contacts["contact 0-1"])
    assert_array_equal(swapped[:2], 0.0)
    assert swapped[2] < -1.0
    assert solution.receipt.snapshots == 3
    # From then on it is the run of two that touch from the start.
    bodies = (scene.bodies[0], body_at(GRID, METAL, 400.0, at=(0.04, 0.0, 0.0)))
    touching = jt.Scene(bodies, scene.terms, dtype="float64")
    alone = jt.simulate(touching, 10.0, solver=jt.ForwardEuler())
    assert_allclose(solution.mean_temperature[2], alone.mean_temperature[0], rtol=1e-9)
    assert np.abs(solution.energy.residual_relative).max() < 1e-12


def test_segments_follow_the_motion(scene, solution):
    todo = plan_run(scene, t1=20.0, save_at=SAVES, solver=jt.ForwardEuler())
    *_, progress = run_segments(todo, begin_run(todo))
    surface = finish_run(todo, progress).surface_temperature
    assert_array_equal(surface, solution.surface_temperature)


@pytest.mark.slow
def test_a_sun_that_travels_brings_what_the_angles_say():
    """From noon to the horizon at a constant rate, on a plate that faces up."""
    half_day = 60.0

    def direction(time):
        angle = time / half_day * np.pi / 2
        return (float(np.sin(angle)), 0.0, -float(np.cos(angle)))

    plate = jt.voxelize(jt.shapes.box((0.06, 0.06, 0.01)), 0.01)
    only_top = single_body_scene(plate, METAL, 300.0, jt.Sun(direction, 1000.0))
    heat = jt.simulate(only_top, half_day, [half_day]).energy.mechanisms["sun"][0]
    # The top takes the cosine, the four edges' lit one the sine.
    area = 0.06 * 0.06
    edge = 0.06 * 0.01
    exact = 0.5 * 1000.0 * half_day * 2 / np.pi * (area + edge)
    assert float(heat) == pytest.approx(exact, rel=2e-4)
