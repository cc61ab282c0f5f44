"""Conduction (thesis eq. 4): q = k A / L dT between linked nodes.

Conductances are a pure function of a structure's geometry and its materials. Two half
cells of different conductivity are in series, so a link takes the harmonic mean
k = 2 k1 k2 / (k1 + k2): exact in one dimension, where the arithmetic mean is off by the
ratio of the conductivities. The stable explicit step of a node is C / sum_j G_j
(Fourier 1/6 for a voxel with six neighbours).
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..network.links import LinkNetwork
from ..network.network import AbstractNetwork
from ..network.stencil import MaterialStencil, UniformStencil, solid_degree
from ..structures.structure import AbstractStructure


def series(k1: Float[Array, "*e"], k2: Float[Array, "*e"]) -> Float[Array, "*e"]:
    """Conductivity of two equal lengths in series [W/(m K)]; 0 if either insulates."""
    total = k1 + k2
    return jnp.where(total > 0, 2 * k1 * k2 / jnp.where(total > 0, total, 1), 0)


def assemble_uniform(
    structure: AbstractStructure,
    conductivity: Any,
    volumetric_heat_capacity: Any,
    dtype: Any,
) -> AbstractNetwork:
    """The network of a body of one material, which carries no array of conductivities.

    Args:
        structure: nodes and links.
        conductivity: k [W/(m K)].
        volumetric_heat_capacity: rho c_p [J/(m^3 K)].
        dtype: of the state.
    """
    k = jnp.asarray(conductivity, dtype)
    heat = jnp.asarray(volumetric_heat_capacity, dtype)
    grid = structure.grid
    if structure.dense is not None:
        return UniformStencil(
            degree=jnp.asarray(solid_degree(structure.dense)),
            conductance=k * grid.pitch,
            node_capacity=heat * grid.voxel_volume,
            node_count=structure.node_count,
        )
    links = structure.links()
    return LinkNetwork(
        src=jnp.asarray(links.src),
        dst=jnp.asarray(links.dst),
        conductance=k * jnp.asarray(links.area / links.distance, dtype),
        node_capacity=heat * jnp.asarray(structure.nodes().volume, dtype),
    )


def assemble_mixed(
    structure: AbstractStructure,
    material: Int[np.ndarray, " n"],
    conductivity: Float[Array, " c"],
    volumetric_heat_capacity: Float[Array, " c"],
) -> AbstractNetwork:
    """The network of a body of several materials.

    Args:
        structure: nodes and links.
        material: number of each node's material, an index into the next two.
        conductivity: k [W/(m K)].
        volumetric_heat_capacity: rho c_p [J/(m^3 K)].
    """
    if structure.dense is not None:
        return _mixed_stencil(
            structure, material, conductivity, volumetric_heat_capacity
        )
    links, dtype = structure.links(), conductivity.dtype
    k = conductivity[material]
    heat = volumetric_heat_capacity[material]
    return LinkNetwork(
        src=jnp.asarray(links.src),
        dst=jnp.asarray(links.dst),
        conductance=series(k[links.src], k[links.dst])
        * jnp.asarray(links.area / links.distance, dtype),
        node_capacity=heat * jnp.asarray(structure.nodes().volume, dtype),
    )


def _mixed_stencil(structure, material, conductivity, heat):
    solid, grid = structure.dense, structure.grid
    number = np.zeros(solid.shape, np.int32)
    number[solid] = material
    k = jnp.where(solid, conductivity[number], 0)
    faces = []
    for axis in range(3):
        before = [slice(None)] * 3
        after = [slice(None)] * 3
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        faces.append(grid.pitch * series(k[tuple(before)], k[tuple(after)]))
    return MaterialStencil(
        face_conductance=(faces[0], faces[1], faces[2]),
        voxel_capacity=jnp.where(solid, heat[number] * grid.voxel_volume, 0),
    )
