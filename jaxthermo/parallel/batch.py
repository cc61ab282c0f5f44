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
    given: Any,
) -> tuple[Any, Any]:
    """Call a function with each device's part of a batch, within a compiled function.

    Args:
        mesh: the devices; None for one, which has the whole batch.
        function: from a part of the batch and `given` to results whose first axis is
            that of the batch, and others that are the same for all of its members.
        batch: arrays, their first axis that of the batch.
        given: what the function needs besides; it must not close over arrays.

    Returns:
        The results of the batch, and those that are the same, on every device.
    """
    if mesh is None:
        return function(batch, given)
    count = len(jax.tree.leaves(batch)[0])
    copies = -count % mesh.size
    pad = lambda leaf: jnp.concatenate([leaf, jnp.repeat(leaf[-1:], copies, axis=0)])
    arrays, rest = eqx.partition(given, eqx.is_array)

    def own(batch, arrays):
        return function(batch, eqx.combine(arrays, rest))

    found, same = jax.shard_map(
        own,
        mesh=mesh,
        in_specs=(SPREAD, SAME),
        out_specs=(SPREAD, SAME),
        check_vma=False,
    )(jax.tree.map(pad, batch), arrays)
    return replicated(mesh, (jax.tree.map(lambda leaf: leaf[:count], found), same))


def on_first_device(
    mesh: Mesh | None, function: Callable[[Any], Any], given: Any
) -> Any:
    """Call a function on the first device, within a compiled function.

    Devices that are parts of one processor would compute the same beside it, and slow
    it down. `function` returns arrays and must not close over any; the result is on
    every device.
    """
    if mesh is None:
        return function(given)
    arrays, rest = eqx.partition(given, eqx.is_array)

    def own(arrays):
        call = lambda arrays: function(eqx.combine(arrays, rest))
        zeros = lambda _: jax.tree.map(
            lambda like: jnp.zeros(like.shape, like.dtype), jax.eval_shape(call, arrays)
        )
        is_first = jax.lax.axis_index(AXIS) == 0
        found = jax.lax.cond(is_first, call, zeros, arrays)
        return jax.tree.map(lambda leaf: leaf[None], found)

    found = jax.shard_map(
        own, mesh=mesh, in_specs=SAME, out_specs=SPREAD, check_vma=False
    )(arrays)
    return jax.tree.map(lambda leaf: leaf[0], replicated(mesh, found))


def part_of(mesh: Mesh | None, count: int) -> int:
    """Number of members of a batch that a device has, with the padding."""
    return count if mesh is None else -(-count // mesh.size)


def on_every_device(mesh: Mesh | None, tree: Any) -> Any:
    """A pytree with its arrays in whole on every device; as it is for one."""
    if mesh is None:
        return tree
    sharding = NamedSharding(mesh, SAME)
    place = lambda leaf: jax.device_put(leaf, sharding)
    return jax.tree.map(lambda x: place(x) if isinstance(x, jax.Array) else x, tree)


def from_first_device(mesh: Mesh | None, tree: Any) -> Any:
    """Arrays that are in whole on every device, as those of the first."""
    if mesh is None:
        return tree
    return jax.tree.map(lambda leaf: leaf.addressable_data(0), tree)
