"""Exact steps of decoupled modes under loads that are linear between knots.

For dz/dt = -rate z + d(t) with d linear from d_0 to d_1 over a step, and h = rate step,

    z_1 = exp(-h) z_0 + step [phi_1(h) d_0 + phi_2(h) (d_1 - d_0)],
    phi_1 = (1 - exp(-h)) / h,    phi_2 = (1 - phi_1) / h.

A knot that is given twice is a jump of the load.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..arrays import product
from ..errors import InputError


# Below it the quotients lose digits, and the series has reached double precision.
_SERIES_LIMIT, _SERIES_TERMS = 0.3, 11

_Modes = Float[Array | np.ndarray, "*m"]


def step_weights(own: Any, rates: _Modes, step: Any) -> tuple[Any, Any, Any]:
    """exp(-h), step phi_1 and step phi_2, by numpy or jax.numpy as `own`."""
    h = rates * step
    is_small = own.abs(h) < _SERIES_LIMIT
    # Both branches are differentiated: neither may divide by 0.
    large, small = own.where(is_small, 1.0, h), own.where(is_small, h, 0.0)
    first, second = own.zeros_like(h), own.zeros_like(h)
    term = own.ones_like(h)
    for k in range(1, _SERIES_TERMS):
        term = term / k
        first = first + term
        second = second + term / (k + 1)
        term = term * -small
    by_quotient = -own.expm1(-large) / large
    phi_1 = own.where(is_small, first, by_quotient)
    phi_2 = own.where(is_small, second, (1 - by_quotient) / large)
    return own.exp(-h), step * phi_1, step * phi_2


class Schedule(NamedTuple):
    """Steps between knots and saved times."""

    step: Float[Array | np.ndarray, " i"]
    """Length of each step [s]."""
    knot: Int[Array | np.ndarray, " i"]
    """Knot at or before its start; the next one is at or after its end."""
    begin: Float[Array | np.ndarray, " i"]
    """Fraction of the way between the two knots at its start [-]."""
    end: Float[Array | np.ndarray, " i"]
    """The same at its end [-]."""
    saved: Int[Array | np.ndarray, " t"]
    """Step that ends at each saved time; -1 for the start."""

    def loads(self, own: Any, amplitudes: Any) -> tuple[Any, Any]:
        """Amplitudes at the start and at the end of every step."""
        before, after = amplitudes[self.knot], amplitudes[self.knot + 1]
        between = lambda f: (
            before + own.asarray(f, before.dtype)[:, None] * (after - before)
        )
        return between(self.begin), between(self.end)


def schedule(knots: Sequence[float], times: Sequence[float]) -> Schedule:
    """Divide the time between knots at the saved times.

    Args:
        knots: times between which loads are linear, from 0 on; twice for a jump [s].
        times: increasing times to save, within the knots [s].

    Raises:
        InputError: if a time is outside of the knots, or these decrease.
    """
    at, saves = np.asarray(knots, float), np.asarray(times, float)
    if len(at) < 1 or at[0] != 0 or (np.diff(at) < 0).any():
        raise InputError("reduced model: the knots start at 0 s and do not decrease")
    if len(saves) and not (saves[0] >= 0 and saves[-1] <= at[-1]):
        raise InputError(
            f"reduced model: save times lie between 0 and {at[-1]:g} s, the last knot"
        )
    rows, ends = [], []
    for knot, (a, b) in enumerate(zip(at[:-1], at[1:], strict=True)):
        if b <= a:
            continue
        inner = [t for t in saves if a < t < b]
        for t0, t1 in zip([a, *inner], [*inner, b], strict=True):
            rows.append((t1 - t0, knot, (t0 - a) / (b - a), (t1 - a) / (b - a)))
            ends.append(t1)
    step, knot, begin, end = np.array(rows).reshape(-1, 4).T
    # The load of a saved time is the one that has acted before it.
    found = [-1 if t == 0 else int(np.searchsorted(ends, t)) for t in saves]
    return Schedule(
        step=step,
        knot=knot.astype(int),
        begin=begin,
        end=end,
        saved=np.array(found, int),
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
    d0, d1 = u0 @ drive.T, u1 @ drive.T
    decay, of_start, of_change = step_weights(np, rates[None], plan.step[:, None])
    found, z = np.zeros((len(plan.step), len(rates))), start
    for i in range(len(plan.step)):
        z = decay[i] * z + of_start[i] * d0[i] + of_change[i] * (d1[i] - d0[i])
        found[i] = z
    return found


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
    d0, d1 = product(u0, drive.T), product(u1, drive.T)
    step = jnp.asarray(plan.step, rates.dtype)[:, None]
    decay, of_start, of_change = step_weights(jnp, rates[None], step)
    added = of_start * d0 + of_change * (d1 - d0)

    def advance(z, row):
        decay, added = row
        z = decay * z + added
        return z, z

    _, after = jax.lax.scan(advance, start, (decay, added))
    saved = jnp.asarray(plan.saved)
    from_start, index = (saved < 0)[:, None], jnp.maximum(saved, 0)
    state = jnp.where(from_start, start[None], after[index])
    # Nothing has acted on the surface at the start.
    return state, jnp.where(from_start, 0, u1[index])


def doubled(times: Sequence[float]) -> tuple[float, ...]:
    """Knots at increasing times, each but the first and the last twice [s]."""
    inner = [t for t in times[1:-1] for _ in range(2)]
    return (times[0], *inner, *times[-1:]) if len(times) > 1 else tuple(times)


def is_left(knots: Float[np.ndarray, " q"]) -> Bool[np.ndarray, " q"]:
    """True for the knots whose load is the one before them: of pairs, and the last."""
    following = np.append(knots[1:], knots[-1])
    return following == knots
