"""Fits of wakes: families of curves on one centreline, and wakes by Reynolds number.

| family | u / U on the centreline, x from the rear in diameters |
|---|---|
| exponential | 1 - A exp(-x / l), as the thesis' words suggest |
| power | 1 - A (1 + (x / l)^2)^(-p / 2) |
| confined | 1 - A (1 + (x / l)^2)^(-p / 2) exp(-x / c), between walls |
| remainder | 1 - (A - r) (1 + (x / l)^2)^(-4) - r, behind shed vortices |

By Reynolds number the wake is a family with a remainder times a Gaussian across, each
parameter a power of Re within one kind of flow (`wake.mean_wake`). Least
squares by optimistix; standard errors from the Jacobian at the solution, as if the
deviations were independent, which those of neighbouring points are not.
"""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float

from ..arrays import precision
from ..atomic import write_text
from ..physics.convection.wake import NO_REMAINDER, PARAMETERS, mean_wake
from .wake_runs import WakeProfile


Curve = Callable[[Float[Array, " k"], Float[Array, " n"]], Float[Array, " n"]]


# Where vortices form a deficit falls like a bell: with a higher exponent only l grows.
_SHEDDING_EXPONENT = 8.0


def _exponential(q, x):
    return 1 - q[0] * jnp.exp(-x / q[1])


def _power(q, x):
    return 1 - q[0] * (1 + (x / q[1]) ** 2) ** (-q[2] / 2)


def _confined(q, x):
    return 1 - q[0] * (1 + (x / q[1]) ** 2) ** (-q[2] / 2) * jnp.exp(-x / q[3])


def _remainder(q, x):
    near = (1 + (x / q[1]) ** 2) ** (-_SHEDDING_EXPONENT / 2)
    return 1 - (q[0] - q[2]) * near - q[2]


class _Family(NamedTuple):
    """Curves of one form, with names and first guesses of their parameters."""

    name: str
    curve: Curve
    parameters: tuple[str, ...]
    guess: tuple[float, ...]


FAMILIES = (
    _Family(
        name="exponential", curve=_exponential, parameters=("A", "l"), guess=(1.0, 4.0)
    ),
    _Family(
        name="power", curve=_power, parameters=("A", "l", "p"), guess=(1.0, 2.0, 0.7)
    ),
    _Family(
        name="confined",
        curve=_confined,
        parameters=("A", "l", "p", "c"),
        guess=(1.0, 2.0, 0.5, 50.0),
    ),
    _Family(
        name="remainder",
        curve=_remainder,
        parameters=("A", "l", "r"),
        guess=(1.0, 4.0, 0.2),
    ),
)


class FamilyFit(NamedTuple):
    """Parameters of a curve, their standard errors, and its deviations."""

    values: Float[np.ndarray, " k"]
    errors: Float[np.ndarray, " k"]
    """Standard errors; infinite where the points do not determine a parameter."""
    rms: float
    """Root mean square of the deviations of u / U."""
    largest: float
    """Largest deviation of u / U."""


class _Solution(NamedTuple):
    values: Array
    residual: Array
    """Residual at the solution."""
    slope: Array
    """Its Jacobian."""


@eqx.filter_jit
def _solution(residual: Callable, guess: Array, points: Any) -> _Solution:
    solver = optimistix.LevenbergMarquardt(rtol=1e-9, atol=1e-9)
    q = optimistix.least_squares(residual, solver, guess, points, max_steps=2000).value
    return _Solution(
        values=q,
        residual=residual(q, points),
        slope=jax.jacfwd(residual)(q, points),
    )


def _least_squares(
    residual: Callable, guess: Float[np.ndarray, " k"], points: Any
) -> FamilyFit:
    """Fit of the parameters of `residual`, a function of them and of the points."""
    with precision("float64"):
        solution = _solution(
            residual, jnp.asarray(guess), jax.tree.map(jnp.asarray, points)
        )
        deviation = np.asarray(solution.residual)
        errors = _standard_errors(np.asarray(solution.slope), deviation)
    return FamilyFit(
        values=np.asarray(solution.values),
        errors=errors,
        rms=float(np.sqrt(np.mean(deviation**2))),
        largest=float(np.abs(deviation).max()),
    )


def _standard_errors(
    slope: Float[np.ndarray, "n k"], deviation: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " k"]:
    """Standard errors; infinite for parameters that the points do not determine.

    Where A and l act by A l^p alone, one direction of the two changes nothing.
    """
    _, effects, directions = np.linalg.svd(slope, full_matrices=False)
    variance = deviation @ deviation / max(len(deviation) - len(effects), 1)
    seen = effects > effects[0] * len(deviation) * np.finfo(float).eps
    # What rounding leaves of a parameter in a direction is far below this.
    free = (np.abs(directions[~seen]) > 1e-6).any(0)
    variances = variance * ((directions[seen] / effects[seen, None]) ** 2).sum(0)
    return np.where(free, np.inf, np.sqrt(variances))


def fit_family(
    family: _Family, x: Float[np.ndarray, " n"], ratio: Float[np.ndarray, " n"]
) -> FamilyFit:
    """Curve of a family through u / U at distances x, all parameters positive."""
    points = (np.asarray(x, float), np.asarray(ratio, float))
    fit = _least_squares(_residual(family.curve), np.log(family.guess), points)
    values = np.exp(fit.values)
    return fit._replace(values=values, errors=values * fit.errors)


@functools.cache
def _residual(curve: Curve) -> Callable:
    # One function a curve, so that it is compiled once.
    def residual(q, points):
        x, ratio = points
        return curve(jnp.exp(q), x) - ratio

    return residual


def tail_length(
    x: Float[np.ndarray, " n"], ratio: Float[np.ndarray, " n"], level: float = 0.9
) -> float:
    """Distance from which on u / U stays above a level; infinite if not reached."""
    below = np.flatnonzero(ratio < level)
    if not len(below):
        return 0.0
    last = below[-1]
    if last == len(x) - 1:
        return float("inf")
    fraction = (level - ratio[last]) / (ratio[last + 1] - ratio[last])
    return float(x[last] + fraction * (x[last + 1] - x[last]))


class WakeFit(NamedTuple):
    """Wake of one kind of flow: each parameter is value (Re / reference)^power."""

    regime: str
    low: float
    """Smallest Reynolds number of the data."""
    high: float
    reference: float
    values: Float[np.ndarray, "6"]
    """Values of `PARAMETERS` at the reference."""
    value_errors: Float[np.ndarray, "6"]
    powers: Float[np.ndarray, "6"]
    power_errors: Float[np.ndarray, "6"]
    rms: float
    largest: float


def fit_wakes(regime: str, profiles: tuple[WakeProfile, ...], remains: bool) -> WakeFit:
    """Fit of all profiles of one kind of flow, behind the bubble of each.

    Air next to the body that is faster than the wind counts as the wind. With a
    remainder the exponent is fixed, and without one the remainder.
    """
    used = [_behind_bubble(profile) for profile in profiles]
    x = np.concatenate([profile.x for profile in used])
    y = np.concatenate([profile.y for profile in used])
    ratio = np.minimum(np.concatenate([profile.ratio for profile in used]), 1.0)
    numbers = np.array([p.reynolds for p in used])
    reference = float(np.exp(np.log(numbers).mean()))
    logs = np.repeat(np.log(numbers / reference), [len(p.x) for p in used])
    start = np.array(_SHEDDING_START if remains else _STEADY_START)
    fixed = "exponent" if remains else "remainder"
    free = np.array([name != fixed for name in PARAMETERS])

    def residual(q, points):
        x, y, ratio, logs = points
        log_values = jnp.log(jnp.asarray(start)).at[free].set(q[:5])
        powers = jnp.zeros(6).at[free].set(q[5:])
        parameters = jnp.exp(log_values[None] + logs[:, None] * powers[None])
        return mean_wake(parameters, x, y) - ratio

    guess = np.concatenate([np.log(start[free]), np.zeros(5)])
    fit = _least_squares(residual, guess, (x, y, ratio, logs))

    def full(values: Float[np.ndarray, "5"]) -> Float[np.ndarray, "6"]:
        all_values = np.zeros(6)
        all_values[free] = values
        return all_values

    values = np.where(free, np.exp(full(fit.values[:5])), start)
    return WakeFit(
        regime=regime,
        low=float(numbers.min()),
        high=float(numbers.max()),
        reference=reference,
        values=values,
        value_errors=values * full(fit.errors[:5]),
        powers=full(fit.values[5:]),
        power_errors=full(fit.errors[5:]),
        rms=fit.rms,
        largest=fit.largest,
    )


_STEADY_START = (1.0, 2.0, 0.7, 0.5, 0.05, NO_REMAINDER)
_SHEDDING_START = (1.1, 5.0, _SHEDDING_EXPONENT, 0.5, 0.03, 0.25)


def _behind_bubble(profile: WakeProfile) -> WakeProfile:
    """Points behind the bubble of reversed flow, beyond which speeds are positive."""
    middle = profile.y == 0
    reversed_flow = profile.x[middle & (profile.ratio < 0)]
    start = reversed_flow.max(initial=0.0)
    is_behind = profile.x > start
    return WakeProfile(
        profile.reynolds,
        x=profile.x[is_behind],
        y=profile.y[is_behind],
        ratio=profile.ratio[is_behind],
    )


# Far behind a cylinder a turbulent wake has the deficit 0.98 (c D / x)^(1/2) and half
# of it at 0.25 (c D x)^(1/2) from the middle, with the coefficient of drag c = 1.2 from
# Re 300 to the drag crisis (Schlichting, Boundary-Layer Theory, 7th ed., chapter 24;
# both recalled, and consistent with the drag to 4 %). Near the cylinder, where nothing
# of this holds, the curve ends at A = 1, as wide as the shedding wakes.
_DRAG = 1.2
_TURBULENT = (
    1.0,
    0.98**2 * _DRAG,
    0.5,
    0.5,
    0.25**2 * _DRAG / (2 * float(np.log(2))),
    NO_REMAINDER,
)
_TURBULENT_REYNOLDS = (300.0, 2e5)


def write_fits(path: Path, fits: tuple[WakeFit, ...]) -> None:
    """Write fits, and the turbulent far wake after them, as a CSV file."""
    names = "kind,Re_low,Re_high,Re_reference,parameter,value,value_error,power"
    lines = [f"{names},power_error,rms,source"]
    for fit in fits:
        ends = f"{fit.regime},{fit.low:g},{fit.high:g},{fit.reference:.6g}"
        for name, *row in zip(
            PARAMETERS,
            fit.values,
            fit.value_errors,
            fit.powers,
            fit.power_errors,
            strict=True,
        ):
            numbers = ",".join(f"{value:.5g}" for value in row)
            lines.append(f"{ends},{name},{numbers},{fit.rms:.4f},wake_profiles.csv")
    low, high = _TURBULENT_REYNOLDS
    for name, value in zip(PARAMETERS, _TURBULENT, strict=True):
        ends = f"turbulent,{low:g},{high:g},{low:g}"
        lines.append(f"{ends},{name},{value:.5g},,0,,,Schlichting (recalled)")
    write_text(path, "\n".join(lines) + "\n")
