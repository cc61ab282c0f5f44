"""Networks of bodies of several materials, or of an orthotropic one, with k(T)."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import Scalar, device_array
from ..errors import InputError
from ..material.material import Material, Property
from ..network.network import AbstractNetwork
from ..network.nonlinear import KirchhoffTransform, kirchhoff_transform
from ..network.varying_links import Integrals, LinkHalves, VaryingLinks
from ..structures.partition.links import link_axes
from ..structures.structure import AbstractStructure


def varying_links(
    structure: AbstractStructure,
    base: AbstractNetwork,
    number: Int[np.ndarray, " n"],
    materials: Sequence[Material],
    reference: Scalar,
    weights: Float[Array, " e"] | None,
) -> VaryingLinks:
    """Network of materials that may vary, from the linear one at the reference.

    `number` is the index of each node's material, the reference temperature is in
    kelvin, and `weights` are the factors of the links [-], None for 1.

    Raises:
        InputError: with a correction of links that are not normal to their faces.
    """
    dtype = base.total_capacity().dtype
    if structure.weights.corrects_non_orthogonality:
        raise InputError(
            "weights: `non_orthogonal` is for constant conductivities, and those of "
            "a body of several materials or axes depend on temperature: set it to 0"
        )
    integrals = _integrals(materials, reference, dtype)
    along = np.ones((1, structure.link_count))
    if integrals.axes == 3:
        along = link_axes(structure).T
    links = structure.links()
    area = device_array(links.area, dtype)
    if weights is not None:
        area = area * weights

    columns = structure.columns
    outside = np.ones(structure.link_count)
    if columns is not None:
        outside[columns.link] = 0

    def halves(selected: Int[np.ndarray, " c"]) -> LinkHalves:
        return LinkHalves(
            src=device_array(links.src[selected]),
            dst=device_array(links.dst[selected]),
            area=area[selected],
            to_src=device_array(links.distance_src[selected], dtype),
            to_dst=device_array(links.distance_dst[selected], dtype),
            along=tuple(device_array(axis[selected], dtype) for axis in along),
            outside=None if columns is None else device_array(outside[selected], dtype),
        )

    address = structure.node_address()
    of_state = np.zeros(structure.state_shape, np.int32)
    of_state[address] = number
    same = number[links.src] == number[links.dst]
    return VaryingLinks(
        base=base,
        integrals=integrals,
        heat=tuple(
            transform_or_none(material.specific_heat, reference, dtype)
            for material in materials
        ),
        number=device_array(of_state),
        address=tuple(device_array(index) for index in address),
        within=halves(np.flatnonzero(same)),
        across=halves(np.flatnonzero(~same)),
    )


def transform_or_none(
    value: Any, reference: Scalar, dtype: Any
) -> KirchhoffTransform | None:
    """Kirchhoff's transform of a property that varies, None for a constant."""
    if not isinstance(value, Property):
        return None
    return kirchhoff_transform(value, reference, dtype)


def _integrals(
    materials: Sequence[Material], reference: Scalar, dtype: Any
) -> Integrals:
    by_axis = []
    for material in materials:
        k = material.conductivity
        by_axis.append(k if isinstance(k, tuple) else (k,))
    axes = max(len(row) for row in by_axis)
    table = [row if len(row) == axes else row * axes for row in by_axis]
    transform = tuple(
        tuple(_transform(k, reference, dtype) for k in row) for row in table
    )
    at_reference = [
        jnp.stack([device_array(_number(k, reference), dtype) for k in row])
        for row in table
    ]
    return Integrals(transform=transform, reference=jnp.stack(at_reference))


def _transform(k: Any, reference: Scalar, dtype: Any) -> KirchhoffTransform:
    # A constant is a table of one row.
    prop = k if isinstance(k, Property) else Property([300.0], [k])
    return kirchhoff_transform(prop, reference, dtype)


def _number(k: Any, reference: Scalar) -> Any:
    return k(reference) if isinstance(k, Property) else k
