"""Wake by Reynolds number, fitted to computed flows: `data/wake_fit.csv`.

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
from jaxtyping import Array, Float, Int

from ...arrays import is_traced
from ...module import Module
from ..flux_law import Values
from .air import kinematic_viscosity
from .nusselt import Pchip, pchip
from .wake import above_zero
from .wake_geometry import WakeGeometry


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
        return above_zero(1 - t * t * (3 - 2 * t) * deficit)


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
