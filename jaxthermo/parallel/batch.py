"""Batches of runs that are independent of each other, over several devices.

Each device has an equal part of a batch. One that does not divide evenly is padded by
copies of its last member, the results of which are dropped.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding

from .devices import AXIS
from .lattice import SAME, SPREAD, replicated


def over_devices(
    mesh: Mesh | None,
    function: Callable[[Any, Any], tuple[Any, Any]],
    batch: Any,
    constants: Any,
) -> tuple[Any, Any]:
    """Call a function with each device's part of a batch, within a compiled function.

    Args:
        mesh: the devices; None for one, which has the whole batch.
        function: from a part of the batch and the constants to results whose first
            axis is that of the batch, and results that all of its members share.
        batch: arrays, their first axis that of the batch.
        constants: other arguments of the function, which must not close over arrays.

    Returns:
        The results of the batch, and those that are the same, on every device.
    """
    if mesh is None:
        return function(batch, constants)
    count = len(jax.tree.leaves(batch)[0])
    copies = -count % mesh.size
    arrays, static = eqx.partition(constants, eqx.is_array)

    def padded(leaf):
        return jnp.concatenate([leaf, jnp.repeat(leaf[-1:], copies, axis=0)])

    def call(batch, arrays):
        return function(batch, eqx.combine(arrays, static))

    results, shared = jax.shard_map(
        call,
        mesh=mesh,
        in_specs=(SPREAD, SAME),
        out_specs=(SPREAD, SAME),
        check_vma=False,
    )(jax.tree.map(padded, batch), arrays)
    results = jax.tree.map(lambda leaf: leaf[:count], results)
    return replicated(mesh, (results, shared))


def on_first_device(
    mesh: Mesh | None, function: Callable[[Any], Any], arguments: Any
) -> Any:
    """Call a function on the first device, within a compiled function.

    Other devices that share a processor with it would only slow it down. `function`
    returns arrays and must not close over any; the result is on every device.
    """
    if mesh is None:
        return function(arguments)
    arrays, static = eqx.partition(arguments, eqx.is_array)

    def call(arrays):
        return function(eqx.combine(arrays, static))

    def zeros(arrays):
        return jax.tree.map(
            lambda like: jnp.zeros(like.shape, like.dtype), jax.eval_shape(call, arrays)
        )

    def call_if_first(arrays):
        is_first = jax.lax.axis_index(AXIS) == 0
        result = jax.lax.cond(is_first, call, zeros, arrays)
        return jax.tree.map(lambda leaf: leaf[None], result)

    results = jax.shard_map(
        call_if_first, mesh=mesh, in_specs=SAME, out_specs=SPREAD, check_vma=False
    )(arrays)
    return jax.tree.map(lambda leaf: leaf[0], replicated(mesh, results))


def part_of(mesh: Mesh | None, count: int) -> int:
    """Number of members of a batch that a device has, with the padding."""
    return count if mesh is None else -(-count // mesh.size)


def on_every_device(mesh: Mesh | None, tree: Any) -> Any:
    """A pytree with its arrays in whole on every device; as it is for one."""
    if mesh is None:
        return tree
    sharding = NamedSharding(mesh, SAME)
    return jax.tree.map(
        lambda leaf: (
            jax.device_put(leaf, sharding) if isinstance(leaf, jax.Array) else leaf
        ),
        tree,
    )


def from_first_device(mesh: Mesh | None, tree: Any) -> Any:
    """Arrays that are in whole on every device, as those of the first."""
    if mesh is None:
        return tree
    return jax.tree.map(lambda leaf: leaf.addressable_data(0), tree)
