"""Functions of time as lines: their integrals, their knots, and what is not seen."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.physics.tabulated import Tabulated, tabulated


END = 3600.0


def gaussian(width: float, at: float = 1800.0):
    """Pulse of integral 1 about a time, of a standard deviation [s]."""
    height = 1 / (width * np.sqrt(2 * np.pi))
    return lambda time: height * jnp.exp(-0.5 * ((time - at) / width) ** 2)


def box(begin: float, end: float):
    """Value of 1 between two times [s]."""
    return lambda time: jnp.where((time > begin) & (time < end), 1.0, 0.0)


def lines(function, end: float = END, cuts=()) -> Tabulated:
    """Lines of a function that is known on the host."""
    result = tabulated(function, end, cuts, ends_steps=True)
    assert result is not None
    return result


def integral(result: Tabulated, begin: float, end: float) -> float:
    """Integral of the lines between two of their knots [s]."""
    knots = np.asarray(result.value.times).sum(axis=0)
    inside = (knots[:-1] >= begin) & (knots[1:] <= end)
    mean = (result.value.first + result.value.last) / 2
    return float((np.diff(knots) * mean)[inside].sum())


@pytest.mark.parametrize(
    ("function", "exact"),
    [
        (gaussian(0.1), 1.0),
        (gaussian(0.03), 1.0),
        (lambda time: 100.0 + gaussian(0.1)(time), 360_001.0),
        (box(1000.123, 1000.223), 0.1),
        (box(17.0, 3599.9), 3582.9),
        (lambda time: 1e3 * jnp.exp(-1e3 * time), 1.0),
        (
            lambda time: jnp.abs(jnp.sin(time / 20)),
            2300.0 - 20 * np.cos(180 - 57 * np.pi),
        ),
        (lambda time: 290.0 + time, END * 2090.0),
        (lambda time: 5.0 + 0 * time, 5 * END),
        (lambda time: 0 * time, 0.0),
    ],
)
def test_lines_have_the_integral_of_the_function(function, exact):
    result = lines(function)
    assert integral(result, 0.0, END) == pytest.approx(exact, rel=2e-7, abs=1e-12)
    assert result.is_resolved
    assert result.shifted <= 1e-3 * result.varying
    # A power of two, so that functions that differ little share a program.
    assert np.log2(len(result.value.first)) % 1 == 0


def test_the_integral_is_exact_at_every_cut():
    cuts = (1799.95, 1800.0, 1800.1)
    result = lines(gaussian(0.1), cuts=cuts)
    share = [0.5 * (1 + math.erf((cut - 1800.0) / 0.1 / math.sqrt(2))) for cut in cuts]
    for cut, exact in zip(cuts, share, strict=True):
        assert integral(result, 0.0, cut) == pytest.approx(exact, abs=1e-6)


def test_lines_stay_within_the_values_of_the_function():
    value = lines(gaussian(0.1)).value
    assert value.first.min() >= 0
    assert value.last.min() >= 0


def test_a_smooth_function_needs_few_knots():
    day = 86_400.0
    result = lines(lambda time: 5 * jnp.sin(2 * np.pi * time / day), 10 * day)
    knots = np.asarray(result.value.times).sum(axis=0)
    assert 300 < (knots < 10 * day).sum() < 600


def test_what_cannot_be_integrated_says_how_much_is_missed():
    result = lines(lambda time: jnp.sin(1e9 * time))
    assert not result.is_resolved
    assert 0.1 < result.unresolved / result.varying < 2


@pytest.mark.parametrize(
    "function",
    [
        lambda time: jnp.ones(3) * time,
        lambda time: 1.0 / (time - time),
        lambda time: 1.0 / jnp.where(time > 10.0, 0.0, 1.0),
    ],
)
def test_other_results_than_one_finite_number_are_left_to_the_run(function):
    assert tabulated(function, END, (), ends_steps=True) is None


def test_a_function_of_a_traced_number_is_left_to_the_run():
    def slope(height):
        result = tabulated(lambda time: height * time, END, (), ends_steps=True)
        assert result is None
        return height

    jax.grad(slope)(2.0)


def test_a_known_function_is_integrated_while_something_else_is_traced():
    def doubled(number):
        return number * integral(lines(gaussian(0.1)), 0.0, END)

    assert float(jax.jit(doubled)(2.0)) == pytest.approx(2.0)
