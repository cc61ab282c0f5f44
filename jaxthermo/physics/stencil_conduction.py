"""Stencils of full volumes, from their grid and the properties of their materials."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from ..arrays import device_array
from ..network.link_operator import series
from ..network.network import AbstractNetwork, Address
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
from ..voxels.grid import VoxelGrid
from ..voxels.packed_lattice import PackedLattice
from ..voxels.sharded_lattice import ShardedLattice
from .cut_conduction import with_cut_voxels


def uniform_stencil(
    structure: FullVolume, conductivity: Array, heat: Array
) -> AbstractNetwork:
    """Stencil of one material, with one conductivity [W/(m K)] or three along the axes.

    The heat capacity rho c_p is in J/(m^3 K).
    """
    if structure.sharded is not None:
        base = _sharded_uniform(
            structure, lattice=structure.sharded, conductivity=conductivity, heat=heat
        )
    else:
        base = _local_uniform(structure, conductivity, heat)
    return with_cut_voxels(
        base,
        structure=structure,
        number=None,
        conductivity=conductivity[None],
        heat=heat[None],
    )


def _local_uniform(
    structure: FullVolume, conductivity: Array, heat: Array
) -> AbstractNetwork:
    """Stencil of one material on one device."""
    grid = structure.grid
    packed = structure.packed
    orthotropic = bool(conductivity.ndim)
    bits = 2 if orthotropic else 0
    degree = structure.found(
        ("solid_degree", bits, packed is None),
        lambda: device_array(solid_degree(_of_lattice(grid.solid, packed), bits)),
    )
    conductance = conductivity * grid.pitch
    across = conductance
    if orthotropic and packed is not None:
        across = conductance[packed.axes[0]]
        conductance = conductance[np.array(packed.axes)]
    stencil = OrthotropicStencil if orthotropic else UniformStencil
    base = stencil(heat * grid.voxel_volume, structure.node_count, degree, conductance)
    if packed is None:
        return base
    before, behind = _cut_pairs(structure, packed)
    return SectionedStencil(base, before=before, behind=behind, conductance=across)


def mixed_stencil(
    structure: FullVolume,
    material: Int[np.ndarray, " n"],
    conductivity: Float[Array, " c"] | Float[Array, "c 3"],
    heat: Float[Array, " c"],
) -> AbstractNetwork:
    """Stencil of several materials, numbered by node.

    Conductivities [W/(m K)] and heat capacities rho c_p [J/(m^3 K)] have one row per
    material.
    """
    grid = structure.grid
    number = np.zeros(grid.solid.shape, np.int32)
    number[grid.solid] = material
    if structure.sharded is not None:
        base = _sharded_mixed(
            structure, number=number, conductivity=conductivity, heat=heat
        )
    else:
        base = _local_mixed(
            structure, number=number, conductivity=conductivity, heat=heat
        )
    return with_cut_voxels(
        base, structure=structure, number=number, conductivity=conductivity, heat=heat
    )


def _local_mixed(
    structure: FullVolume,
    number: Int[np.ndarray, "x y z"],
    conductivity: Array,
    heat: Array,
) -> AbstractNetwork:
    """Stencil of several materials on one device."""
    packed = structure.packed
    sizes = _sizes(structure.grid)
    solid = _of_lattice(structure.grid.solid, packed)
    number = _of_lattice(number, packed)
    if packed is not None and conductivity.ndim == 2:
        conductivity = conductivity[:, np.array(packed.axes)]
    base = _stencil_arrays(
        solid, number=number, conductivity=conductivity, heat=heat, sizes=sizes
    )
    if packed is None:
        return base
    before, behind = _cut_pairs(structure, packed)
    across = conductivity[:, 0] if conductivity.ndim == 2 else conductivity
    conductance = _face_conductance(
        across[number[tuple(np.asarray(index) - 1 for index in before)]],
        across[number[tuple(np.asarray(index) - 1 for index in behind)]],
        sizes,
    )
    return SectionedStencil(base, before=before, behind=behind, conductance=conductance)


def _sharded_uniform(
    structure: FullVolume, lattice: ShardedLattice, conductivity: Array, heat: Array
) -> ShardedStencil:
    """Stencil of one material with a section on each of several devices."""
    grid = structure.grid
    mesh = mesh_of(lattice.count)
    orthotropic = bool(conductivity.ndim)
    bits = 2 if orthotropic else 0

    def section(n: int) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        solid = lattice.section(grid.solid, n)
        return solid_degree(solid, bits)[1:-1], (solid[:1], solid[-1:])

    degree, beyond = structure.found(
        ("sharded_degree", bits), lambda: from_sections(mesh, section)
    )
    conductance = conductivity * grid.pitch
    if orthotropic:
        conductance = conductance[np.array(lattice.axes)]
    stencil = OrthotropicStencil if orthotropic else UniformStencil
    base = stencil(
        heat * grid.voxel_volume,
        structure.node_count,
        degree,
        conductance,
        beyond=beyond,
    )
    return ShardedStencil(base, mesh)


def _sharded_mixed(
    structure: FullVolume,
    number: Shaped[np.ndarray, "x y z"],
    conductivity: Array,
    heat: Array,
) -> ShardedStencil:
    """Stencil of several materials with a section on each of several devices."""
    lattice = structure.sharded
    assert lattice is not None
    grid = structure.grid
    sizes = _sizes(grid)
    mesh = mesh_of(lattice.count)
    if conductivity.ndim == 2:
        conductivity = conductivity[:, np.array(lattice.axes)]

    def section(n: int) -> HeterogeneousStencil:
        padded = _stencil_arrays(
            lattice.section(grid.solid, n),
            number=lattice.section(number, n),
            conductivity=conductivity,
            heat=heat,
            sizes=sizes,
        )
        # Without the planes of the neighbours, which give the section's outer faces.
        return jax.tree.map(lambda values: values[1:-1], padded)

    return ShardedStencil(from_sections(mesh, section), mesh)


def _of_lattice(
    values: Shaped[np.ndarray, "x y z"], packed: PackedLattice | None
) -> Shaped[np.ndarray, "a b c"]:
    return values if packed is None else packed.packed(values)


def _cut_pairs(structure: FullVolume, packed: PackedLattice) -> tuple[Address, Address]:
    """Position of the voxels before and behind the cuts between sections."""

    def find() -> tuple[Address, Address]:
        first, second = packed.cut_pairs(structure.grid.solid)
        before = structure.address_of_voxels(first)
        behind = structure.address_of_voxels(second)
        # In the order of the state, in which they are read.
        order = np.lexsort(before[::-1])
        return (
            tuple(device_array(index[order]) for index in before),
            tuple(device_array(index[order]) for index in behind),
        )

    return structure.found("cut_pairs", find)


class _VoxelSizes(NamedTuple):
    """Sizes of a voxel, computed in double precision."""

    half_edge: float
    """[m]"""
    face_area: float
    """[m^2]"""
    volume: float
    """[m^3]"""


def _sizes(grid: VoxelGrid) -> _VoxelSizes:
    return _VoxelSizes(
        half_edge=grid.pitch / 2, face_area=grid.pitch**2, volume=grid.voxel_volume
    )


@jax.jit
def _face_conductance(
    first: Float[Array, "*f"], second: Float[Array, "*f"], sizes: _VoxelSizes
) -> Float[Array, "*f"]:
    """Conductance of faces between voxels, by the conductivities of both [W/K]."""
    half = jnp.full(first.shape, sizes.half_edge, first.dtype)
    area = jnp.full(first.shape, sizes.face_area, first.dtype)
    return series(area, length1=half, k1=first, length2=half, k2=second)


@jax.jit
def _stencil_arrays(
    solid, number, conductivity, heat, sizes: _VoxelSizes
) -> HeterogeneousStencil:
    by_axis = conductivity[number]
    faces = []
    for axis in range(3):
        k = by_axis[..., axis] if by_axis.ndim == 4 else by_axis
        k = jnp.where(solid, k, 0)
        first = jax.lax.slice_in_dim(k, 0, k.shape[axis] - 1, axis=axis)
        second = jax.lax.slice_in_dim(k, 1, k.shape[axis], axis=axis)
        outer = [(0, 0)] * 3
        outer[axis] = (1, 1)
        faces.append(jnp.pad(_face_conductance(first, second, sizes), outer))
    return HeterogeneousStencil(
        face_conductance=(faces[0], faces[1], faces[2]),
        cell_capacity=jnp.where(solid, heat[number] * sizes.volume, 0),
    )
