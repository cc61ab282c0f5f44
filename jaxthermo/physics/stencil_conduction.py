"""Stencils of full volumes, from their grid and the properties of their materials."""

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
        whole = _sharded_uniform(
            structure, lattice=structure.sharded, conductivity=conductivity, heat=heat
        )
        return with_cut_voxels(
            whole,
            structure=structure,
            number=None,
            conductivity=conductivity[None],
            heat=heat[None],
        )
    grid, packed, three = structure.grid, structure.packed, bool(conductivity.ndim)
    stencil, bits = (OrthotropicStencil, 2) if three else (UniformStencil, 0)
    axes = (0, 1, 2) if packed is None else packed.axes
    conductance = conductivity * grid.pitch
    whole = stencil(
        heat * grid.voxel_volume,
        structure.node_count,
        structure.found(
            ("solid_degree", bits, packed is None),
            lambda: device_array(solid_degree(_of_lattice(grid.solid, packed), bits)),
        ),
        conductance[np.array(axes)] if three else conductance,
    )
    if packed is not None:
        across = conductance[packed.axes[0]] if three else conductance
        whole = SectionedStencil(whole, *_cut_pairs(structure, packed), across)
    return with_cut_voxels(
        whole,
        structure=structure,
        number=None,
        conductivity=conductivity[None],
        heat=heat[None],
    )


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
            structure.sharded,
            solid=grid.solid,
            number=number,
            properties=(conductivity, heat),
            sizes=sizes,
        )
        return with_cut_voxels(
            whole,
            structure=structure,
            number=number,
            conductivity=conductivity,
            heat=heat,
        )
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
    return with_cut_voxels(
        whole, structure=structure, number=number, conductivity=conductivity, heat=heat
    )


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
        sort = lambda address: tuple(device_array(index[order]) for index in address)
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
