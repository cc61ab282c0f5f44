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
from ..network.nonlinear import kirchhoff_transform
from ..network.varying_links import Integrals, LinkHalves, VaryingLinks
from ..structures.build.links import link_axes
from ..structures.structure import AbstractStructure


def varying_links(
    structure: AbstractStructure,
    base: AbstractNetwork,
    number: Int[np.ndarray, " n"],
    materials: Sequence[Material],
    reference: Scalar,
    weights: Float[Array, " e"] | None,
) -> VaryingLinks:
    """Network of materials of which some vary, from its linear one at the reference.

    `number` is that of the material of each node, the reference temperature is in
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
    found = structure.links()
    area = device_array(found.area, dtype)
    if weights is not None:
        area = area * weights

    def halves(chosen: Int[np.ndarray, " c"]) -> LinkHalves:
        own = lambda values: device_array(values[chosen], dtype)
        return LinkHalves(
            src=device_array(found.src[chosen]),
            dst=device_array(found.dst[chosen]),
            area=area[chosen],
            to_src=own(found.distance_src),
            to_dst=own(found.distance_dst),
            along=tuple(own(part) for part in along),
        )

    address = structure.node_address()
    of_state = np.zeros(structure.state_shape, np.int32)
    of_state[address] = number
    same = number[found.src] == number[found.dst]
    return VaryingLinks(
        base=base,
        integrals=integrals,
        heat=tuple(
            kirchhoff_transform(c, reference, dtype)
            if isinstance(c, Property)
            else None
            for c in (material.specific_heat for material in materials)
        ),
        number=device_array(of_state),
        address=tuple(device_array(index) for index in address),
        within=halves(np.flatnonzero(same)),
        across=halves(np.flatnonzero(~same)),
    )


def _integrals(
    materials: Sequence[Material], reference: Scalar, dtype: Any
) -> Integrals:
    by_axis = [
        k if isinstance(k := material.conductivity, tuple) else (k,)
        for material in materials
    ]
    axes = max(len(k) for k in by_axis)
    every = [k if len(k) == axes else k * axes for k in by_axis]
    # A constant is a table of one row.
    table = lambda k: k if isinstance(k, Property) else Property([300.0], [k])
    number = lambda k: k(reference) if isinstance(k, Property) else k
    transform = tuple(
        tuple(kirchhoff_transform(table(k), reference, dtype) for k in row)
        for row in every
    )
    rows = [jnp.stack([device_array(number(k), dtype) for k in row]) for row in every]
    return Integrals(transform, jnp.stack(rows))
