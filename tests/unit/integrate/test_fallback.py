"""Explicit first stages that go too far: the step is backward Euler's instead."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import blocks


AROUND = 300.0
HOT = 5800.0
COLD = 1e-3
SOLVERS = {"TRBDF2": jt.TRBDF2, "CrankNicolson": jt.CrankNicolson}
# Every one of these is a program of its own to compile.
SLOW = pytest.mark.slow


@functools.cache
def _structure():
    return jt.FullVolume(blocks(np.ones((2, 2, 2), bool), 1e-3))


def _cube(start, emissivity=1.0):
    metal = jt.Material(200.0, 2700.0, 900.0, emissivity=emissivity)
    body = jt.Body(_structure(), metal, temperature=start)
    around = (jt.Surroundings(AROUND),)
    return jt.Scene((body,), around, dtype="float64", allow_extreme_temperatures=True)


def _run(start, solver, end):
    return jt.simulate(_cube(start), end, solver=solver, throw=False)


@pytest.mark.parametrize(
    ("name", "start"),
    [
        pytest.param("TRBDF2", HOT, marks=SLOW),
        pytest.param("TRBDF2", COLD, marks=SLOW),
        ("CrankNicolson", HOT),
        pytest.param("CrankNicolson", COLD, marks=SLOW),
    ],
)
def test_steps_of_any_length_stay_between_start_and_surroundings(name, start):
    for dt in (1.0, 1e4, 1e12):
        run = _run(start, SOLVERS[name](dt=dt), dt)
        surface = np.asarray(run.surface_temperature)
        print(name, start, dt, surface.min(), surface.max(), run.result)
        assert run.result == jt.RESULTS.successful
        assert surface.min() >= min(start, AROUND) - 1e-9
        assert surface.max() <= max(start, AROUND) + 1e-9
        assert np.abs(run.energy.residual_relative).max() <= 1e-11
    assert float(run.mean_temperature[-1, 0]) == pytest.approx(AROUND, abs=1e-5)


@SLOW
@pytest.mark.parametrize(("name", "halves"), [("TRBDF2", 2), ("CrankNicolson", 1)])
def test_such_a_step_is_backward_eulers(name, halves):
    dt = 10.0
    run = _run(HOT, SOLVERS[name](dt=dt), dt)
    expected = _run(HOT, jt.BackwardEuler(dt=dt / halves), dt)
    np.testing.assert_allclose(
        run.surface_temperature, expected.surface_temperature, rtol=0, atol=1e-6
    )


@SLOW
@pytest.mark.parametrize("name", SOLVERS)
def test_short_steps_keep_their_order(name):
    """From 5800 K: tau = C / (4 eps sigma A T^3) is 0.02 s there."""
    end = 0.032

    def mean(n):
        return float(_run(HOT, SOLVERS[name](dt=end / n), end).mean_temperature[-1, 0])

    exact = (4 * mean(512) - mean(256)) / 3
    errors = np.abs(np.array([mean(n) for n in (16, 32, 64)]) - exact)
    orders = np.log2(errors[:-1] / errors[1:])
    print(name, errors, orders)
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


@SLOW
def test_the_derivative_through_such_a_step():
    def mean(emissivity):
        scene = _cube(HOT, emissivity)
        run = jt.simulate(scene, 1.0, solver=jt.TRBDF2(dt=1.0))
        return run.mean_temperature[-1, 0]

    at = jnp.asarray(0.8)
    step = 1e-5
    loss = jax.jit(mean)
    numeric = (loss(at + step) - loss(at - step)) / (2 * step)
    forward = jax.jit(jax.jacfwd(mean))(at)
    reverse = jax.jit(jax.grad(mean))(at)
    print(numeric, forward, reverse)
    assert abs(float(numeric)) > 100
    np.testing.assert_allclose([forward, reverse], numeric, rtol=1e-6)
