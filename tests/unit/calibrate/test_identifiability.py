"""Verdicts: what is planted is found, whatever the scale; errors are the textbook's."""

import numpy as np
import pytest

from calibrate.analysis.identifiability import identify, information_gain
from calibrate.problem.parameters import Parameter, ParameterSet


def _set(count, lower=0.01, upper=100.0):
    names = [f"weights.p{n}" for n in range(count)]
    return ParameterSet(
        tuple(Parameter(name=n, start=(1.0,), lower=lower, upper=upper) for n in names)
    )


def _judge(rows, z=None, sd=0.01, **bounds):
    z = np.zeros(len(rows)) if z is None else z
    return identify(_set(len(rows), **bounds), z=z, jacobian=rows, sd=sd)


def _rows(seed, count, size=400):
    return np.random.default_rng(seed).normal(size=(count, size))


@pytest.mark.parametrize("seed", range(20))
def test_a_planted_dead_parameter_is_always_called_dead(seed):
    rng = np.random.default_rng(seed)
    rows = _rows(seed, 4) * rng.uniform(0.1, 10, size=(4, 1))
    dead = int(rng.integers(4))
    rows[dead] *= 1e-9
    verdicts = _judge(rows).verdicts
    assert [v.verdict for v in verdicts].count("dead") == 1
    assert verdicts[dead].verdict == "dead"
    assert verdicts[dead].standard_error is None


@pytest.mark.parametrize("seed", range(20))
def test_a_planted_flat_direction_is_always_called_flat(seed):
    """One row is the sum of two others, but for 1e-5: the three are one direction."""
    rows = _rows(seed, 4)
    rows[3] = rows[0] + rows[1] + 1e-5 * _rows(seed + 99, 1)[0]
    verdicts = _judge(rows).verdicts
    assert [v.verdict for v in verdicts] == ["flat", "flat", "fine", "flat"]
    assert set(verdicts[0].with_others) == {"weights.p1", "weights.p3"}


def test_a_trade_off_names_both():
    rows = _rows(0, 3)
    rows[2] = rows[0] + 0.05 * rows[2]
    verdicts = _judge(rows).verdicts
    assert [v.verdict for v in verdicts] == ["trade-off", "fine", "trade-off"]
    assert verdicts[0].with_others == ("weights.p2",)


def test_what_is_hardly_seen_is_not_pinned():
    rows = _rows(0, 2)
    rows[1] *= 1e-4
    verdicts = _judge(rows, sd=0.1).verdicts
    assert [v.verdict for v in verdicts] == ["fine", "not pinned"]


def test_what_ends_at_a_bound_is_told():
    judged = _judge(_rows(0, 2), z=np.array([40.0, 0.0]))
    assert [v.verdict for v in judged.verdicts] == ["at bound", "fine"]


def test_standard_errors_are_those_of_linear_least_squares():
    """Of y = a x with noise s: s / sqrt(sum x^2), times how the value goes with z."""
    rows = _rows(1, 1)
    verdict = _judge(rows, sd=0.3, lower=-np.inf, upper=np.inf).verdicts[0]
    assert verdict.standard_error == pytest.approx(0.3 / np.linalg.norm(rows))


def test_a_run_that_sees_more_gains_more():
    have = _rows(0, 2)
    have[1] *= 1e-3
    blind = _rows(5, 2)
    seeing = _rows(6, 2)
    blind[1] = 0.0
    gains = [information_gain(have, further) for further in (blind, seeing)]
    assert 0 < gains[0] < gains[1]
    assert information_gain(have, np.zeros((2, 5))) == pytest.approx(0.0)
