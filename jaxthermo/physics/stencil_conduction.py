"""Stencils of full volumes, from their grid and the properties of their materials."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from ..arrays import sorted_union
from ..network.cut_stencil import CutStencil
from ..network.link_operator import RowLayout, row_layout, row_network
from ..network.network import AbstractNetwork, Address, inverse
from ..network.sectioned_stencil import SectionedStencil
from ..network.sharded_stencil import ShardedStencil
from ..network.stencil import (
    HeterogeneousStencil,
    OrthotropicStencil,
    UniformStencil,
    solid_degree,
)
from ..parallel.devices import mesh_of
from ..parallel.lattice import from_sections
from ..structures.kinds.full import FullVolume
from ..voxels.cut_voxels import CutVoxels
from ..voxels.packed_lattice import PackedLattice
from ..voxels.sharded_lattice import ShardedLattice


@partial(jax.jit, inline=True)
def series(
    area: Float[np.ndarray | Array, "*e"],
    length1: Float[np.ndarray | Array, "*e"],
    k1: Float[Array, "*#e"],
    length2: Float[np.ndarray | Array, "*e"],
    k2: Float[Array, "*#e"],
) -> Float[Array, "*e"]:
    """Conductance of two lengths [m] in series [W/K]; 0 if either conductivity is 0."""
    # Exact in one dimension, where the arithmetic mean of conductivities is wrong by up
    # to their ratio. This form needs no division by a conductivity, which may be 0.
    dtype = k1.dtype
    a, l1, l2 = (jnp.asarray(v, dtype) for v in (area, length1, length2))
    return a * k1 * k2 * inverse(l1 * k2 + l2 * k1)


def uniform_stencil(
    structure: FullVolume, conductivity: Array, heat: Array
) -> AbstractNetwork:
    """Stencil of one material, with one conductivity [W/(m K)] or three along the axes.

    The heat capacity rho c_p is in J/(m^3 K).
    """
    if structure.sharded is not None:
        whole = _sharded_uniform(structure, structure.sharded, conductivity, heat)
        return _with_cut_voxels(whole, structure, None, conductivity[None], heat[None])
    grid, packed, three = structure.grid, structure.packed, bool(conductivity.ndim)
    stencil, bits = (OrthotropicStencil, 2) if three else (UniformStencil, 0)
    axes = (0, 1, 2) if packed is None else packed.axes
    conductance = conductivity * grid.pitch
    whole = stencil(
        heat * grid.voxel_volume,
        structure.node_count,
        structure.found(
            ("solid_degree", bits, packed is None),
            lambda: jnp.asarray(solid_degree(_of_lattice(grid.solid, packed), bits)),
        ),
        conductance[np.array(axes)] if three else conductance,
    )
    if packed is not None:
        across = conductance[packed.axes[0]] if three else conductance
        whole = SectionedStencil(whole, *_cut_pairs(structure, packed), across)
    return _with_cut_voxels(whole, structure, None, conductivity[None], heat[None])


def mixed_stencil(
    structure: FullVolume,
    material: Int[np.ndarray, " n"],
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> AbstractNetwork:
    """Stencil of several materials, numbered by node, with properties of each.

    Conductivities [W/(m K)] and heat capacities rho c_p [J/(m^3 K)].
    """
    grid, packed = structure.grid, structure.packed
    number = np.zeros(grid.solid.shape, np.int32)
    number[grid.solid] = material
    sizes = grid.pitch / 2, grid.pitch**2, grid.voxel_volume
    if structure.sharded is not None:
        whole = _sharded_mixed(
            structure.sharded, grid.solid, number, (conductivity, heat), sizes
        )
        return _with_cut_voxels(whole, structure, number, conductivity, heat)
    solid, own = (_of_lattice(values, packed) for values in (grid.solid, number))
    axes = (0, 1, 2) if packed is None else packed.axes
    by_axis = (
        conductivity[:, np.array(axes)] if conductivity.ndim == 2 else conductivity
    )
    whole = _stencil_arrays(solid, own, by_axis, heat, sizes)
    if packed is not None:
        at = _cut_pairs(structure, packed)
        ends = tuple(own[tuple(np.asarray(i) - 1 for i in address)] for address in at)
        across = by_axis[:, 0] if by_axis.ndim == 2 else by_axis
        whole = SectionedStencil(whole, *at, _between(across, ends, sizes))
    return _with_cut_voxels(whole, structure, number, conductivity, heat)


def _sharded_uniform(
    structure: FullVolume, lattice: ShardedLattice, conductivity: Array, heat: Array
) -> ShardedStencil:
    """Stencil of one material with a section on each of several devices."""
    grid, three, mesh = structure.grid, bool(conductivity.ndim), mesh_of(lattice.count)
    stencil, bits = (OrthotropicStencil, 2) if three else (UniformStencil, 0)

    def section(n: int) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        solid = lattice.section(grid.solid, n)
        return solid_degree(solid, bits)[1:-1], (solid[:1], solid[-1:])

    by, layout = ("sharded_degree", bits), lambda: from_sections(mesh, section)
    degree, beyond = structure.found(by, layout)
    conductance = conductivity * grid.pitch
    if three:
        conductance = conductance[np.array(lattice.axes)]
    capacity = heat * grid.voxel_volume
    base = stencil(capacity, structure.node_count, degree, conductance, beyond)
    return ShardedStencil(base, mesh)


def _sharded_mixed(
    lattice: ShardedLattice,
    solid: Shaped[np.ndarray, "x y z"],
    number: Shaped[np.ndarray, "x y z"],
    properties: tuple[Array, Array],
    sizes: tuple[float, float, float],
) -> ShardedStencil:
    """Stencil of several materials with a section on each of several devices."""
    conductivity, heat = properties
    mesh, along = mesh_of(lattice.count), np.array(lattice.axes)
    by_axis = conductivity[:, along] if conductivity.ndim == 2 else conductivity

    def section(n: int) -> HeterogeneousStencil:
        own, of = lattice.section(solid, n), lattice.section(number, n)
        whole = _stencil_arrays(own, of, by_axis, heat, sizes)
        # Less the planes of the neighbours, which give its outer faces.
        return jax.tree.map(lambda values: values[1:-1], whole)

    return ShardedStencil(from_sections(mesh, section), mesh)


def _of_lattice(
    values: Shaped[np.ndarray, "x y z"], packed: PackedLattice | None
) -> Shaped[np.ndarray, "a b c"]:
    return values if packed is None else packed.packed(values)


def _cut_pairs(structure: FullVolume, packed: PackedLattice) -> tuple[Address, Address]:
    """Position of the voxels before and behind the cuts between sections."""

    def find() -> tuple[Address, Address]:
        pairs = packed.cut_pairs(structure.grid.solid)
        before, behind = (structure.address_of_voxels(each) for each in pairs)
        # In the order of the state, in which they are read.
        order = np.lexsort(before[::-1])
        sort = lambda address: tuple(jnp.asarray(index[order]) for index in address)
        return sort(before), sort(behind)

    return structure.found("cut_pairs", find)


@jax.jit
def _between(
    k: Float[Array, " c"], ends: tuple[Int[Array, " p"], Int[Array, " p"]], sizes
) -> Float[Array, " p"]:
    """Conductance of faces between voxels of these materials [W/K]."""
    half, area, _ = sizes
    lengths, areas = (jnp.full(ends[0].shape, v, k.dtype) for v in (half, area))
    return series(areas, lengths, k[ends[0]], lengths, k[ends[1]])


def _with_cut_voxels(
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
        address=tuple(map(jnp.asarray, structure.address_of_voxels(voxel))),
        volume=jnp.asarray(structure.grid.volume_at(voxel)),
        rows=jax.tree.map(jnp.asarray, row_layout(len(voxel), src, dst)),
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


@jax.jit
def _stencil_arrays(solid, number, conductivity, heat, sizes) -> HeterogeneousStencil:
    (half, area, volume), dtype = sizes, conductivity.dtype
    by_axis = conductivity[number]
    faces = []
    for axis in range(3):
        k = by_axis[..., axis] if by_axis.ndim == 4 else by_axis
        k = jnp.where(solid, k, 0)
        before, after = [slice(None)] * 3, [slice(None)] * 3
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        first, second = k[tuple(before)], k[tuple(after)]
        lengths, areas = (jnp.full(first.shape, v, dtype) for v in (half, area))
        outer = [(0, 0)] * 3
        outer[axis] = (1, 1)
        faces.append(jnp.pad(series(areas, lengths, first, lengths, second), outer))
    return HeterogeneousStencil(
        face_conductance=(faces[0], faces[1], faces[2]),
        cell_capacity=jnp.where(solid, heat[number] * volume, 0),
    )
