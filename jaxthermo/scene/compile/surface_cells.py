"""Surface cells: fragments of one node on which the same terms act.

Their layout depends on geometry and on where terms act, and is computed once for all
runs.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from ...arrays import Time, device_array, members
from ...memo.found import digest
from ...network.network import Address, inverse, precise_sum, slot_sums
from ...network.segment_sums import SegmentSums, sums_of_sizes
from ...parallel.lattice import (
    Sectioned,
    gathered,
    on_each_device,
    section_numbers,
    with_added,
    within_section,
)
from ...voxels.sharded_lattice import padded_places
from .bodies import PreparedGroup, capacity_at


OneBody = Float[Array, "..."]
"""Temperatures of one body."""


class CellMembers(Module):
    """Surface cells of several bodies that conduct as one network."""

    of_cell: Int[Array, " p"]
    """Index of the body of each cell in the group."""
    sums: SegmentSums
    """Sums over the cells of each body that has some."""


class BodyCells(Module):
    """The surface cells of one body, or of a group of bodies, and their nodes.

    Fragments of one node on which the same terms act are one cell; a fragment on which
    nothing acts has none.
    """

    # Some cells at the end have no area: they make the number even (`_even_size`).
    # Cells are summed by gathering, and every node is then written once, which is
    # faster than adding one cell after the other.

    body: int = eqx.field(static=True)
    """Number of the group in the program."""
    numbers: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the bodies in the scene that have cells."""
    sizes: tuple[int, ...] = eqx.field(static=True)
    """Number of cells of each of these bodies."""
    address: Address
    """Position of the nodes that have cells, each once, in the order of the state."""
    capacity: Float[Array, "*m"]
    """Heat capacity of the nodes with cells [J/K]; one number if all have the same."""
    node: Int[Array, " p"]
    """Index of each cell's node among the nodes with cells."""
    slots: tuple[Int[Array, " m"], ...]
    """Index of each node's k-th cell. Where a node has fewer, the index of a cell
    without area, or one past the last cell."""
    members: CellMembers | None = None
    """None for one body."""
    conductivity_parts: Float[Array, "q p"] | None = None
    """Fractions of each cell's conductivity by material and axis, where one of several
    varies with temperature."""
    mesh: Mesh | None = eqx.field(static=True, default=None)
    """Devices of the body, each with the nodes and cells of one section; in all lists
    sections follow one another. None for one device."""

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

        def section_sums(number, lists):
            values, slots = lists.values
            slots = [within_section(number, (slot,), len(values))[0] for slot in slots]
            return slot_sums(values, tuple(slots))

        return on_each_device(
            self.mesh,
            section_sums,
            section_numbers(self.mesh),
            Sectioned((values, self.slots)),
        )

    def totals(self, values: Float[Array, " p"]) -> Float[Array, " b"]:
        """Sums of the values of all cells of each of these bodies."""
        if self.members is None:
            return precise_sum(values)[None]
        return self.members.sums(values)

    def reference(self, references: Float[Any, "*b"]) -> Float[Any, "*p"]:
        """Reference of each cell, from those of all bodies of the group [K]."""
        if self.members is None or not np.ndim(references):
            return references
        return references[self.members.of_cell]

    def add(self, new: OneBody, dt: Time, heat: Float[Array, " m"]) -> OneBody:
        """A state with the heat rates of the nodes [W] over `dt` [s]."""
        # The state stays three-dimensional here: flattening it for the scatter would
        # make XLA compute the whole stencil with flat indices, slowly.
        return with_added(
            self.mesh,
            values=new,
            address=self.address,
            increments=dt * heat / self.capacity,
        )


def _even_size(count: int) -> int:
    """The next size that threads share evenly, at most 1/16 or 16 larger."""
    # XLA checks the bounds of every element of a loop that its threads do not divide
    # evenly, and does not vectorize such a loop.
    max_excess = max(count // 16, 1)
    step = min(max(1 << (max_excess.bit_length() - 1), 16), 1024)
    return -(-count // step) * step


def body_cells(
    body: PreparedGroup,
    acting_fragments: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None = None,
) -> tuple[BodyCells | None, Int[np.ndarray, " s"]]:
    """The surface cells of a group, and the cell of each of its fragments or -1.

    Each term `acts` on fragments at any time; those of two groups share no cell.
    """
    if not any(mask.any() for mask in acting_fragments):
        return None, np.full(len(body.fragment_node), -1, np.int32)
    patterns = tuple(digest(mask) for mask in acting_fragments)
    layout = body.structure.found(
        ("surface_cells", patterns, None if group is None else digest(group)),
        lambda: _layout(body, acting_fragments, group),
    )
    used = np.flatnonzero(layout.sizes)
    cells = BodyCells(
        body=body.number,
        numbers=tuple(body.group.numbers[n] for n in used),
        sizes=tuple(layout.sizes[used].tolist()),
        members=layout.members,
        address=layout.address,
        capacity=capacity_at(body.network, layout.address),
        node=layout.node,
        slots=layout.slots,
        conductivity_parts=_parts_of_cells(body, layout.cell, layout.node.shape[0]),
        mesh=body.network.mesh,
    )
    return cells, layout.cell


class _Layout(NamedTuple):
    """Geometry of the surface cells of one body, see `BodyCells`."""

    address: Address
    node: Int[Array, " p"]
    slots: tuple[Int[Array, " m"], ...]
    cell: Int[np.ndarray, " s"]
    """Cell of each fragment, or -1."""
    sizes: Int[np.ndarray, " b"]
    """Number of cells of each body."""
    members: CellMembers | None
    """None for one body."""


_MAX_ROOM = 0.25
"""Largest fraction of empty cells that a body has because a previous run had more."""


def _shared_size(body: PreparedGroup, terms: int, count: int) -> int:
    """The number of cells of a previous run, if it is little more than `count`."""
    # Another number, as after a source moved, would need another compilation.
    sizes: dict[str, int] = body.structure.found(("cell_sizes", terms), dict)
    largest = max(sizes.get("largest", 0), count)
    sizes["largest"] = largest
    return largest if largest <= (1 + _MAX_ROOM) * count else count


def _layout(
    body: PreparedGroup,
    acting_fragments: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None,
) -> _Layout:
    cell = np.full(len(body.fragment_node), -1, np.int32)
    signature = np.zeros(len(cell), np.int64) if group is None else group.astype(int)
    for mask in acting_fragments:
        # Numbered again for each term, so that any number of terms fits.
        _, signature = np.unique(2 * signature + mask, return_inverse=True)
        signature = signature.reshape(-1)
    # A key per node and combination of terms; equal keys are one cell. The cells of one
    # body follow those of another, even where their nodes do not.
    touched = np.flatnonzero(np.any(acting_fragments, axis=0))
    nodes, node = np.unique(body.fragment_node[touched], return_inverse=True)
    sections = body.section_places(nodes)
    per_section = sections.per_section
    signatures = signature.max() + 1
    # A body on one device has one section.
    node_count = len(sections.address[0])
    place = sections.places[node.reshape(-1)].astype(np.int64)
    if not body.group.is_single:
        place += node_count * body.group.member_of_fragment[touched].astype(np.int64)
    key = place * signatures + signature[touched]
    cells, inverse = np.unique(key, return_inverse=True)
    place = cells // signatures
    node = (place % node_count).astype(np.int32)
    section_count = node_count // per_section

    def size(count: int) -> int:
        return _shared_size(body, len(acting_fragments), _even_size(count))

    of_cell, count = padded_places(node // per_section, section_count, size)
    cell[touched] = of_cell[inverse.reshape(-1)]
    cell_node = np.repeat(per_section * np.arange(section_count, dtype=np.int32), count)
    cell_node[of_cell] = node
    members_of_group, sizes = _members_of_cells(
        body, member=place // node_count, count=len(cell_node)
    )
    # Nodes with fewer cells than others refer to one past the last cell.
    slot_cell = np.append(of_cell, len(cell_node)).astype(np.int32)
    return _Layout(
        address=sections.address,
        node=device_array(cell_node),
        slots=tuple(
            device_array(slot_cell[slot]) for slot in members(node, node_count)
        ),
        cell=cell,
        sizes=sizes,
        members=members_of_group,
    )


def _members_of_cells(
    body: PreparedGroup, member: Int[np.ndarray, " p"], count: int
) -> tuple[CellMembers | None, Int[np.ndarray, " b"]]:
    """Bodies of the cells of a group, and the number of cells of each body.

    `member` is the index of the body of each cell, in their order; cells without area
    at the end belong to the last one.
    """
    if body.group.is_single:
        return None, np.array([count])
    member = np.append(member, np.full(count - len(member), member[-1]))
    sizes = np.bincount(member, minlength=len(body.group.numbers))
    return (
        CellMembers(
            of_cell=device_array(member.astype(np.int32)),
            sums=sums_of_sizes(sizes[sizes > 0].tolist()),
        ),
        sizes,
    )


def _parts_of_cells(
    body: PreparedGroup, cell: Int[np.ndarray, " s"], count: int
) -> Float[Array, "q p"] | None:
    """Means over the fragments of each cell, weighted by their half cells."""
    if body.conductivity_parts is None:
        return None
    fragments = np.flatnonzero(cell >= 0)
    half_cell = jnp.asarray(body.half_cell)[fragments]

    def sums(values):
        return jax.ops.segment_sum(values, cell[fragments], count)

    inverse_sum = inverse(sums(half_cell))
    rows = body.conductivity_parts[:, fragments] * half_cell[None]
    return jnp.stack([sums(row) * inverse_sum for row in rows])
