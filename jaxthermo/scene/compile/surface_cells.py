"""Surface cells: fragments of one node on which the same terms act, as one.

The layout follows from geometry and from where terms act, and is found once for all
runs.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from ...arrays import Time, device_array, members
from ...findings import digest
from ...module import Module
from ...network.network import Address, inverse, slot_sums
from ...parallel.lattice import (
    Sectioned,
    gathered,
    on_each_device,
    section_numbers,
    with_added,
    within_section,
)
from ...voxels.sharded_lattice import padded_places
from .bodies import PreparedBody, capacity_at


OneBody = Float[Array, "..."]
"""Temperatures of one body."""


class BodyCells(Module):
    """The surface cells of one body and their nodes.

    Fragments of one node on which the same terms act are one cell; a fragment on which
    nothing acts has none.
    """

    # Some cells at the end have no area: they make the number even (`_even_size`).
    # Cells are summed by gathering, and every node is then written once, which is
    # several times faster than adding to it in turn.

    body: int = eqx.field(static=True)
    address: Address
    """Position of the nodes that have cells, each once, in the order of the state."""
    capacity: Float[Array, "*m"]
    """Heat capacity of those nodes [J/K]; one number if all have the same."""
    node: Int[Array, " p"]
    """Index of each cell's node among them."""
    slots: tuple[Int[Array, " m"], ...]
    """Index of each node's k-th cell; where it has fewer, one without area or none."""
    conductivity_parts: Float[Array, "q p"] | None = None
    """Fractions of each cell's conductivity by material and axis, where one of several
    varies with temperature."""
    mesh: Mesh | None = eqx.field(static=True, default=None)
    """Devices of the body; each has the nodes and cells of its own section, one after
    the other in all lists. None for one device."""

    def nodes_of(self, state: OneBody) -> Float[Array, " m"]:
        """Values of a state at the nodes."""
        return gathered(self.mesh, state, self.address)

    def cells_of(self, nodes: Float[Array, " m"]) -> Float[Array, " p"]:
        """Values of the nodes at the cells."""
        return gathered(self.mesh, nodes, (self.node,))

    def sums(self, values: Float[Array, " p"]) -> Float[Array, " m"]:
        """Sums of the values of cells at the nodes."""
        if self.mesh is None:
            return slot_sums(values, self.slots)

        def own(number, given):
            values, slots = given.values
            within = lambda slot: within_section(number, (slot,), len(values))[0]
            return slot_sums(values, tuple(map(within, slots)))

        number, lists = section_numbers(self.mesh), Sectioned((values, self.slots))
        return on_each_device(self.mesh, own, number, lists)

    def add(self, new: OneBody, dt: Time, heat: Float[Array, " m"]) -> OneBody:
        """A state with the heat rates of the nodes [W] over `dt` [s]."""
        # The state stays three-dimensional here: flattening it for the scatter would
        # make XLA compute the whole stencil with flat indices, slowly.
        return with_added(
            self.mesh, values=new, address=self.address, more=dt * heat / self.capacity
        )


def _even_size(count: int) -> int:
    """The next size that threads share evenly, at most 1/16 or 16 larger."""
    # XLA checks the bounds of every element of a loop that its threads do not divide
    # evenly, and such a loop is not vectorized: several times slower.
    most = max(count // 16, 1)
    step = min(max(1 << (most.bit_length() - 1), 16), 1024)
    return -(-count // step) * step


def body_cells(
    body: PreparedBody,
    acts: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None = None,
) -> tuple[BodyCells | None, Int[np.ndarray, " s"]]:
    """The surface cells of a body, and the cell of each of its fragments or -1.

    Each term `acts` on fragments at any time; those of two groups share no cell.
    """
    if not any(each.any() for each in acts):
        return None, np.full(len(body.fragment_node), -1, np.int32)
    patterns = tuple(digest(each) for each in acts)
    by = "surface_cells", patterns, None if group is None else digest(group)
    layout = body.body.structure.found(by, lambda: _layout(body, acts, group))
    cells = BodyCells(
        body=body.number,
        address=layout.address,
        capacity=capacity_at(body.network, layout.address),
        node=layout.node,
        slots=layout.slots,
        conductivity_parts=_parts_of_cells(body, layout.cell, layout.node.shape[0]),
        mesh=body.network.mesh,
    )
    return cells, layout.cell


class _Layout(NamedTuple):
    """Surface cells of one body as far as geometry goes, see `BodyCells`."""

    address: Address
    node: Int[Array, " p"]
    slots: tuple[Int[Array, " m"], ...]
    cell: Int[np.ndarray, " s"]
    """Cell of each fragment, or -1."""


# Room for more cells than a body has, where runs before had them, by its fraction.
_MAX_ROOM = 0.25


def _shared_size(body: PreparedBody, terms: int, count: int) -> int:
    """A number of cells that runs before had, if it is little more than `count`."""
    # For another number, as where a source moved, all would be compiled again.
    sizes: dict[str, int] = body.body.structure.found(("cell_sizes", terms), dict)
    sizes["largest"] = largest = max(sizes.get("largest", 0), count)
    return largest if largest <= (1 + _MAX_ROOM) * count else count


def _layout(
    body: PreparedBody,
    acts: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None,
) -> _Layout:
    cell = np.full(len(body.fragment_node), -1, np.int32)
    signature = np.zeros(len(cell), np.int64) if group is None else group.astype(int)
    for each in acts:
        # Numbered again for each term, so that any number of terms fits.
        signature = np.unique(2 * signature + each, return_inverse=True)[1].reshape(-1)
    # A key per node and combination of terms; equal keys are one cell.
    touched = np.flatnonzero(np.any(acts, axis=0))
    nodes, node = np.unique(body.fragment_node[touched], return_inverse=True)
    address, place, per_section = body.section_places(nodes)
    signatures = signature.max() + 1
    key = place[node.reshape(-1)] * signatures + signature[touched]
    cells, inverse = np.unique(key, return_inverse=True)
    node = (cells // signatures).astype(np.int32)
    # One section, with all, where the body is on one device.
    sections = len(address[0]) // per_section
    size = lambda count: _shared_size(body, len(acts), _even_size(count))
    of_cell, count = padded_places(node // per_section, sections, size)
    cell[touched] = of_cell[inverse.reshape(-1)]
    every = np.repeat(per_section * np.arange(sections, dtype=np.int32), count)
    every[of_cell] = node
    past = np.append(of_cell, len(every)).astype(np.int32)
    return _Layout(
        address=address,
        node=device_array(every),
        slots=tuple(device_array(past[s]) for s in members(node, len(address[0]))),
        cell=cell,
    )


def _parts_of_cells(
    body: PreparedBody, cell: Int[np.ndarray, " s"], count: int
) -> Float[Array, "q p"] | None:
    """Means over the fragments of each cell, weighted by their half cells."""
    if body.conductivity_parts is None:
        return None
    kept = np.flatnonzero(cell >= 0)
    half = jnp.asarray(body.half_cell)[kept]
    sums = lambda values: jax.ops.segment_sum(values, cell[kept], count)
    whole = inverse(sums(half))
    rows = body.conductivity_parts[:, kept] * half[None]
    return jnp.stack([sums(row) * whole for row in rows])
