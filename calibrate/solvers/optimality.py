"""Test of the gradient: how far a point is from the minimum of the squares.

With residuals r and their Jacobian J a Gauss-Newton step d minimizes |r + J d|^2, which
lowers the loss |r|^2 / 2 by |P r|^2 / 2, where P projects onto the columns of J. In
standard errors the step is |P r| / s long, s the standard deviation of a residual.

Source: Bates, Watts, Nonlinear Regression Analysis and Its Applications (1988), 2.2.3.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float

from jaxthermo.parallel.batch import on_every_device

from ..config.schema import FitConfig
from ..problem.problem import Problem
from .levenberg_marquardt import jacobian_rows
from .noise_scale import residual_sd
from .search import (
    REVERSE_METHODS,
    Objective,
    forward_only,
    residuals,
    residuals_with_products,
)


_MAX_DISTANCE = 0.1
"""Distance from the minimum, in standard errors, at which a search has converged."""
_MAX_STEP = 1.0
"""Largest change of a coordinate over which the linear model is believed."""
_PRODUCTS = 50
"""Products with J^T J for a step in thousands of coordinates."""


MAX_JUDGED = 200
"""Coordinates up to which the final Jacobian is kept, to judge the values by."""


class Slope(NamedTuple):
    """Derivatives at the end of a search."""

    jacobian: Float[np.ndarray, "p r"] | None
    """Rows of J^T; None where there are too many coordinates."""
    is_minimum: bool


def examine(
    problem: Problem,
    settings: FitConfig,
    objective: Objective,
    z: Float[Array, " p"],
    residual: Float[np.ndarray, " r"],
    mesh: Mesh | None,
) -> Slope:
    """Derivatives at a point by an exact Jacobian, and if it is a minimum."""
    resolution = _coordinate_resolution(problem.dtype)
    rows = None
    if len(z) <= MAX_JUDGED or settings.method not in REVERSE_METHODS:
        forward, replicated_z = on_every_device(mesh, (forward_only(objective), z))
        jacobian = jacobian_rows(
            residuals, args=forward, z=replicated_z, batch=problem.batch(), mesh=mesh
        )
        rows = np.asarray(jacobian, float)
        step = _gauss_newton_step(rows, residual, resolution)
    else:
        length, decrease = _step_by_products(objective, z)
        step = _Step(float(length), decrease=float(decrease))
    loss = 0.5 * float((residual**2).sum())
    sd = None
    if problem.time_norm == 2 and problem.known_sd is not None:
        # Where the model does not meet the data, errors are wider than by noise.
        sd = max(residual_sd(residual, len(z), None), problem.known_sd)
    is_at_minimum = _is_minimum(
        step,
        loss=loss,
        sd=sd,
        tolerance=relative_tolerance(problem, settings),
        resolution=resolution,
    )
    return Slope(rows if len(z) <= MAX_JUDGED else None, is_at_minimum)


def relative_tolerance(problem: Problem, settings: FitConfig) -> float:
    """Relative decrease of the loss that is not worth a step."""
    # A loss is about the error to the power of the norm.
    return settings.tolerance * problem.time_norm


class _Step(NamedTuple):
    """Gauss-Newton step from a point, and what it promises."""

    length: float
    """Largest change of a coordinate."""
    decrease: float
    """Decrease of the loss that the linear model predicts."""


def _gauss_newton_step(
    rows: Float[np.ndarray, "p r"], residual: Float[np.ndarray, " r"], resolution: float
) -> _Step:
    """Gauss-Newton step by the rows of J^T.

    Directions whose singular value is below `resolution` of the largest, in columns of
    equal length, are not resolved and left out. No direction is followed by more than
    a coordinate's own size.
    """
    if not np.isfinite(rows).all():
        return _Step(length=math.inf, decrease=math.inf)
    norms = np.linalg.norm(rows, axis=1)
    size = np.where(norms > 0, norms, 1.0)
    columns = (rows / size[:, None]).T
    left, singular, right = np.linalg.svd(columns, full_matrices=False)
    resolved = singular > resolution * singular.max(initial=0.0)
    slopes = left[:, resolved].T @ residual
    steps = -(slopes / singular[resolved])[:, None] * right[resolved] / size
    lengths = np.abs(steps).max(axis=1, initial=0.0)
    fraction = _MAX_STEP / np.maximum(lengths, _MAX_STEP)
    step = (fraction[:, None] * steps).sum(axis=0)
    # Along a fraction f of a step the loss falls by f (2 - f) of what the whole gains.
    decrease = 0.5 * (fraction * (2 - fraction) * slopes**2).sum()
    return _Step(length=float(np.abs(step).max(initial=0.0)), decrease=float(decrease))


@eqx.filter_jit
def _step_by_products(
    objective: Objective, z: Float[Array, " p"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Length and decrease of a Gauss-Newton step, by products with J and J^T alone.

    Conjugate gradients find most of the decrease in a few products.
    """

    def function(z):
        return residuals_with_products(z, objective)[0]

    residual, product = jax.linearize(function, z)
    transposed = jax.linear_transpose(product, z)
    gradient = transposed(residual)[0]
    operator = lx.FunctionLinearOperator(
        lambda d: transposed(product(d))[0],
        jax.eval_shape(lambda: z),
        lx.positive_semidefinite_tag,
    )
    solver = lx.CG(rtol=1e-3, atol=0.0, max_steps=_PRODUCTS)
    step = lx.linear_solve(operator, -gradient, solver, throw=False).value
    length = jnp.abs(step).max()
    fraction = _MAX_STEP / jnp.maximum(length, _MAX_STEP)
    change = product(fraction * step)
    decrease = -(residual @ change + 0.5 * change @ change)
    return fraction * length, jnp.maximum(decrease, 0.0)


def _is_minimum(
    step: _Step, loss: float, sd: float | None, tolerance: float, resolution: float
) -> bool:
    """True if a step is worth nothing.

    It promises a relative decrease of the loss of at most `tolerance`, within a tenth
    of a standard error where residuals have noise of the standard deviation `sd`; or it
    changes no coordinate by more than their rounding, the `resolution`.
    """
    is_near = sd is None or math.sqrt(2 * step.decrease) <= _MAX_DISTANCE * sd
    is_small = step.decrease <= tolerance * loss and is_near
    return bool(is_small or step.length <= resolution)


def _coordinate_resolution(dtype: Any) -> float:
    """Relative change of a coordinate that a loss of this type resolves."""
    # A loss is flat at its minimum: its rounding hides steps of the root of that.
    return float(np.sqrt(np.finfo(dtype).eps))
