"""Conduction of a full volume's voxels that the surface cuts.

Their nodes are in the order of the state, so that those of one section of a body on
several devices follow one another.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import device_array, sorted_union
from ..module import replaced
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
    whole: AbstractNetwork,
    structure: FullVolume,
    number: Int[np.ndarray, "x y z"] | None,
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> AbstractNetwork:
    """A stencil with the capacities and links of the voxels that the surface cuts.

    `number` is that of the material of each voxel; None for the only one.
    """
    cut = structure.grid.cut
    if cut is None or cut.is_empty:
        return whole
    layout = structure.found("cut_layout", lambda: _cut_layout(structure, cut))
    materials = (np.int32(0),) * 3
    if number is not None:
        nodes = structure.found("cut_nodes", lambda: _cut_nodes(structure, cut))
        cells = cut.links.voxel, cut.links.voxel + cut.links.step, nodes
        materials = tuple(number[tuple(each.T)] for each in cells)
    conductance, capacity = _cut_values(
        conductivity,
        heat,
        materials,
        (cut.links.step, cut.links.extra, structure.grid.pitch),
        layout.volume,
    )
    if isinstance(whole, ShardedStencil):
        cuts = _section_cuts(
            structure, layout=layout, conductance=conductance, capacity=capacity
        )
        return replaced(whole, cuts=cuts)
    links = row_network(layout.rows, conductance, capacity)
    return CutStencil(base=whole, address=layout.address, links=links)


class _CutLayout(NamedTuple):
    """Cut voxels and their links as far as geometry goes."""

    address: Address
    """Position of the nodes in the state."""
    volume: Float[Array, " n"]
    """Volume of each node [m^3]."""
    rows: RowLayout
    """On the device, where programs share its arrays."""


def _cut_nodes(structure: FullVolume, cut: CutVoxels) -> Int[np.ndarray, "n 3"]:
    """Voxels that are cut or have changed links, in the order of the state."""
    ends, shape = cut.links.voxel, structure.grid.solid.shape
    flat = (_flat(each, shape) for each in (ends, ends + cut.links.step, cut.voxel))
    voxel = np.stack(np.unravel_index(sorted_union(*flat), shape), axis=1)
    if structure.packed is None and structure.sharded is None:
        return voxel
    return voxel[np.lexsort(structure.address_of_voxels(voxel)[::-1])]


def _cut_layout(structure: FullVolume, cut: CutVoxels) -> _CutLayout:
    voxel, shape = _cut_nodes(structure, cut), structure.grid.solid.shape
    flat = _flat(voxel, shape)
    order = np.argsort(flat, kind="stable")
    index_of = lambda end: order[np.searchsorted(flat[order], _flat(end, shape))]
    ends = cut.links.voxel, cut.links.voxel + cut.links.step
    src, dst = (np.asarray(index_of(end), np.int32) for end in ends)
    return _CutLayout(
        address=tuple(map(device_array, structure.address_of_voxels(voxel))),
        volume=device_array(structure.grid.volume_at(voxel)),
        rows=jax.tree.map(device_array, row_layout(len(voxel), src, dst)),
    )


def _flat(
    voxel: Int[np.ndarray, "m 3"], shape: tuple[int, ...]
) -> Int[np.ndarray, " m"]:
    return np.asarray(np.ravel_multi_index(tuple(voxel.T), shape))


# One program instead of twenty of single operations.
@jax.jit
def _cut_values(conductivity, heat, materials, links, volume) -> tuple[Array, Array]:
    """Conductances of links over k, and capacities of voxels, by their materials."""
    first, second, own = materials
    step, extra, pitch = links
    # Along a link over an edge, the mean along its two axes.
    along = jnp.abs(step).astype(conductivity.dtype)
    axes = along / along.sum(axis=1, keepdims=True)
    k = [conductivity[number] for number in (first, second)]
    if conductivity.ndim == 2:
        k = [(axes * each.reshape(-1, 3)).sum(axis=1) for each in k]
    # Of a section that is the extra times pitch times the length of the link.
    half = jnp.full(extra.shape, 0.5)
    conductance = series(extra * pitch, half, k[0], half, k[1])
    return conductance, heat[own] * volume.astype(heat.dtype)


class _Section(NamedTuple):
    """Cut voxels of one device's section, and those beside it that its links reach."""

    nodes: range
    """Its own nodes among all."""
    address: tuple[Int[np.ndarray, " p"], ...]
    """Position in its part of the state: of its own; of an empty cell, up to the number
    that every section has places for; of the nodes beside it, in the rim."""
    rows: RowLayout
    """Rows of all of these; only its own have links."""


def _section_cuts(
    structure: FullVolume,
    layout: _CutLayout,
    conductance: Float[Array, " e"],
    capacity: Float[Array, " n"],
) -> SectionCuts:
    """Cut voxels of the sections of a sharded body, those of each on its device."""
    lattice = structure.sharded
    assert lattice is not None
    count, sections = structure.found(
        "cut_sections", lambda: _sections(lattice, layout, len(conductance))
    )

    def cuts(number: int) -> tuple[tuple[np.ndarray, ...], RowNetwork]:
        own = sections[number]
        # Heat of no other node is stored here: an infinite capacity leaves it as it is.
        none = jnp.full(own.address[0].shape, jnp.inf, capacity.dtype)
        here = capacity[own.nodes.start : own.nodes.stop]
        whole = none.at[: len(here)].set(here)
        return own.address, row_network(own.rows, conductance, whole)

    address, links = from_sections(mesh_of(lattice.count), cuts)
    return SectionCuts(address, links, count)


def _sections(
    lattice: ShardedLattice, layout: _CutLayout, links: int
) -> tuple[int, list[_Section]]:
    """Cut voxels of every section, and the number that each has places for."""
    x, y, z = map(np.asarray, layout.address)
    every_row: RowLayout = jax.tree.map(np.asarray, layout.rows)
    length = lattice.thickness + 2
    ends = np.searchsorted(x // length, np.arange(lattice.count + 1)).tolist()
    own = [range(*ends[n : n + 2]) for n in range(lattice.count)]
    rows = [_rows_of(every_row, nodes) for nodes in own]
    beside = [_beside(*each) for each in zip(rows, own, strict=True)]
    count, listed = max(map(len, own)), max(len(each.list_node) for each in rows)
    total = count + max(map(len, beside))
    sections = []
    for number, nodes in enumerate(own):
        node = np.append(np.arange(nodes.start, nodes.stop), beside[number])
        place = np.append(np.arange(len(nodes)), count + np.arange(len(beside[number])))
        # Nodes beside the section are in its rim, in the first or in the last plane; so
        # is an empty cell for places that are left.
        along = np.clip(x[node] - number * length, 0, length - 1)
        address = [np.full(total, index, np.int32) for index in (length - 1, 0, 0)]
        for axis, index in enumerate((along, y[node], z[node])):
            address[axis][place] = index
        own_rows = _numbered(
            rows[number], node=node, place=place, sizes=(total, listed), links=links
        )
        sections.append(_Section(nodes, tuple(address), own_rows))
    return count, sections


def _rows_of(rows: RowLayout, nodes: range) -> RowLayout:
    """The rows of nodes that follow one another."""
    own = slice(nodes.start, nodes.stop)
    listed = slice(*np.searchsorted(rows.list_node, (nodes.start, nodes.stop)))
    return RowLayout(
        neighbour=tuple(each[own] for each in rows.neighbour),
        link=tuple(each[own] for each in rows.link),
        list_node=rows.list_node[listed],
        list_neighbour=rows.list_neighbour[listed],
        list_link=rows.list_link[listed],
    )


def _beside(rows: RowLayout, nodes: range) -> Int[np.ndarray, " g"]:
    """Nodes that are not among these, but in their rows, in order."""
    found = np.unique(np.concatenate([*rows.neighbour, rows.list_neighbour]))
    return found[(found < nodes.start) | (found >= nodes.stop)]


def _numbered(
    rows: RowLayout,
    node: Int[np.ndarray, " k"],
    place: Int[np.ndarray, " k"],
    sizes: tuple[int, int],
    links: int,
) -> RowLayout:
    """Rows of the first of some nodes, with the number of each replaced by its place.

    `sizes` are those of the rows and of the list; where they have more than there is,
    there is no link: the number of `links`.
    """
    order = np.argsort(node)
    numbered = lambda old: place[order[np.searchsorted(node, old, sorter=order)]]

    def filled(values: np.ndarray, rest: np.ndarray) -> Int[np.ndarray, " _"]:
        return np.append(values, rest[len(values) :]).astype(np.int32)

    own, last = np.arange(sizes[0]), np.full(sizes[1], sizes[0] - 1)
    none = np.full(max(sizes), links)
    return RowLayout(
        neighbour=tuple(filled(numbered(each), own) for each in rows.neighbour),
        link=tuple(filled(each, none[: sizes[0]]) for each in rows.link),
        list_node=filled(numbered(rows.list_node), last),
        list_neighbour=filled(numbered(rows.list_neighbour), last),
        list_link=filled(rows.list_link, none[: sizes[1]]),
    )
