"""What runs of solids can do, with sheets: batches, copies, motion, errors, models."""

import functools
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.scene.compile.on_devices import _on_devices
from tests.bodies import body_at
from tests.sheet_bodies import BACK, plate


METAL = jt.Material(20.0, density=2700.0, specific_heat=900.0)
FOAM = jt.Material(0.04, density=30.0, specific_heat=1400.0)
WALL = (jt.Layer(METAL, 1e-3), jt.Layer(FOAM, 0.02))
WARM_HALF = jt.Face("front", body=0) & jt.Region((-0.1, -0.1, -0.1), (0.0, 0.1, 0.1))
TIMES = (0.0, 60.0, 300.0)
END = TIMES[-1]
STEPS = jt.ForwardEuler(dt=1.0)


@functools.cache
def panel_mesh():
    return plate(0.2, 0.1)


@functools.cache
def block_grid():
    return jt.voxelize(jt.shapes.box((0.06, 0.06, 0.02)), 0.01)


def panel(pitch=0.05, pose=None):
    sheet = jt.Sheet(panel_mesh(), WALL, pitch=pitch)
    return jt.Body(sheet, temperature=300.0, pose=pose or jt.Pose())


def scene(coefficient=10.0, conductance=300.0, pose=None):
    """A wall that is heated on half of its front, on a warm block."""
    terms = (
        jt.Convection(coefficient, 290.0),
        jt.HeatFlux(500.0, on=WARM_HALF),
        jt.Contact(conductance),
    )
    block = body_at(block_grid(), METAL, 310.0, at=(0.02, 0.0, -0.01))
    return jt.Scene((panel(pose=pose), block), terms, dtype="float64")


def surface(of_scene):
    return jt.simulate(of_scene, END, TIMES, solver=STEPS).surface_temperature


@pytest.mark.slow
def test_a_compiled_run_serves_other_numbers_batches_and_copies():
    run = jt.compile_simulation(scene(), END, TIMES, solver=STEPS)
    changed = run(scene(20.0, 100.0))
    assert changed.receipt.searches == ()
    assert_array_equal(changed.surface_temperature, surface(scene(20.0, 100.0)))
    copy = pickle.loads(pickle.dumps(scene()))
    assert_array_equal(surface(copy), run().surface_temperature)

    @jax.vmap
    def batch(coefficient):
        return run(scene(coefficient)).surface_temperature

    coefficients = (10.0, 20.0)
    rows = batch(jnp.array(coefficients))
    for row, coefficient in zip(rows, coefficients, strict=True):
        alone = run(scene(coefficient)).surface_temperature
        assert_allclose(row, alone, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_sheet_may_move_onto_a_solid():
    poses = [jt.Pose((0.0, 0.0, height)) for height in (0.3, 0.0, 0.0)]
    pose = jt.Motion(jt.PoseTable([0.0, END / 2, END], poses), every=30.0)
    apart = jt.simulate(scene(pose=jt.Pose((0.0, 0.0, 0.3))), END, TIMES)
    moved = jt.simulate(scene(pose=pose), END, TIMES)
    joined = jt.simulate(scene(), END, TIMES)
    assert np.abs(np.asarray(moved.energy.residual_relative)).max() < 1e-11
    exchanged = [
        abs(float(run.energy.contacts.get("contact 0-1", np.zeros(3))[-1]))
        for run in (apart, moved, joined)
    ]
    assert exchanged[0] == 0 < exchanged[1] < exchanged[2]


@pytest.mark.slow
def test_a_reduced_model_stands_for_a_wall_on_a_block():
    full = scene()
    model = jt.reduce(full, END, TIMES)
    warmer = jt.Scene(
        full.bodies,
        (
            jt.Convection(10.0, 280.0),
            jt.HeatFlux(800.0, on=WARM_HALF),
            full.terms[2],
        ),
        dtype="float64",
    )
    reduced = np.asarray(model.simulate(warmer).surface_temperature)
    expected = np.asarray(jt.simulate(warmer, END, TIMES).surface_temperature)
    assert_allclose(reduced, expected, atol=0.005 * np.ptp(expected[-1]))


def test_a_sheet_runs_on_one_device():
    with pytest.raises(jt.InputError, match="cannot be spread over devices=2") as error:
        _on_devices(panel(), where="bodies[0]", devices=2)
    line = str(error.value)
    assert line.startswith("bodies[0]: ") and "\n" not in line


def lone(pitch, flux=500.0, on=WARM_HALF):
    terms = (jt.Convection(10.0, 290.0), jt.HeatFlux(flux, on=on))
    return jt.Scene((panel(pitch),), terms, dtype="float64")


@pytest.mark.slow
def test_a_finer_sheet_is_the_reference_of_a_coarser_one():
    runs = [jt.simulate(lone(pitch), END, TIMES) for pitch in (0.00625, 0.0125, 0.025)]
    coarse, fine = (
        jt.truth_error(run, reference=runs[0]).worst_rms_kelvin
        for run in (runs[2], runs[1])
    )
    finest, middle, coarsest = runs
    estimate = jt.discretization_error(finest, middle, coarsest)
    assert 0 < 2 * fine < coarse
    assert ((estimate.order > 1.3) & (estimate.order < 3)).all()
    assert (estimate.rms_kelvin < fine).all()


def test_the_error_is_that_of_both_faces():
    """The fronts agree: the back of insulation warms before the front does."""
    runs = [
        jt.simulate(lone(0.05, flux, BACK), 20.0, [20.0], solver=STEPS)
        for flux in (0.0, 30.0)
    ]
    error = jt.truth_error(runs[1], reference=runs[0])
    difference = np.diff(
        [np.asarray(run.surface_temperature[0]) for run in runs], axis=0
    )
    front, back = np.split(difference[0], 2)
    assert back.min() > 100 * front.max()
    assert error.rms_kelvin[0] == pytest.approx(back.mean() / np.sqrt(2), rel=0.02)
    assert error.bias_kelvin[0] == pytest.approx(back.mean() / 2, rel=0.02)
