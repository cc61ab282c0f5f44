"""Collisions of the lattice Boltzmann flow and its tracer, in loops of numba.

All rows of all populations in one pass, in threads: `collided` and `collided_tracer`
of `lattice`.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..native.call import called
from .lattice import WEIGHTS, Populations, Rates


_FlowAndTracer = tuple[Populations, Populations]

# Constants of the equilibrium; the loops get them in the type of the populations.
_CONSTANTS = (WEIGHTS[0], WEIGHTS[1], WEIGHTS[5], 0.5, 1.0, 3.0, 4.5, 1.5)


def collided_into(
    target: Populations, read: Populations, rates: Rates, force: Any = None
) -> Populations:
    """`target` with the populations that arrive in its inner cells, after a collision.

    Populations have a frame of one cell; rates and force are those of `collided`.
    """
    numbers = _numbers(target[0].dtype, rates, force)
    loop = "flow_loops.collide"
    return tuple(called(loop, [*target], numbers, *read, *target, in_place=9))


def both_collided_into(
    target: _FlowAndTracer,
    read: _FlowAndTracer,
    rates: tuple[Rates, Rates],
    force: Any = None,
) -> _FlowAndTracer:
    """Collide a flow and its tracer in one call, see `collided_into`."""
    # In one call: XLA copies arrays that one reads and another fills in the next step.
    dtype = target[0][0].dtype
    flow_rates, tracer_rates = rates
    targets = [*target[0], *target[1]]
    out = called(
        "flow_loops.collide_both",
        targets,
        _numbers(dtype, flow_rates, force),
        _numbers(dtype, tracer_rates),
        *read[0],
        *read[1],
        *targets,
        in_place=18,
    )
    return tuple(out[:9]), tuple(out[9:])


def _numbers(dtype: Any, rates: Rates, force: Any = None) -> Float[Array, "12"]:
    values = (*rates, *(force or (0.0, 0.0)), *_CONSTANTS)
    return jnp.stack([jnp.asarray(value, dtype) for value in values])
