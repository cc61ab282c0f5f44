"""Data of one body that do not change as bodies and sources move."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, is_traced
from ...errors import InputError
from ...network.network import AbstractNetwork, Address
from ...physics.conduction import normal_conductivity, surface_conductivity
from ...physics.flux_law import Values
from ...physics.material_network import (
    conductivity_table,
    material_network,
    materials_network,
)
from ..scene import AbstractMaterials, Body


# Position of every node of a body in its state.
_HostAddress = tuple[np.ndarray, ...]


def device_address(address: _HostAddress, nodes: Int[np.ndarray, " m"]) -> Address:
    """Position of some of the nodes in the state."""
    return tuple(jnp.asarray(index[nodes]) for index in address)


class PreparedBody(NamedTuple):
    """One body with its network and initial state."""

    body: Body
    network: AbstractNetwork
    reference: Scalar
    """Temperature from which the state counts [K]."""
    state: Float[Array, "..."]
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    fragment_node: Int[np.ndarray, " s"]
    address: _HostAddress
    surface_map: Any
    """As bound to the body."""


def prepare(body: Body, dtype: Any) -> PreparedBody:
    """Network, initial state and addresses of a body."""
    structure = body.structure
    address = structure.node_address()
    reference, theta = _initial(body, address, dtype)
    network = _network(body, reference, dtype)
    return PreparedBody(
        body=body,
        network=network,
        reference=reference,
        state=network.state_of(theta),
        half_cell=_half_cells(body, reference, dtype),
        fragment_node=structure.fragment_node(),
        address=address,
        surface_map=body.surface_map.bind(structure, dtype),
    )


def _network(body: Body, reference: Scalar, dtype: Any) -> AbstractNetwork:
    structure, material = body.structure, body.material
    if isinstance(material, AbstractMaterials):
        number = material.of_nodes(structure)
        return materials_network(structure, number, material.materials, dtype)
    return material_network(structure, material, reference, dtype)


def _initial(
    body: Body, address: _HostAddress, dtype: Any
) -> tuple[Scalar, Float[Array, "..."]]:
    """The body's reference temperature, and its nodes' temperatures above it [K]."""
    # The reference is the initial mean. It is no variable: of a traced initial state
    # only the difference, 0 where it is uniform, carries a derivative.
    theta = jnp.asarray(np.zeros(body.structure.state_shape, dtype))
    values: Any = body.temperature
    if callable(values):
        values = values(body.structure.nodes().location)
    elif not is_traced(values):
        return float(values), theta
    if is_traced(values):
        values = values.astype(dtype)
        reference = jax.lax.stop_gradient(values.mean())
    else:
        values = np.asarray(values, float)
        if not np.isfinite(values).all() or (values < 0).any():
            raise InputError(
                "Body(temperature=) gives values that are not temperatures in kelvin"
            )
        reference = float(values.mean())
    # The difference is taken in double precision: a float32 resolves 3e-5 K at 300 K.
    above = jnp.asarray(values - reference, dtype)
    return reference, theta.at[address].set(above)


def surface_property(body: Body, field: str, dtype: Any) -> Float[Values, "*s"]:
    """One property of a body at its surface: a number, or one per fragment.

    Args:
        body: the body.
        field: "emissivity" or "absorptivity", as `Material` calls it.
        dtype: of the state.
    """
    material, grid = body.material, body.structure.grid
    # One material needs no array of its property.
    if isinstance(material, AbstractMaterials):
        return material.table(field, dtype)[material.of_fragments(grid)]
    value = getattr(material, field)
    return jnp.asarray(value, dtype) if is_traced(value) else np.asarray(value, dtype)


def _half_cells(body: Body, reference: Scalar, dtype: Any) -> Float[Values, " s"]:
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    # A conductivity that varies is evaluated at the reference temperature.
    structure, material = body.structure, body.material
    grid = structure.grid
    if isinstance(material, AbstractMaterials):
        table = conductivity_table(material.materials, dtype)
        k = normal_conductivity(
            table[material.of_fragments(grid)], grid.fragment_normal
        )
    else:
        k = surface_conductivity(material.at(reference), grid.fragment_normal, dtype)
    per_length = grid.fragment_area / structure.fragment_distance()
    return k * per_length.astype(dtype)
