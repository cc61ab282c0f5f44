"""Wind speed in the wakes of objects upstream, by two models.

`WakeDeficit` goes by the distance x behind the rear of an object alone,

    u / U = 1 - A (1 + (x / l)^2)^(-p / 2),

with x and l in diameters of the object: the family of steady laminar wakes. Fitted to
computed centrelines at Re 10 to 40 its error is 0.007 to 0.03 (a pure exponential: 0.07
to 0.08); far away p tends to 1/2 (Schlichting). The thesis (6.2) draws such a
"convergent function" without a formula.

`FittedWake` goes by Reynolds number and has a width, fitted to computed flows in
`data/wake_fit.csv`:

    u / U = 1 - d(x) exp(-y^2 / (2 b^2)),    b^2 = w^2 + g x,
    d(x) = (A - r) (1 + (x / l)^2)^(-p / 2) + r (1 + x / 30)^(-1/2),

x behind the rear of an object and y to the side of it, in its diameters. A, l, p, w, g
and r are powers of Re = V D / nu: one set for steady wakes, one for the mean of wakes
that shed vortices, and constants for turbulent ones, with a smooth change between. r is
the deficit that remains where the vortices have formed: they mix the fluid well before
and little afterwards. Other wakes have no remainder.

Behind several objects the speed ratios multiply. Each cylinder of a body takes the mean
over its front.
"""

import csv
import functools
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, is_traced, smooth_step
from ...errors import InputError
from ..flux_law import Values
from .air import kinematic_viscosity
from .nusselt import Pchip, pchip
from .wake_geometry import WakeGeometry


# Where the formula is negative, u / U decays to 0 over about this much.
_TRANSITION = 0.05

# Range of Reynolds numbers to whose wakes the family was fitted.
_MIN_FITTED_REYNOLDS = 10.0
_MAX_FITTED_REYNOLDS = 40.0


class WakeDeficit(Module):
    """Wake u / U = 1 - A (1 + (x / l)^2)^(-p / 2); the defaults fit Re 20.

    Any other callable from x / D to u / U in (0, 1] can be given instead.
    """

    amplitude: Scalar = 1.027
    """A [-], in (0, 1.3)."""
    length: Scalar = 2.227
    """l / D [-]."""
    exponent: Scalar = 0.497
    """p [-], in [0.4, 1.1]."""

    def __check_init__(self):
        _check("amplitude", value=self.amplitude, low=0.0, high=1.3)
        _check("length", value=self.length, low=0.0, high=np.inf)
        _check("exponent", value=self.exponent, low=0.4 - 1e-9, high=1.1 + 1e-9)

    def __call__(self, x: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Speed ratio u / U [-] at x diameters behind the rear."""
        a = jnp.asarray(self.amplitude, x.dtype)
        length = jnp.asarray(self.length, x.dtype)
        p = jnp.asarray(self.exponent, x.dtype)
        return _above_zero(1 - a * (1 + (x / length) ** 2) ** (-p / 2))


def _above_zero(ratio: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Speed ratio u / U, smoothly limited to positive values."""
    # Inside the bubble the mean flow runs backwards; a speed cannot.
    return jax.nn.softplus(ratio / _TRANSITION) / jax.nn.softplus(1 / _TRANSITION)


def _check(name: str, value: Any, low: float, high: float) -> None:
    if is_traced(value):
        return
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not low < number < high:
        raise InputError(
            f"WakeDeficit({name}={value!r}): give a number between {low:.3g} and "
            f"{high:.3g}"
        )


def wake_notes(wake: Any, reynolds: Float[np.ndarray, " n"]) -> tuple[str, ...]:
    """Note on a wake of objects at other Reynolds numbers V D / nu than its fit."""
    low = _MIN_FITTED_REYNOLDS
    high = _MAX_FITTED_REYNOLDS
    beyond = reynolds[(reynolds < low) | (reynolds > high)]
    # The range of a user's function is not known.
    if not isinstance(wake, WakeDeficit) or not len(beyond):
        return ()
    ends = f"{beyond.min():.3g}"
    if beyond.max() > beyond.min() * 1.01:
        ends += f" to {beyond.max():.3g}"
    sooner = ": a turbulent wake recovers sooner" if beyond.max() > high else ""
    return (
        f"the wake is of an object at Re {ends}, and the deficit was fitted at Re "
        f"{low:g} to {high:g} (its defaults at 20){sooner}",
    )


def wake_speed_ratio(wake: Any, x: Float[np.ndarray, " g"]) -> Float[Any, " g"]:
    """Speed ratio u / U [-] at x / D, which is infinite with nothing upstream.

    Raises:
        InputError: if `wake` returns values outside (0, 1].
    """
    behind = np.isfinite(x)
    # The power of an infinite distance has no derivative.
    with jax.ensure_compile_time_eval():
        ratio = jnp.where(behind, wake(jnp.asarray(np.where(behind, x, 1.0))), 1.0)
        if is_traced(ratio):
            return ratio
        values = np.asarray(ratio)
    bad = ~((values > 0) & (values <= 1))
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"Wind(wake=): gives u/U = {values[first]:.3g} at x/D = {x[first]:.3g}; "
            "it must lie in (0, 1]"
        )
    return values


PARAMETERS = ("amplitude", "length", "exponent", "width", "spread", "remainder")
"""A, l, p, w, g, r."""

NO_REMAINDER = 1e-3
"""The r of a wake without any: it has a logarithm."""

_FILE = Path(__file__).parents[2] / "data" / "wake_fit.csv"

# Beyond its first and last Reynolds number a curve levels off within this factor.
_LEVELS_OFF = 1.2

# Length before an object's rear over which its wake sets in at the sides [diameters].
_ONSET = 1.0

# Length over which the remainder decays, as a far wake does [diameters].
_REMAINS = 30.0

# Length over which the spread of the wake sets in behind the rear [diameters].
_SPREADS_FROM = 0.5


class _WakeRange(NamedTuple):
    """Parameters of one regime of wakes in its range of Reynolds numbers."""

    regime: str
    """Name of the regime: steady, mean of a shedding wake, or turbulent."""
    low: float
    """Smallest Reynolds number of the range."""
    high: float
    """Largest Reynolds number of the range."""
    reference: float
    """Reynolds number at which the values hold."""
    values: Float[np.ndarray, "6"]
    """`PARAMETERS` at the reference."""
    powers: Float[np.ndarray, "6"]
    """Powers of Re by which they change."""

    def at(self, reynolds: float) -> Float[np.ndarray, "6"]:
        """Logarithms of the parameters."""
        return np.log(self.values) + self.powers * np.log(reynolds / self.reference)


@functools.cache
def _wake_ranges() -> tuple[_WakeRange, ...]:
    """Regimes of wakes by rising Reynolds number."""
    with _FILE.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    ranges = []
    for regime in dict.fromkeys(row["kind"] for row in rows):
        by_name = {row["parameter"]: row for row in rows if row["kind"] == regime}
        parameters = [by_name[name] for name in PARAMETERS]
        ranges.append(
            _WakeRange(
                regime=regime,
                low=float(parameters[0]["Re_low"]),
                high=float(parameters[0]["Re_high"]),
                reference=float(parameters[0]["Re_reference"]),
                values=np.array([float(row["value"]) for row in parameters]),
                powers=np.array([float(row["power"]) for row in parameters]),
            )
        )
    return tuple(ranges)


@functools.cache
def _by_reynolds() -> Pchip:
    """Logarithms of the parameters by that of Re, level beyond the ends."""
    reynolds = []
    logs = []
    for wake_range in _wake_ranges():
        middle = np.sqrt(wake_range.low * wake_range.high)
        for re in (wake_range.low, middle, wake_range.high):
            reynolds.append(re)
            logs.append(wake_range.at(re))
    # Turbulent wakes are alike at all Reynolds numbers: their first will do.
    reynolds = reynolds[:-2]
    logs = logs[:-2]
    reynolds = [reynolds[0] / _LEVELS_OFF, *reynolds, reynolds[-1] * _LEVELS_OFF]
    logs = [logs[0], *logs, logs[-1]]
    return pchip(np.log(np.array(reynolds)), np.stack(logs))


def mean_wake(
    parameters: Float[Array, "*#n 6"], x: Float[Array, "*n"], y: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Mean velocity u / U, negative where it is reversed, x >= 0 behind the rear."""
    amplitude, length, exponent, width, spread, remainder = jnp.moveaxis(
        parameters, -1, 0
    )
    near = (1 + (x / length) ** 2) ** (-exponent / 2)
    far = remainder * (1 + x / _REMAINS) ** -0.5
    decay = (amplitude - remainder) * near + far
    grown = jnp.sqrt(x * x + _SPREADS_FROM**2) - _SPREADS_FROM
    return 1 - decay * jnp.exp(-(y**2) / (2 * (width**2 + spread * grown)))


class FittedWake(Module):
    """Wake by Reynolds number, fitted to computed flows around a cylinder.

    Fitted at Re 10 to 40 (steady) and 60 to 150 (mean of the shedding flow); below it
    is that of Re 10, from 300 on a turbulent far wake (Schlichting).
    """

    def __call__(
        self,
        x: Float[Array, "*n"],
        y: Float[Array, "*n"],
        reynolds: Float[Array, "*#n"],
    ) -> Float[Array, "*n"]:
        """Speed ratio u / U [-] in (0, 1] at x behind the rear and y to the side.

        Both in diameters; 1 from a diameter before the rear on.
        """
        logs = _by_reynolds()(jnp.log(jnp.maximum(reynolds, 1.0)))
        behind = jnp.maximum(x, 0)
        deficit = 1 - mean_wake(jnp.exp(logs), behind, y)
        t = jnp.clip(1 + x / _ONSET, 0, 1)
        return _above_zero(1 - smooth_step(t) * deficit)


def fitted_notes(reynolds: Float[np.ndarray, " n"]) -> tuple[str, ...]:
    """Notes on objects at Reynolds numbers V D / nu that no wake was computed for."""
    computed = [fit for fit in _wake_ranges() if fit.regime != "turbulent"]
    low = computed[0].low
    high = computed[-1].high
    turbulent = _wake_ranges()[-1].low
    notes = []
    if (reynolds < low).any():
        notes.append(
            f"the wake is of an object at Re {reynolds.min():.3g}; below {low:g}, "
            f"where none was computed, it is taken as that of Re {low:g}"
        )
    if (reynolds > high).any():
        notes.append(
            f"the wake is of an object at Re {reynolds.max():.3g}; wakes were computed "
            f"up to {high:g}, from {turbulent:g} on it is a turbulent far wake "
            "(Schlichting), which holds some 50 diameters behind"
        )
    return tuple(notes)


def arriving_ratio(
    wake: Any,
    geometry: WakeGeometry,
    member: Int[np.ndarray, " s"],
    front: Float[np.ndarray, " s"],
    speeds: Float[Values, " v"],
    air: Float[Values, ""],
) -> Float[Any, "v g"]:
    """Speed ratio that arrives at each group of fragments, at each wind speed.

    Args:
        wake: u / U by x / D, y / D and Re.
        geometry: objects upstream of every fragment.
        member: group of every fragment.
        front: area of every fragment as the wind sees it, 0 on the rear [m^2].
        speeds: wind speeds [m/s].
        air: temperature of the air [K].
    """
    count = int(member.max(initial=0)) + 1
    total = np.bincount(member, front, count)
    # A group without a front takes the plain mean.
    weight = np.where(total[member] > 0, front, 1.0)
    weight = weight / np.bincount(member, weight, count)[member]
    dtype = speeds.dtype
    with jax.ensure_compile_time_eval():
        ratio = jnp.ones((len(speeds), len(member)), dtype)
        nu = kinematic_viscosity(jnp.asarray(air, dtype))
        for x, y, diameter in zip(*geometry, strict=True):
            reynolds = jnp.asarray(speeds) * jnp.asarray(diameter, dtype) / nu
            behind = jnp.broadcast_to(x.astype(dtype), ratio.shape)
            aside = jnp.broadcast_to(y.astype(dtype), ratio.shape)
            ratio = ratio * wake(behind, aside, reynolds[:, None])
        grouped = jax.ops.segment_sum(
            (ratio * jnp.asarray(weight.astype(dtype))[None]).T,
            jnp.asarray(member),
            num_segments=count,
        ).T
        return grouped if is_traced(grouped) else np.asarray(grouped)
