"""Arrays of a sharded lattice, and the exchange of planes between its devices.

A state is sharded along its first axis: each device has one section of the body with an
empty cell around it. The temperatures of the planes beyond, those of the neighbouring
sections, are sent by `ppermute` and never stored.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Int, Shaped

from ..arrays import added, taken
from .devices import AXIS


SPREAD, SAME = PartitionSpec(AXIS), PartitionSpec()
"""Sharding of arrays along their first axis, and in whole on every device."""

_Address = tuple[Int[Array, " m"], ...]


class Sectioned(NamedTuple):
    """Arrays of any number of axes that are sharded along the first, as lattices are.

    Such as lists that have those of every section one after the other, all equally
    long.
    """

    values: Any


def _specs(tree: Any) -> Any:
    """Lattices are sharded along their first axis, and all else is on every device."""
    is_list = lambda node: isinstance(node, Sectioned)

    def spec(node: Any) -> Any:
        if is_list(node):
            return Sectioned(SPREAD)
        return SPREAD if jnp.ndim(node) == 3 else SAME

    return jax.tree.map(spec, tree, is_leaf=is_list)


def on_each_device(
    mesh: Mesh,
    function: Callable[..., Any],
    *arguments: Any,
    reduced: Callable[[Any, str], Any] | None = None,
) -> Any:
    """Call a function with each device's part of the lattices in its arguments.

    It returns lattices or lists of sections; with `reduced`, such as `jax.lax.psum`,
    values that are reduced over the devices.
    """

    def own(*local):
        found = function(*local)
        return found if reduced is None else reduced(found, AXIS)

    return jax.shard_map(
        own,
        mesh=mesh,
        in_specs=tuple(map(_specs, arguments)),
        out_specs=SPREAD if reduced is None else SAME,
        check_vma=False,
    )(*arguments)


def gathered(
    mesh: Mesh | None, values: Shaped[Array, "..."], address: _Address
) -> Shaped[Array, " m"]:
    """Values at an address; on several devices without any exchange.

    There the address has as many places for each device, all in its own part.
    """
    if mesh is None:
        return taken(values, address)

    def own(number, values, given):
        within = within_section(number, given.values, len(values.values))
        return taken(values.values, within)

    number = section_numbers(mesh)
    return on_each_device(mesh, own, number, Sectioned(values), Sectioned(address))


def with_added(
    mesh: Mesh | None,
    values: Shaped[Array, "..."],
    address: _Address,
    more: Shaped[Array, " m"],
) -> Shaped[Array, "..."]:
    """Values with more at an address, which is in order, as of `gathered`."""
    if mesh is None:
        return added(values, address, more, is_sorted=True, is_unique=True)

    def own(number, values, given):
        address, more = given.values
        within = within_section(number, address, len(values))
        # Places that fill up a section's list are one.
        return added(values, within, more, is_sorted=True)

    number = section_numbers(mesh)
    return on_each_device(mesh, own, number, values, Sectioned((address, more)))


def section_numbers(mesh: Mesh) -> Sectioned:
    """Number of each section, for `within_section`."""
    # `axis_index` is evaluated outside of the section where constants are folded.
    return Sectioned(jnp.arange(mesh.size))


def within_section(number: Sectioned, address: _Address, length: int) -> _Address:
    """An address in a device's own part of an array, from that in the whole array.

    For functions of `on_each_device`; each part has this length.
    """
    first, *others = address
    return first - number.values * length, *others


def next_planes(state: Shaped[Array, "x y z"]) -> Shaped[Array, "2 y z"]:
    """The planes of the neighbours that are next to a device's section.

    For functions of `on_each_device`; 0 at the ends of the body.
    """
    count = jax.lax.axis_size(AXIS)
    up = [(n, n + 1) for n in range(count - 1)]
    down = [(n + 1, n) for n in range(count - 1)]
    before = jax.lax.ppermute(state[-2], AXIS, up)
    behind = jax.lax.ppermute(state[1], AXIS, down)
    return jnp.stack([before, behind])


def with_planes(
    values: Shaped[Array, "x y z"], depth: int, planes: Shaped[Array, "2 y z"]
) -> Shaped[Array, "x y z"]:
    """A section with other values in the planes at a depth from both ends."""
    # Written together: one after the other, XLA copies the lattice at every step, as
    # the second plane might be read after the first is written.
    at = jnp.array([depth, values.shape[0] - 1 - depth])
    return values.at[at].set(
        planes,
        mode="promise_in_bounds",
        wrap_negative_indices=False,
        unique_indices=True,
    )


def from_sections(mesh: Mesh, make: Callable[[int], Any]) -> Any:
    """Lattices of the sections that `make` returns by their number, in a pytree.

    Only those of this process's own devices are made.
    """
    own: list[Any] = []
    for number, device in enumerate(mesh.devices.flat):
        if device.process_index == jax.process_index():
            own.append(jax.device_put(make(number), device))
    sharding = NamedSharding(mesh, SPREAD)

    def join(*parts: Array) -> Array:
        shape = mesh.size * parts[0].shape[0], *parts[0].shape[1:]
        made = list(parts)
        return jax.make_array_from_single_device_arrays(shape, sharding, made)

    return jax.tree.map(join, *own)


def spread(
    mesh: Mesh, values: Shaped[Array | np.ndarray, "x y z"]
) -> Shaped[Array, "x y z"]:
    """A new array of a lattice, of which each device has its own section."""
    sharding = NamedSharding(mesh, SPREAD)
    if isinstance(values, np.ndarray) and not any(values.strides):
        # One number for all: the host would have an array of them, too.
        return jnp.full(values.shape, values.item(0), values.dtype, device=sharding)
    host = np.asarray(values)
    return jax.make_array_from_callback(host.shape, sharding, lambda at: host[at])


def own_sections(
    mesh: Mesh, state: Shaped[Array, "x y z"]
) -> tuple[Shaped[np.ndarray, "a y z"], range]:
    """The sections of this process on the host, one after the other, and their numbers.

    Its devices follow one another.
    """
    thickness = state.shape[0] // mesh.size
    by_number = {
        shard.index[0].indices(state.shape[0])[0] // thickness: shard
        for shard in state.addressable_shards
    }
    own = sorted(by_number)
    parts = [np.asarray(by_number[number].data) for number in own]
    return np.concatenate(parts), range(own[0], own[-1] + 1)


def replicated(mesh: Mesh | None, tree: Any) -> Any:
    """Within a compiled function: its values in whole on every device."""
    if mesh is None:
        return tree
    sharding = NamedSharding(mesh, SAME)
    return jax.tree.map(
        lambda leaf: jax.lax.with_sharding_constraint(leaf, sharding), tree
    )


def own_copies(tree: Any) -> Any:
    """Values that every process has in whole, as arrays of this process alone.

    What follows on them is no computation that all processes must take part in.
    """
    if jax.process_count() == 1:
        return tree
    own = lambda leaf: jnp.asarray(np.asarray(leaf))
    return jax.tree.map(lambda x: own(x) if isinstance(x, jax.Array) else x, tree)


def placed(mesh: Mesh, tree: Any, lattices: frozenset[tuple[int, ...]]) -> Any:
    """A pytree on the devices of a mesh: arrays of the shapes `lattices` sharded.

    These are lattices, and lists of sections.

    Arrays that are there already stay; all others are on every device.
    """

    def place(leaf: Any) -> Any:
        if not isinstance(leaf, jax.Array | np.ndarray):
            return leaf
        there = isinstance(leaf, jax.Array) and len(leaf.sharding.device_set) > 1
        if there or leaf.ndim == 0:
            return leaf
        spec = SPREAD if leaf.shape in lattices else SAME
        host = np.asarray(leaf)
        sharding = NamedSharding(mesh, spec)
        return jax.make_array_from_callback(host.shape, sharding, lambda at: host[at])

    return jax.tree.map(place, tree)
