"""The zero of an increasing function of a temperature, at many nodes at once."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .network import inverse


_MAX_ITERATIONS = 40
"""Newton steps, or halvings of the bracket where these leave it or stay as long."""

_ROUNDINGS = 16.0
"""Roundings of the temperature that a last step may change it by."""


class Balance(NamedTuple):
    """An increasing function and its slope."""

    value: Float[Array, "*m"]
    slope: Float[Array, "*m"]


class _Search(NamedTuple):
    root: Float[Array, "*m"]
    low: Float[Array, "*m"]
    high: Float[Array, "*m"]
    change: Float[Array, "*m"]
    count: Int[Array, ""]


def increasing_root(
    function: Callable[[Float[Array, "*m"]], Balance],
    start: Float[Array, "*m"],
    low: Float[Array, "*m"],
    high: Float[Array, "*m"],
) -> Float[Array, "*m"]:
    """Return a point at which an increasing function is 0 to rounding, from a bracket.

    Newton's method, kept between the nearest points of either sign; the bracket may be
    infinite. The result has no derivative: a step of Newton's method from it has that
    of the solution. Nothing that the function uses may have a derivative either.
    """
    rounding = _ROUNDINGS * float(jnp.finfo(start.dtype).eps)

    def narrow(search: _Search) -> _Search:
        balance = function(search.root)
        low = jnp.where(balance.value < 0, search.root, search.low)
        high = jnp.where(balance.value > 0, search.root, search.high)
        newton = search.root - balance.value * inverse(balance.slope)
        halved = low + (high - low) / 2
        inside = (newton >= low) & (newton <= high)
        # Steps that do not become shorter may jump to and fro between the two ends.
        shorter = jnp.abs(newton - search.root) <= jnp.abs(search.change) / 2
        accepted = (inside & shorter) | ~jnp.isfinite(halved)
        root = jnp.where(accepted, newton, halved)
        return _Search(root, low, high, root - search.root, search.count + 1)

    def unfinished(search: _Search) -> Array:
        limit = rounding * (1 + jnp.abs(search.root))
        moves = (jnp.abs(search.change) > limit).any()
        return moves & (search.count < _MAX_ITERATIONS)

    first = _Search(
        root=start,
        low=jnp.broadcast_to(low, start.shape),
        high=jnp.broadcast_to(high, start.shape),
        change=jnp.full_like(start, jnp.inf),
        count=jnp.zeros((), jnp.int32),
    )
    return jax.lax.while_loop(unfinished, narrow, first).root
