"""Errors of a model without a fit, and with fits that leave out a part of the data."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from calibrate.analysis.identifiability import Identified, identify
from calibrate.problem.parameters import ParameterSet
from calibrate.problem.problem import Problem
from calibrate.problem.targets import SurfaceTarget
from calibrate.solvers.noise_scale import residual_sd
from jaxthermo.arrays import precision


_FARTHEST = 4.0
"""Largest coordinate that is judged: farther on, a value at a bound has no slope."""


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

    def rows(z: jax.Array) -> tuple[jax.Array, jax.Array]:
        residual, _ = problem.residuals(z, tables)
        kelvin = residual[: len(compared)][compared] / scale
        return kelvin, kelvin

    # One program for both: compiling takes longer than running.
    compiled = eqx.filter_jit(jax.jacfwd(rows, has_aux=True))

    @functools.lru_cache(maxsize=1)
    def slope_and_value(coordinates: tuple[float, ...]) -> tuple[Any, Any]:
        with precision(problem.dtype.name):
            slope, value = compiled(np.asarray(coordinates))
            return np.asarray(slope), np.asarray(value)

    def at(z: np.ndarray) -> Float[np.ndarray, " t"]:
        return slope_and_value(tuple(z.tolist()))[1]

    def slope(z: np.ndarray) -> Float[np.ndarray, "t p"]:
        return slope_and_value(tuple(z.tolist()))[0]

    return Residuals(at, slope, problem.parameters.size)


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


def judged(
    parameters: ParameterSet,
    residuals: Residuals,
    z: Float[np.ndarray, " p"],
    used: Bool[np.ndarray, " t"],
) -> Identified:
    """Values at the coordinates of a fit, with standard errors and verdicts."""
    z = np.clip(z, -_FARTHEST, _FARTHEST)
    remainder = residuals.at(z)[used]
    return identify(
        parameters,
        z=z,
        jacobian=residuals.slope(z)[used].T,
        sd=residual_sd(remainder, len(z), noise=None),
    )


def rms(errors: Float[np.ndarray, " t"]) -> float:
    """Root mean square [K]."""
    return float(np.sqrt(np.mean(errors**2)))
