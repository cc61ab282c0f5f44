"""Stencils of full volumes, from their grid and the properties of their materials."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..network.cut_stencil import CutStencil
from ..network.link_operator import row_layout, row_network
from ..network.network import AbstractNetwork, inverse
from ..network.stencil import (
    HeterogeneousStencil,
    OrthotropicStencil,
    UniformStencil,
    solid_degree,
)
from ..structures.build.cut_links import cut_links
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
        jnp.asarray(solid_degree(grid.solid, bits)),
        conductivity * grid.pitch,
    )
    return whole if grid.cut is None else _with_cut_voxels(whole, grid, heat)


def _with_cut_voxels(
    whole: UniformStencil | OrthotropicStencil, grid: VoxelGrid, heat: Array
) -> CutStencil:
    """A stencil with the capacities and links of the voxels that the surface cuts."""
    found, dtype = cut_links(grid), heat.dtype
    each = jnp.broadcast_to(whole.conductance, (3,))[found.axis]
    return CutStencil(
        base=whole,
        # A lattice has a rim of one cell.
        address=tuple(jnp.asarray(i + 1, np.int32) for i in found.voxel.T),
        links=row_network(
            row_layout(len(found.voxel), found.src, found.dst),
            each * jnp.asarray(found.open_area - 1, dtype),
            heat * jnp.asarray(grid.volume_at(found.voxel), dtype),
        ),
    )


def mixed_stencil(
    grid: VoxelGrid,
    material: Int[np.ndarray, " n"],
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> HeterogeneousStencil:
    """Stencil of several materials, numbered by node, with properties of each.

    Conductivities [W/(m K)] and heat capacities rho c_p [J/(m^3 K)].
    """
    number = np.zeros(grid.solid.shape, np.int32)
    number[grid.solid] = material
    half, area, volume = grid.pitch / 2, grid.pitch**2, grid.voxel_volume
    faces, cut = [area] * 3, grid.cut
    if cut is not None:
        shape = grid.solid.shape
        opened = (cut.open_across(shape, a) for a in range(3))
        faces = [area * _face_means(each, a) for a, each in enumerate(opened)]
        volume = cut.volumes(shape) * volume
    sizes = half, tuple(faces), volume
    return _stencil_arrays(grid.solid, number, conductivity, heat, sizes)


def _face_means(values: Float[np.ndarray, "x y z"], axis: int) -> np.ndarray:
    """Mean of the values on both sides of every face across an axis."""
    line = np.moveaxis(values, axis, 0)
    return np.moveaxis((line[:-1] + line[1:]) / 2, 0, axis)


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
        lengths, areas = (
            jnp.broadcast_to(jnp.asarray(v, dtype), first.shape)
            for v in (half, area[axis])
        )
        outer = [(0, 0)] * 3
        outer[axis] = (1, 1)
        faces.append(jnp.pad(series(areas, lengths, first, lengths, second), outer))
    return HeterogeneousStencil(
        face_conductance=(faces[0], faces[1], faces[2]),
        cell_capacity=jnp.where(solid, heat[number] * jnp.asarray(volume, dtype), 0),
    )
