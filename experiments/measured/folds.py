"""Errors of a model without a fit, and with fits that leave out a part of the data."""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from calibrate.problem.problem import Problem
from calibrate.problem.targets import SurfaceTarget
from jaxthermo.arrays import precision


class Residuals(NamedTuple):
    """Computed less measured temperatures [K] by the coordinates of a problem."""

    at: Callable[[np.ndarray], Float[np.ndarray, " t"]]
    slope: Callable[[np.ndarray], Float[np.ndarray, "t p"]]
    size: int
    """Number of coordinates."""


def residuals_of(problem: Problem) -> Residuals:
    """Residuals of a problem with one value at each time, compiled once."""
    (case,) = problem.cases
    assert isinstance(case.target, SurfaceTarget)
    weight = np.asarray(case.target.scale).reshape(-1)
    compared = weight > 0
    scale = weight[compared]
    with precision(problem.dtype.name):
        tables = problem.step_tables_at(problem.start())

        def rows(z: jax.Array) -> jax.Array:
            residual, _ = problem.residuals(z, tables)
            return residual[: len(compared)][compared] / scale

        at = eqx.filter_jit(rows)
        slope = eqx.filter_jit(jax.jacfwd(rows))

    def host(function: Callable[[Any], jax.Array]):
        def called(z: np.ndarray) -> np.ndarray:
            with precision(problem.dtype.name):
                return np.asarray(function(np.asarray(z, float)))

        return called

    return Residuals(host(at), host(slope), problem.parameters.size)


def fitted(
    residuals: Residuals, used: Bool[np.ndarray, " t"]
) -> Float[np.ndarray, " p"]:
    """Coordinates that are fitted to the rows that are used."""

    def slope(z: np.ndarray) -> Any:
        return residuals.slope(z)[used]

    result = least_squares(
        lambda z: residuals.at(z)[used],
        x0=np.zeros(residuals.size),
        jac=cast(Any, slope),
        method="lm",
        xtol=1e-6,
        ftol=1e-6,
    )
    return np.asarray(result.x)


def left_out(
    residuals: Residuals,
    fold: np.ndarray,
    used: Bool[np.ndarray, " t"],
) -> Float[np.ndarray, " t"]:
    """Errors of each fold with the numbers fitted to the rows of all others [K]."""
    errors = np.zeros(len(fold))
    for number in np.unique(fold):
        is_out = fold == number
        errors[is_out] = residuals.at(fitted(residuals, used & ~is_out))[is_out]
    return errors


def rms(errors: Float[np.ndarray, " t"]) -> float:
    """Root mean square [K]."""
    return float(np.sqrt(np.mean(errors**2)))
