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


SPREAD = PartitionSpec(AXIS)
"""Sharding of arrays along their first axis."""
SAME = PartitionSpec()
"""Sharding of arrays that every device has in full."""

_Address = tuple[Int[Array, " m"], ...]


class Sectioned(NamedTuple):
    """Arrays of any number of axes that are sharded along the first, as lattices are.

    Lists, for example, in which equally long parts of all sections follow one another.
    """

    values: Any


def _specs(tree: Any) -> Any:
    """Lattices are sharded along their first axis; every device has all else."""

    def spec(node: Any) -> Any:
        if isinstance(node, Sectioned):
            return Sectioned(SPREAD)
        return SPREAD if jnp.ndim(node) == 3 else SAME

    return jax.tree.map(spec, tree, is_leaf=lambda node: isinstance(node, Sectioned))


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

    def call(*local):
        results = function(*local)
        return results if reduced is None else reduced(results, AXIS)

    return jax.shard_map(
        call,
        mesh=mesh,
        in_specs=tuple(map(_specs, arguments)),
        out_specs=SPREAD if reduced is None else SAME,
        check_vma=False,
    )(*arguments)


def gathered(
    mesh: Mesh | None, values: Shaped[Array, "..."], address: _Address
) -> Shaped[Array, " m"]:
    """Values at an address.

    On several devices nothing is exchanged: the address has an equal number of places
    for each device, all in the part of that device.
    """
    if mesh is None:
        return taken(values, address)

    def section_values(number, values, address):
        within = within_section(number, address.values, len(values.values))
        return taken(values.values, within)

    return on_each_device(
        mesh,
        section_values,
        section_numbers(mesh),
        Sectioned(values),
        Sectioned(address),
    )


def with_added(
    mesh: Mesh | None,
    values: Shaped[Array, "..."],
    address: _Address,
    increments: Shaped[Array, " m"],
) -> Shaped[Array, "..."]:
    """Values with increments at an address, which is sorted; see `gathered`."""
    if mesh is None:
        return added(values, address, increments, is_sorted=True, is_unique=True)

    def with_section_added(number, values, lists):
        address, increments = lists.values
        within = within_section(number, address, len(values))
        # The places that pad a section's list are all the same.
        return added(values, within, increments, is_sorted=True)

    return on_each_device(
        mesh,
        with_section_added,
        section_numbers(mesh),
        values,
        Sectioned((address, increments)),
    )


def section_numbers(mesh: Mesh) -> Sectioned:
    """Number of each section, for `within_section`."""
    # `axis_index` is evaluated outside of the section where constants are folded.
    return Sectioned(jnp.arange(mesh.size))


def within_section(number: Sectioned, address: _Address, length: int) -> _Address:
    """An address in the device's part of an array, from that in the full array.

    For functions of `on_each_device`; each part has this length.
    """
    return address[0] - number.values * length, *address[1:]


def next_planes(state: Shaped[Array, "x y z"]) -> Shaped[Array, "2 y z"]:
    """The planes of the neighbours that are next to a device's section.

    For functions of `on_each_device`; 0 at the ends of the body.
    """
    count = jax.lax.axis_size(AXIS)
    up = [(n, n + 1) for n in range(count - 1)]
    down = [(n + 1, n) for n in range(count - 1)]
    from_lower = jax.lax.ppermute(state[-2], AXIS, up)
    from_upper = jax.lax.ppermute(state[1], AXIS, down)
    return jnp.stack([from_lower, from_upper])


def with_planes(
    values: Shaped[Array, "x y z"], depth: int, planes: Shaped[Array, "2 y z"]
) -> Shaped[Array, "x y z"]:
    """A section with other values in the planes at a depth from both ends."""
    # Written together: one after the other, XLA copies the lattice at every step, as
    # the second plane might be read after the first is written.
    index = jnp.array([depth, values.shape[0] - 1 - depth])
    return values.at[index].set(
        planes,
        mode="promise_in_bounds",
        wrap_negative_indices=False,
        unique_indices=True,
    )


def from_sections(mesh: Mesh, make: Callable[[int], Any]) -> Any:
    """Lattices of the sections that `make` returns by their number, in a pytree.

    Only those of this process's own devices are made.
    """
    local_sections: list[Any] = []
    for number, device in enumerate(mesh.devices.flat):
        if device.process_index == jax.process_index():
            local_sections.append(jax.device_put(make(number), device))
    sharding = NamedSharding(mesh, SPREAD)

    def join(*sections: Array) -> Array:
        shape = mesh.size * sections[0].shape[0], *sections[0].shape[1:]
        arrays = list(sections)
        return jax.make_array_from_single_device_arrays(shape, sharding, arrays)

    return jax.tree.map(join, *local_sections)


def spread(
    mesh: Mesh, values: Shaped[Array | np.ndarray, "x y z"]
) -> Shaped[Array, "x y z"]:
    """A new array of a lattice, with a section on each device."""
    sharding = NamedSharding(mesh, SPREAD)
    if isinstance(values, np.ndarray) and not any(values.strides):
        # A uniform lattice needs no array on the host.
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
    numbers = sorted(by_number)
    sections = [np.asarray(by_number[number].data) for number in numbers]
    return np.concatenate(sections), range(numbers[0], numbers[-1] + 1)


def replicated(mesh: Mesh | None, tree: Any) -> Any:
    """Within a compiled function: full copies of its values on every device."""
    if mesh is None:
        return tree
    sharding = NamedSharding(mesh, SAME)
    return jax.tree.map(
        lambda leaf: jax.lax.with_sharding_constraint(leaf, sharding), tree
    )


def own_copies(tree: Any) -> Any:
    """Values that every process has in full, as arrays of this process alone.

    Computations with them do not involve the other processes.
    """
    if jax.process_count() == 1:
        return tree
    return jax.tree.map(
        lambda leaf: (
            jnp.asarray(np.asarray(leaf)) if isinstance(leaf, jax.Array) else leaf
        ),
        tree,
    )


def placed(mesh: Mesh, tree: Any, lattices: frozenset[tuple[int, ...]]) -> Any:
    """A pytree on the devices of a mesh, with arrays of the shapes `lattices` sharded.

    These are lattices, and lists of sections. Other arrays are on every device; arrays
    that are spread over devices already stay as they are.
    """

    def place(leaf: Any) -> Any:
        if not isinstance(leaf, jax.Array | np.ndarray):
            return leaf
        is_spread = isinstance(leaf, jax.Array) and len(leaf.sharding.device_set) > 1
        if is_spread or leaf.ndim == 0:
            return leaf
        spec = SPREAD if leaf.shape in lattices else SAME
        host = np.asarray(leaf)
        sharding = NamedSharding(mesh, spec)
        return jax.make_array_from_callback(host.shape, sharding, lambda at: host[at])

    return jax.tree.map(place, tree)
