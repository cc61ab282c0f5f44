"""Exact steps of modes: against quadrature, at jumps, from slow to fast modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.reduction.modal_run import (
    doubled,
    host_run,
    is_left,
    schedule,
    step_weights,
    traced_run,
)


@pytest.mark.parametrize("rate", [0.0, 1e-9, 0.2999, 0.3001, 3.0, 500.0])
def test_weights_are_the_integrals_of_a_decay(rate):
    step = 0.7
    s, w = np.polynomial.legendre.leggauss(60)
    # In parts, for the fast mode's layer at the end of the step.
    edges = step * (1 - np.concatenate([np.geomspace(1, 1e-4, 30), [0.0]]))
    decay = lambda s: np.exp(-rate * (step - s))
    of_start = of_change = 0.0
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        at = a + (b - a) * (s + 1) / 2
        of_start += (w * decay(at)).sum() * (b - a) / 2
        of_change += (w * decay(at) * at / step).sum() * (b - a) / 2
    actual = step_weights(np, np.array([rate]), step)
    expected = np.exp(-rate * step), of_start, of_change
    assert np.ravel(actual) == pytest.approx(expected, rel=1e-11)


def test_weights_have_a_slope_on_both_sides_of_the_series():
    def total(h):
        return sum(weights.sum() for weights in step_weights(jnp, h, 0.5))

    slopes = jax.jit(jax.value_and_grad(total))
    for at in (0.0, 0.59, 0.61, 4.0):
        h = np.array([at])
        small = 1e-6
        slope = slopes(h)[1][0]
        difference = (slopes(h + small)[0] - slopes(h - small)[0]) / (2 * small)
        assert float(slope) == pytest.approx(float(difference), rel=1e-8, abs=1e-9)


def test_knots_that_are_given_twice_are_jumps():
    knots = doubled((0.0, 1.0, 3.0))
    assert knots == (0.0, 1.0, 1.0, 3.0)
    assert is_left(np.array(knots)).tolist() == [False, True, False, True]
    plan = schedule(knots, [0.0, 0.5, 1.0, 2.0])
    assert plan.step.tolist() == [0.5, 0.5, 1.0, 1.0]
    # 0 is the start; the others are the ends of steps, before the jump.
    assert plan.saved.tolist() == [-1, 0, 1, 2]
    u0, u1 = plan.loads(np, np.array([[1.0], [2.0], [5.0], [5.0]]))
    assert u0[:, 0].tolist() == [1.0, 1.5, 5.0, 5.0]
    assert u1[:, 0].tolist() == [1.5, 2.0, 5.0, 5.0]


def test_host_and_traced_runs_agree():
    rng = np.random.default_rng(0)
    rates = np.array([0.01, 0.5, 40.0])
    drive = rng.normal(size=(3, 2))
    start = rng.normal(size=3)
    knots = doubled((0.0, 1.0, 1.5, 4.0))
    amplitudes = rng.normal(size=(len(knots), 2))
    plan = schedule(knots, [0.0, 1.0, 2.0, 4.0])
    states = host_run(rates, drive, start, plan, amplitudes)
    run = jax.jit(lambda a, b, c, rows: traced_run(a, b, c, plan, rows))
    actual, loads = map(np.asarray, run(rates, drive, start, amplitudes))
    assert actual[0] == pytest.approx(start)
    assert actual[1:] == pytest.approx(states[plan.saved[1:]])
    # No load has acted at the start, and the one before a jump at its time.
    assert loads[0].tolist() == [0.0, 0.0]
    assert loads[1] == pytest.approx(amplitudes[1])


@pytest.mark.parametrize(
    ("knots", "times"),
    [((1.0, 2.0), [1.5]), ((0.0, 2.0, 1.0), [1.0]), ((0.0, 2.0), [3.0]), ((), [])],
)
def test_times_out_of_order_are_refused(knots, times):
    with pytest.raises(InputError, match="reduced model: "):
        schedule(knots, times)
