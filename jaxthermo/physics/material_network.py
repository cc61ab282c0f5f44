"""Conduction network of a body from its materials.

| material | network |
|---|---|
| one, constant | stencil or rows, as its structure requires |
| one, with a `Property` | the same at the reference, with Kirchhoff's transform |
| several, constant | a conductance for every link |
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import Scalar
from ..errors import InputError
from ..material.material import Material, Property
from ..network.network import AbstractNetwork
from ..network.nonlinear import NonlinearNetwork, kirchhoff_transform
from ..structures.build.assignment import voxel_owner
from ..structures.structure import AbstractStructure
from .conduction import assemble_mixed, assemble_uniform


def material_network(
    structure: AbstractStructure, material: Material, reference: Scalar, dtype: Any
) -> AbstractNetwork:
    """Network of a body of one material, with states relative to `reference` [K]."""
    constant = material.at(reference)
    k, heat = constant.conductivity, constant.volumetric_heat_capacity
    network = assemble_uniform(structure, k, heat, dtype)
    if not material.varies:
        return network
    varying = (material.specific_heat, material.conductivity)
    heat, conduction = (
        kirchhoff_transform(p, reference, dtype) if isinstance(p, Property) else None
        for p in varying
    )
    return NonlinearNetwork(network, heat, conduction)


def materials_network(
    structure: AbstractStructure,
    number: Int[np.ndarray, " n"],
    materials: Sequence[Material],
    dtype: Any,
) -> AbstractNetwork:
    """Network of a body of several materials; `number` is that of each node.

    Raises:
        InputError: if one of them varies with temperature.
    """
    k = conductivity_table(materials, dtype)
    heat = [jnp.asarray(m.volumetric_heat_capacity, dtype) for m in materials]
    return assemble_mixed(structure, number, k, jnp.stack(heat))


def conductivity_table(
    materials: Sequence[Material], dtype: Any
) -> Float[Array, " c"] | Float[Array, "c 3"]:
    """Conductivities of several materials [W/(m K)], by axis if any is orthotropic.

    Raises:
        InputError: if one of them varies with temperature.
    """
    for index, material in enumerate(materials):
        if material.varies:
            raise InputError(
                f"material {index} of a body of several depends on temperature, which "
                "only bodies of one material can: give it numbers, as .at(kelvin) does"
            )
    given = [jnp.asarray(material.conductivity, dtype) for material in materials]
    shape = max((k.shape for k in given), key=len)
    return jnp.stack([jnp.broadcast_to(k, shape) for k in given])


def node_materials(
    structure: AbstractStructure, labels: Int[np.ndarray, "x y z"]
) -> Int[np.ndarray, " n"]:
    """Material number of each node: that of the majority of its voxels' labels."""
    owner, solid = voxel_owner(structure), structure.grid.solid
    of_voxel, count = labels[solid][owner >= 0], int(labels.max()) + 1
    pair = owner[owner >= 0].astype(np.int64) * count + of_voxel
    votes = np.bincount(pair, minlength=structure.node_count * count)
    return votes.reshape(-1, count).argmax(axis=1).astype(np.int32)


def checked_labels(
    structure: AbstractStructure, labels: Any, materials: int
) -> Int[np.ndarray, "x y z"]:
    """Material numbers as integers, 0 outside the body.

    Raises:
        InputError: unless every voxel has the number of an existing material.
    """
    given, solid = np.asarray(labels), structure.grid.solid
    if not np.issubdtype(given.dtype, np.integer) or given.shape != solid.shape:
        raise InputError(
            f"material labels: got {given.dtype} values of shape {given.shape}: give "
            f"one integer for each voxel of the grid, {solid.shape}"
        )
    number = np.where(solid, given, 0).astype(np.int32)
    if number.min() < 0 or number.max() >= materials:
        raise InputError(
            f"material labels: {number.min()} to {number.max()}, and there are "
            f"{materials} materials: number them from 0"
        )
    return number
