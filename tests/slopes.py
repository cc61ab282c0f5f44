"""Gradients of functions of a few numbers against central differences."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose


def check_gradient(
    function: Callable[[Any], Any], at: Any, step: Any, **tolerance: Any
) -> Callable[[Any], Any]:
    """The program of values and gradients, once its gradient is that of differences.

    Args:
        function: from a number, or an array of numbers, to a number.
        at: where it is differentiated.
        step: half of the difference by each number.
        tolerance: as of `assert_allclose`.
    """
    value_and_gradient = jax.jit(jax.value_and_grad(function))
    point = np.asarray(at, float)
    steps = np.broadcast_to(step, point.shape).reshape(-1)
    differences = []
    for size, move in zip(steps, np.diag(steps), strict=True):
        change = move.reshape(point.shape)
        above, _ = value_and_gradient(jnp.asarray(point + change))
        below, _ = value_and_gradient(jnp.asarray(point - change))
        differences.append(float(above - below) / (2 * size))
    _, gradient = value_and_gradient(jnp.asarray(point))
    assert_allclose(np.ravel(gradient), differences, **tolerance)
    return value_and_gradient
