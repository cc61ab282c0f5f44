"""Collisions of the lattice Boltzmann flow and its tracer, in loops of numba.

All rows of all populations in one pass, in threads: `collided` and `collided_tracer`
of `lattice`.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..native.call import called
from .lattice import WEIGHTS, Populations, Rates


# Constants of the equilibrium; the loops get them in the type of the populations.
_CONSTANTS = (WEIGHTS[0], WEIGHTS[1], WEIGHTS[5], 0.5, 1.0, 3.0, 4.5, 1.5)


def collided_into(
    target: Sequence[Populations],
    read: Sequence[Populations],
    rates: Sequence[Rates],
    force: Any = None,
) -> tuple[Populations, ...]:
    """`target` with the populations that arrive in its inner cells, after a collision.

    Args:
        target: arrays of a flow, and of its tracer if it has one, with a frame.
        read: populations before, likewise.
        rates: those of the flow and of the tracer.
        force: on the flow, see `collided`.
    """
    # In one call: XLA copies arrays that one reads and another fills in the next step.
    targets = list(chain(*target))
    dtype = targets[0].dtype
    numbers = [_numbers(dtype, rates[0], force)]
    numbers += [_numbers(dtype, tracer_rates) for tracer_rates in rates[1:]]
    loop = "flow_loops.collide_both" if rates[1:] else "flow_loops.collide"
    out = called(
        loop, targets, *numbers, *chain(*read), *targets, in_place=len(targets)
    )
    return tuple(tuple(out[n : n + 9]) for n in range(0, len(out), 9))


def _numbers(dtype: Any, rates: Rates, force: Any = None) -> Float[Array, "12"]:
    values = (*rates, *(force or (0.0, 0.0)), *_CONSTANTS)
    return jnp.stack([jnp.asarray(value, dtype) for value in values])
