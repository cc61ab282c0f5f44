"""Conduction of a full volume's voxels that the surface cuts.

Their nodes are in the order of the state, so that those of one section of a body on
several devices follow one another.
"""

import itertools
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import device_array, flat_index, sorted_union
from ..network.cut_stencil import CutStencil
from ..network.link_operator import (
    RowLayout,
    RowNetwork,
    row_layout,
    row_network,
    series,
)
from ..network.network import AbstractNetwork, Address
from ..network.sharded_stencil import SectionCuts, ShardedStencil
from ..parallel.devices import mesh_of
from ..parallel.lattice import from_sections
from ..structures.kinds.full import FullVolume
from ..voxels.cut_voxels import CutVoxels
from ..voxels.sharded_lattice import ShardedLattice


def with_cut_voxels(
    stencil: AbstractNetwork,
    structure: FullVolume,
    number: Int[np.ndarray, "x y z"] | None,
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> AbstractNetwork:
    """A stencil of whole voxels, corrected for the voxels that the surface cuts.

    `number` is the index of each voxel's material; None for one material.
    """
    cut = structure.grid.cut
    if cut is None or cut.is_empty:
        return stencil
    layout = structure.found("cut_layout", lambda: _cut_layout(structure, cut))
    if number is None:
        src = dst = node = np.int32(0)
    else:
        nodes = structure.found("cut_nodes", lambda: _cut_nodes(structure, cut))
        src = number[tuple(cut.links.voxel.T)]
        dst = number[tuple((cut.links.voxel + cut.links.step).T)]
        node = number[tuple(nodes.T)]
    conductance = _link_conductance(
        conductivity,
        src=src,
        dst=dst,
        step=cut.links.step,
        extra=cut.links.extra,
        pitch=structure.grid.pitch,
    )
    capacity = _cut_capacity(heat, node, layout.volume)
    if isinstance(stencil, ShardedStencil):
        cuts = _section_cuts(
            structure, layout=layout, conductance=conductance, capacity=capacity
        )
        return replace(stencil, cuts=cuts)
    links = row_network(layout.rows, conductance, capacity)
    return CutStencil(base=stencil, address=layout.address, links=links)


class _CutLayout(NamedTuple):
    """Geometry of the cut voxels and of their links."""

    address: Address
    """Position of the nodes in the state."""
    volume: Float[Array, " n"]
    """Volume of each node [m^3]."""
    rows: RowLayout
    """On the device, where programs share its arrays."""


def _cut_nodes(structure: FullVolume, cut: CutVoxels) -> Int[np.ndarray, "n 3"]:
    """Voxels that are cut or have changed links, in the order of the state."""
    shape = structure.grid.solid.shape
    union = sorted_union(
        flat_index(cut.links.voxel, shape),
        flat_index(cut.links.voxel + cut.links.step, shape),
        flat_index(cut.voxel, shape),
    )
    voxel = np.stack(np.unravel_index(union, shape), axis=1)
    if structure.sharded is None:
        return voxel
    return voxel[np.lexsort(structure.address_of_voxels(voxel)[::-1])]


def _cut_layout(structure: FullVolume, cut: CutVoxels) -> _CutLayout:
    voxel = _cut_nodes(structure, cut)
    shape = structure.grid.solid.shape
    flat = flat_index(voxel, shape)
    order = np.argsort(flat, kind="stable")

    def node_of(end: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
        index = order[np.searchsorted(flat[order], flat_index(end, shape))]
        return np.asarray(index, np.int32)

    src = node_of(cut.links.voxel)
    dst = node_of(cut.links.voxel + cut.links.step)
    return _CutLayout(
        address=tuple(map(device_array, structure.address_of_voxels(voxel))),
        volume=device_array(structure.grid.volume_at(voxel)),
        rows=jax.tree.map(device_array, row_layout(len(voxel), src, dst)),
    )


@jax.jit
def _cut_capacity(heat, material, volume) -> Float[Array, " n"]:
    """Heat capacities of voxels [J/K], by their materials."""
    return heat[material] * volume.astype(heat.dtype)


# One program, where single operations would be twenty.
@jax.jit
def _link_conductance(conductivity, src, dst, step, extra, pitch) -> Float[Array, " e"]:
    """Conductances of links [W/K], with the materials of both ends."""
    # Along a link over an edge, the mean along its two axes.
    along = jnp.abs(step).astype(conductivity.dtype)
    axes = along / along.sum(axis=1, keepdims=True)
    k = [conductivity[number] for number in (src, dst)]
    if conductivity.ndim == 2:
        k = [(axes * at_end.reshape(-1, 3)).sum(axis=1) for at_end in k]
    # The section of a link is extra times pitch times the length of the link.
    half = jnp.full(extra.shape, 0.5)
    return series(extra * pitch, length1=half, k1=k[0], length2=half, k2=k[1])


class _Section(NamedTuple):
    """Cut voxels of one device's section, and the adjacent nodes that they link to."""

    nodes: range
    """The section's own nodes among all."""
    address: tuple[Int[np.ndarray, " p"], ...]
    """Position in the section's state: of its own nodes; of an empty cell, as padding
    to the same number in all sections; of the adjacent nodes, in the rim."""
    rows: RowLayout
    """Rows of all these nodes, in which only the section's own have links."""


def _section_cuts(
    structure: FullVolume,
    layout: _CutLayout,
    conductance: Float[Array, " e"],
    capacity: Float[Array, " n"],
) -> SectionCuts:
    """Cut voxels of the sections of a sharded body, each section's on its device."""
    lattice = structure.sharded
    assert lattice is not None
    count, sections = structure.found(
        "cut_sections", lambda: _sections(lattice, layout, len(conductance))
    )

    def cuts(number: int) -> tuple[tuple[np.ndarray, ...], RowNetwork]:
        section = sections[number]
        # Adjacent nodes store their heat elsewhere: an infinite capacity leaves their
        # temperatures unchanged.
        padded = jnp.full(section.address[0].shape, jnp.inf, capacity.dtype)
        section_capacity = capacity[section.nodes.start : section.nodes.stop]
        padded = padded.at[: len(section_capacity)].set(section_capacity)
        return section.address, row_network(section.rows, conductance, padded)

    address, links = from_sections(mesh_of(lattice.count), cuts)
    return SectionCuts(address, links, count)


def _sections(
    lattice: ShardedLattice, layout: _CutLayout, links: int
) -> tuple[int, list[_Section]]:
    """Cut voxels of every section, and the largest number in one section."""
    x, y, z = map(np.asarray, layout.address)
    all_rows: RowLayout = jax.tree.map(np.asarray, layout.rows)
    length = lattice.thickness + 2
    ends = np.searchsorted(x // length, np.arange(lattice.count + 1)).tolist()
    ranges = list(itertools.starmap(range, itertools.pairwise(ends)))
    rows = [_rows_of(all_rows, nodes) for nodes in ranges]
    adjacent = [_adjacent(row, nodes) for row, nodes in zip(rows, ranges, strict=True)]
    count = max(map(len, ranges))
    total = count + max(map(len, adjacent))
    listed = max(len(row.list_node) for row in rows)
    sections = []
    for number, nodes in enumerate(ranges):
        outer = adjacent[number]
        node = np.append(np.arange(nodes.start, nodes.stop), outer)
        slot = np.append(np.arange(len(nodes)), count + np.arange(len(outer)))
        # Adjacent nodes are in the rim of the section, in its first or last plane; the
        # padding is an empty cell of the rim.
        along = np.clip(x[node] - number * length, 0, length - 1)
        address = [np.full(total, index, np.int32) for index in (length - 1, 0, 0)]
        for axis, index in enumerate((along, y[node], z[node])):
            address[axis][slot] = index
        section_rows = _numbered(
            rows[number], node=node, slot=slot, sizes=(total, listed), links=links
        )
        sections.append(
            _Section(nodes=nodes, address=tuple(address), rows=section_rows)
        )
    return count, sections


def _rows_of(rows: RowLayout, nodes: range) -> RowLayout:
    """Rows of consecutive nodes."""
    span = slice(nodes.start, nodes.stop)
    listed = slice(*np.searchsorted(rows.list_node, (nodes.start, nodes.stop)))
    return RowLayout(
        neighbour=tuple(column[span] for column in rows.neighbour),
        link=tuple(column[span] for column in rows.link),
        list_node=rows.list_node[listed],
        list_neighbour=rows.list_neighbour[listed],
        list_link=rows.list_link[listed],
    )


def _adjacent(rows: RowLayout, nodes: range) -> Int[np.ndarray, " g"]:
    """Neighbours of some nodes that are not among these, in order."""
    neighbours = np.unique(np.concatenate([*rows.neighbour, rows.list_neighbour]))
    return neighbours[(neighbours < nodes.start) | (neighbours >= nodes.stop)]


def _numbered(
    rows: RowLayout,
    node: Int[np.ndarray, " k"],
    slot: Int[np.ndarray, " k"],
    sizes: tuple[int, int],
    links: int,
) -> RowLayout:
    """Rows with the number of each node replaced by its slot, padded to a size.

    `sizes` are the numbers of rows and of entries in the list. Padding has no link,
    which is the number `links`.
    """
    order = np.argsort(node)
    row_count, list_count = sizes
    itself = np.arange(row_count)
    last = np.full(list_count, row_count - 1)
    no_link = np.full(row_count, links)
    no_listed_link = np.full(list_count, links)

    def slot_of(number: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        return slot[order[np.searchsorted(node, number, sorter=order)]]

    def padded(values: np.ndarray, padding: np.ndarray) -> Int[np.ndarray, " _"]:
        return np.append(values, padding[len(values) :]).astype(np.int32)

    return RowLayout(
        neighbour=tuple(padded(slot_of(column), itself) for column in rows.neighbour),
        link=tuple(padded(column, no_link) for column in rows.link),
        list_node=padded(slot_of(rows.list_node), last),
        list_neighbour=padded(slot_of(rows.list_neighbour), last),
        list_link=padded(rows.list_link, no_listed_link),
    )
