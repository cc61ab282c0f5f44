"""Stencils of full volumes, from their grid and the properties of their materials."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import sorted_union
from ..findings import found
from ..network.cut_stencil import CutStencil
from ..network.link_operator import RowLayout, row_layout, row_network
from ..network.network import AbstractNetwork, Address, inverse
from ..network.stencil import (
    HeterogeneousStencil,
    OrthotropicStencil,
    UniformStencil,
    solid_degree,
)
from ..voxels.cut_voxels import CutVoxels
from ..voxels.grid import VoxelGrid


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
    grid: VoxelGrid, nodes: int, conductivity: Array, heat: Array
) -> AbstractNetwork:
    """Stencil of one material, with one conductivity [W/(m K)] or three along the axes.

    The heat capacity rho c_p is in J/(m^3 K).
    """
    three = bool(conductivity.ndim)
    stencil, bits = (OrthotropicStencil, 2) if three else (UniformStencil, 0)
    whole = stencil(
        heat * grid.voxel_volume,
        nodes,
        found(
            (grid,),
            ("solid_degree", bits),
            lambda: jnp.asarray(solid_degree(grid.solid, bits)),
        ),
        conductivity * grid.pitch,
    )
    if grid.cut is None or grid.cut.is_empty:
        return whole
    # Of one number: an array of them would be four times as large as the voxels.
    only = np.broadcast_to(np.int32(0), grid.solid.shape)
    return _with_cut_voxels(whole, grid, grid.cut, only, conductivity[None], heat[None])


def mixed_stencil(
    grid: VoxelGrid,
    material: Int[np.ndarray, " n"],
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> AbstractNetwork:
    """Stencil of several materials, numbered by node, with properties of each.

    Conductivities [W/(m K)] and heat capacities rho c_p [J/(m^3 K)].
    """
    number = np.zeros(grid.solid.shape, np.int32)
    number[grid.solid] = material
    sizes = grid.pitch / 2, grid.pitch**2, grid.voxel_volume
    whole = _stencil_arrays(grid.solid, number, conductivity, heat, sizes)
    if grid.cut is None or grid.cut.is_empty:
        return whole
    return _with_cut_voxels(whole, grid, grid.cut, number, conductivity, heat)


def _with_cut_voxels(
    whole: AbstractNetwork,
    grid: VoxelGrid,
    cut: CutVoxels,
    number: Int[np.ndarray, "x y z"],
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> CutStencil:
    """A stencil with the capacities and links of the voxels that the surface cuts.

    `number` is that of the material of each voxel.
    """
    layout = found((grid,), "cut_layout", lambda: _cut_layout(grid, cut))
    voxel = np.stack(layout.address, axis=1) - 1
    cells = cut.links.voxel, cut.links.voxel + cut.links.step, voxel
    conductance, capacity = _cut_values(
        conductivity,
        heat,
        [number[tuple(each.T)] for each in cells],
        (cut.links.step, cut.links.extra, grid.pitch),
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


def _cut_layout(grid: VoxelGrid, cut: CutVoxels) -> _CutLayout:
    links, shape = cut.links, grid.solid.shape
    ends = links.voxel, links.voxel + links.step
    place = lambda cell: np.asarray(np.ravel_multi_index(tuple(cell.T), shape))
    flat = [place(cell) for cell in (*ends, cut.voxel)]
    node = sorted_union(*flat)
    voxel = np.stack(np.unravel_index(node, shape), axis=1)
    src, dst = (np.asarray(np.searchsorted(node, e), np.int32) for e in flat[:2])
    return _CutLayout(
        # A lattice has a rim of one cell.
        address=tuple(jnp.asarray(i + 1, np.int32) for i in voxel.T),
        volume=jnp.asarray(grid.volume_at(voxel)),
        rows=jax.tree.map(jnp.asarray, row_layout(len(node), src, dst)),
    )


# One program instead of twenty of single operations.
@jax.jit
def _cut_values(conductivity, heat, materials, links, volume) -> tuple[Array, Array]:
    """Conductances of links over k, and capacities of voxels, by their materials."""
    first, second, own = materials
    step, extra, pitch = links
    # Along a link over an edge, the mean along its two axes.
    along = jnp.abs(step).astype(conductivity.dtype)
    axes = along / along.sum(axis=1, keepdims=True)
    k = [_along(conductivity[number], axes) for number in (first, second)]
    # Of a section that is the extra times pitch times the length of the link.
    half = jnp.full(extra.shape, 0.5)
    conductance = series(extra * pitch, half, k[0], half, k[1])
    return conductance, heat[own] * volume.astype(heat.dtype)


def _along(
    k: Float[Array, " e"] | Float[Array, "e 3"], axes: Float[Array, "e 3"]
) -> Float[Array, " e"]:
    return k if k.ndim == 1 else (k * jnp.asarray(axes, k.dtype)).sum(axis=1)


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
