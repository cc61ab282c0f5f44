"""Stencils of full volumes, from their grid and the properties of their materials."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..arrays import device_array
from ..network.link_operator import series
from ..network.network import AbstractNetwork
from ..network.sharded_stencil import ShardedStencil
from ..network.stencil import (
    HeterogeneousStencil,
    Stencil,
    solid_degree,
)
from ..parallel.devices import mesh_of
from ..parallel.lattice import from_sections
from ..structures.kinds.full import FullVolume
from .cut_conduction import with_cut_voxels


def uniform_stencil(
    structure: FullVolume, conductivity: Any, heat: Any
) -> AbstractNetwork:
    """Stencil of one material, with one conductivity [W/(m K)] or three along the axes.

    The heat capacity rho c_p is in J/(m^3 K).
    """
    conductivity = device_array(conductivity)
    heat = device_array(heat)
    grid = structure.grid
    lattice = structure.sharded
    conductance = conductivity * grid.pitch
    capacity = heat * grid.voxel_volume
    orthotropic = bool(conductivity.ndim)
    bits = 2 if orthotropic else 0
    if lattice is None:
        degree = structure.found(
            ("solid_degree", bits), lambda: device_array(solid_degree(grid.solid, bits))
        )
        base = Stencil(capacity, structure.node_count, degree, conductance)
    else:
        degree, beyond = structure.found(
            ("sharded_degree", bits), lambda: _section_degrees(structure, bits)
        )
        if orthotropic:
            conductance = conductance[np.array(lattice.axes)]
        sections = Stencil(
            capacity, structure.node_count, degree, conductance, beyond=beyond
        )
        base = ShardedStencil(sections, mesh_of(lattice.count))
    return with_cut_voxels(
        base,
        structure=structure,
        number=None,
        conductivity=conductivity[None],
        heat=heat[None],
    )


def _section_degrees(structure: FullVolume, bits: int):
    """Degrees of the voxels in each device's section, and the planes beyond it."""
    lattice = structure.sharded
    assert lattice is not None

    def section(n: int) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        solid = lattice.section(structure.grid.solid, n)
        return solid_degree(solid, bits)[1:-1], (solid[:1], solid[-1:])

    return from_sections(mesh_of(lattice.count), section)


def mixed_stencil(
    structure: FullVolume,
    material: Int[np.ndarray, " n"],
    conductivity: Float[Any, " c"] | Float[Any, "c 3"],
    heat: Float[Any, " c"],
) -> AbstractNetwork:
    """Stencil of several materials, numbered by node.

    Conductivities [W/(m K)] and heat capacities rho c_p [J/(m^3 K)] have one row per
    material.
    """
    conductivity = device_array(conductivity)
    heat = device_array(heat)
    grid = structure.grid
    lattice = structure.sharded
    sizes = _VoxelSizes(
        half_edge=grid.pitch / 2, face_area=grid.pitch**2, volume=grid.voxel_volume
    )
    number = np.zeros(grid.solid.shape, np.int32)
    number[grid.solid] = material
    if lattice is None:
        base = _stencil_arrays(
            grid.solid,
            number=number,
            conductivity=conductivity,
            heat=heat,
            sizes=sizes,
        )
    else:
        by_axis = conductivity.ndim == 2
        along = conductivity[:, np.array(lattice.axes)] if by_axis else conductivity

        def section(n: int) -> HeterogeneousStencil:
            padded = _stencil_arrays(
                lattice.section(grid.solid, n),
                number=lattice.section(number, n),
                conductivity=along,
                heat=heat,
                sizes=sizes,
            )
            # Without the planes of the neighbours, which give its outer faces.
            return jax.tree.map(lambda values: values[1:-1], padded)

        mesh = mesh_of(lattice.count)
        base = ShardedStencil(from_sections(mesh, section), mesh)
    return with_cut_voxels(
        base, structure=structure, number=number, conductivity=conductivity, heat=heat
    )


class _VoxelSizes(NamedTuple):
    """Sizes of a voxel, computed in double precision."""

    half_edge: float
    """[m]"""
    face_area: float
    """[m^2]"""
    volume: float
    """[m^3]"""


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
        half = jnp.full(first.shape, sizes.half_edge, k.dtype)
        conductance = series(
            jnp.full(first.shape, sizes.face_area, k.dtype),
            length1=half,
            k1=first,
            length2=half,
            k2=second,
        )
        outer = [(0, 0)] * 3
        outer[axis] = (1, 1)
        faces.append(jnp.pad(conductance, outer))
    return HeterogeneousStencil(
        face_conductance=(faces[0], faces[1], faces[2]),
        cell_capacity=jnp.where(solid, heat[number] * sizes.volume, 0),
    )
