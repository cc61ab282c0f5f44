"""Exact steps of decoupled modes under loads that are linear between knots.

For dz/dt = -rate z + d(t) with d linear from d_0 to d_1 over a step, and h = rate step,

    z_1 = exp(-h) z_0 + step [phi_1(h) d_0 + phi_2(h) (d_1 - d_0)],
    phi_1 = (1 - exp(-h)) / h,    phi_2 = (1 - phi_1) / h.

A knot that occurs twice is a jump of the load.
"""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..arrays import product
from ..errors import InputError


_SERIES_LIMIT = 0.3
"""h below which the quotients lose digits, and the series has double precision."""
_SERIES_TERMS = 11

_Modes = Float[Array | np.ndarray, "*m"]


class _StepWeights(NamedTuple):
    """Weights of the three contributions to the state of a mode after a step."""

    decay: Any
    """exp(-h), the weight of the mode's state at the start of the step."""
    constant: Any
    """step phi_1, the weight of the load at the start of the step."""
    ramp: Any
    """step phi_2, the weight of the load's change over the step."""


def step_weights(xp: Any, rates: _Modes, step: Any) -> _StepWeights:
    """Weights of steps of given lengths [s], computed by `xp`: numpy or jax.numpy."""
    h = rates * step
    is_small = xp.abs(h) < _SERIES_LIMIT
    # Both branches are differentiated: neither may divide by 0.
    large = xp.where(is_small, 1.0, h)
    small = xp.where(is_small, h, 0.0)
    first = xp.zeros_like(h)
    second = xp.zeros_like(h)
    term = xp.ones_like(h)
    for k in range(1, _SERIES_TERMS):
        term = term / k
        first = first + term
        second = second + term / (k + 1)
        term = term * -small
    by_quotient = -xp.expm1(-large) / large
    phi_1 = xp.where(is_small, first, by_quotient)
    phi_2 = xp.where(is_small, second, (1 - by_quotient) / large)
    return _StepWeights(decay=xp.exp(-h), constant=step * phi_1, ramp=step * phi_2)


class Schedule(NamedTuple):
    """Steps between knots and saved times."""

    step: Float[Array | np.ndarray, " i"]
    """Length of each step [s]."""
    knot: Int[Array | np.ndarray, " i"]
    """Last knot at or before the start of each step; the step ends by the next one."""
    begin: Float[Array | np.ndarray, " i"]
    """Fraction of the way between the two knots at the start of each step [-]."""
    end: Float[Array | np.ndarray, " i"]
    """Fraction of the way between the two knots at the end of each step [-]."""
    saved: Int[Array | np.ndarray, " t"]
    """Step that ends at each saved time; -1 for the start."""

    def loads(self, xp: Any, amplitudes: Any) -> tuple[Any, Any]:
        """Amplitudes at the start and at the end of every step."""
        previous = amplitudes[self.knot]
        change = amplitudes[self.knot + 1] - previous
        begin = xp.asarray(self.begin, previous.dtype)[:, None]
        end = xp.asarray(self.end, previous.dtype)[:, None]
        return previous + begin * change, previous + end * change

    def at_saves(self, start: Any, ends: Any) -> np.ndarray:
        """Rows at the saved times, of those at the ends of steps and at the start."""
        return np.stack([start if n < 0 else ends[n] for n in self.saved])


def schedule(knots: Sequence[float], times: Sequence[float]) -> Schedule:
    """Divide the time between knots at the saved times.

    Args:
        knots: times between which loads are linear, from 0 on; twice for a jump [s].
        times: increasing times to save, within the knots [s].

    Raises:
        InputError: if a time is outside of the knots, or these decrease.
    """
    knot_times = np.asarray(knots, float)
    saves = np.asarray(times, float)
    if len(knots) < 1 or knot_times[0] != 0 or (np.diff(knot_times) < 0).any():
        raise InputError("reduced model: the knots start at 0 s and do not decrease")
    if len(saves) and not (saves[0] >= 0 and saves[-1] <= knot_times[-1]):
        raise InputError(
            f"reduced model: save times lie between 0 and {knot_times[-1]:g} s, the "
            "last knot"
        )
    rows = []
    ends = []
    for knot, (a, b) in enumerate(itertools.pairwise(knot_times)):
        if b <= a:
            continue
        inner = [t for t in saves if a < t < b]
        for t0, t1 in zip([a, *inner], [*inner, b], strict=True):
            rows.append((t1 - t0, knot, (t0 - a) / (b - a), (t1 - a) / (b - a)))
            ends.append(t1)
    step, knot, begin, end = np.array(rows).reshape(-1, 4).T
    # The load at a saved time is the one that has acted until then.
    saved = [-1 if t == 0 else int(np.searchsorted(ends, t)) for t in saves]
    return Schedule(
        step=step,
        knot=knot.astype(int),
        begin=begin,
        end=end,
        saved=np.array(saved, int),
    )


def host_run(
    rates: Float[np.ndarray, " m"],
    drive: Float[np.ndarray, "m k"],
    start: Float[np.ndarray, " m"],
    plan: Schedule,
    amplitudes: Float[np.ndarray, "q k"],
) -> Float[np.ndarray, "i m"]:
    """State after every step, in double precision on the host."""
    u0, u1 = plan.loads(np, amplitudes)
    d0 = u0 @ drive.T
    d1 = u1 @ drive.T
    weights = step_weights(np, rates[None], plan.step[:, None])
    growth = weights.constant * d0 + weights.ramp * (d1 - d0)
    states = np.zeros((len(plan.step), len(rates)))
    z = start
    for i in range(len(plan.step)):
        z = weights.decay[i] * z + growth[i]
        states[i] = z
    return states


def traced_run(
    rates: Float[Array, " m"],
    drive: Float[Array, "m k"],
    start: Float[Array, " m"],
    plan: Schedule,
    amplitudes: Float[Array, "q k"],
) -> tuple[Float[Array, "t m"], Float[Array, "t k"]]:
    """State and loads at the saved times, as a function that JAX can transform."""
    u0, u1 = plan.loads(jnp, amplitudes)
    # One step costs less than the dispatch of its products: all are made at once.
    d0 = product(u0, drive.T)
    d1 = product(u1, drive.T)
    step = jnp.asarray(plan.step, rates.dtype)[:, None]
    weights = step_weights(jnp, rates[None], step)
    growth = weights.constant * d0 + weights.ramp * (d1 - d0)

    def advance(z, row):
        decay, growth = row
        z = decay * z + growth
        return z, z

    _, states = jax.lax.scan(advance, start, (weights.decay, growth))
    saved = jnp.asarray(plan.saved)
    from_start = (saved < 0)[:, None]
    index = jnp.maximum(saved, 0)
    state = jnp.where(from_start, start[None], states[index])
    # No load has acted on the surface at the start.
    return state, jnp.where(from_start, 0, u1[index])


def doubled(times: Sequence[float]) -> tuple[float, ...]:
    """Knots at increasing times [s]: the inner ones occur twice, so loads may jump."""
    inner = [t for t in times[1:-1] for _ in range(2)]
    return (times[0], *inner, *times[-1:]) if len(times) > 1 else tuple(times)


def is_left(knots: Float[np.ndarray, " q"]) -> Bool[np.ndarray, " q"]:
    """True for knots that end an interval: the first of each pair, and the last."""
    following = np.append(knots[1:], knots[-1])
    return following == knots
