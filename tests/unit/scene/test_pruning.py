"""A program without what does nothing is the program with it, to rounding."""

import functools

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.simulate import run_plan


PITCH = 0.01
MATERIALS = (
    jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8),
    jt.Material(0.3, density=1200.0, specific_heat=1500.0, emissivity=0.0),
)


@functools.cache
def _grid(size):
    return jt.voxelize(jt.shapes.box(tuple(n * PITCH for n in size)), PITCH)


def _bodies(chance):
    """One to three boxes in a row, which touch or stand apart."""
    bodies = []
    side = 0.0
    for _ in range(chance.integers(1, 4)):
        size = tuple(int(n) for n in chance.integers(2, 4, size=3))
        name = (jt.FullVolume, jt.SingleShell)[chance.integers(2)]
        middle = side + size[0] * PITCH / 2
        bodies.append(
            jt.Body(
                name(_grid(size)),
                MATERIALS[chance.integers(2)],
                temperature=float(chance.uniform(270.0, 330.0)),
                pose=jt.Pose(translation=(middle, 0.0, 0.0)),
            )
        )
        side += size[0] * PITCH + float(chance.choice([0.0, 3 * PITCH]))
    return tuple(bodies)


def _terms(chance, bodies):
    """Some of what there is, a good part of which does nothing."""
    last = len(bodies) - 1
    block = jt.Region((-0.01, -0.01, -0.01), (0.02, 0.02, 0.02))
    names = [
        jt.Sun((0.0, 0.0, -1.0), 500.0),
        jt.Sun((1.0, 0.0, 0.0), 500.0),
        jt.Sun((0.0, 1.0, 0.0), 0.0),
        jt.Convection(0.0, 300.0),
        jt.Convection(20.0, 280.0, on=jt.Side((0.0, 0.0, 1.0), body=last)),
        jt.Surroundings(290.0),
        jt.HeatFlux(0.0),
        jt.HeatFlux(200.0, on=jt.Side((0.0, 1.0, 0.0))),
        jt.FixedTemperature(310.0, on=jt.Side((0.0, 0.0, -1.0))),
        jt.Contact(500.0),
        jt.HeatSource(1e4, within=block),
    ]
    return tuple(name for name in names if chance.random() < 0.6)


def _agree(seed):
    chance = np.random.default_rng(seed)
    bodies = _bodies(chance)
    scene = jt.Scene(bodies, _terms(chance, bodies), dtype="float64")
    runs = [
        run_plan(plan_run(scene, 5.0, [2.0, 5.0], jt.ForwardEuler(dt=0.25), prune))
        for prune in (True, False)
    ]
    lean, full = runs
    np.testing.assert_allclose(
        lean.surface_temperature, full.surface_temperature, rtol=1e-12
    )
    np.testing.assert_allclose(
        lean.energy.stored_J, full.energy.stored_J, rtol=1e-9, atol=1e-9
    )
    assert set(lean.receipt.included) <= set(full.receipt.included)
    return len(full.receipt.left_out), len(lean.receipt.left_out)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_three_random_scenes(seed):
    _agree(seed)


@pytest.mark.slow
def test_twenty_random_scenes():
    left_out = np.array([_agree(seed) for seed in range(20)])
    # What is told to be left out is, and it is more than in the full program.
    assert (left_out[:, 1] > left_out[:, 0]).all()
