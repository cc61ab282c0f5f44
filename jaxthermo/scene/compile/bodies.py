"""Bodies before a run: networks, initial states, and the limits that follow from them.

None of it changes as bodies and sources move.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, device_array, is_traced, namespace
from ...errors import InputError, located
from ...material.air import body_of_air
from ...network.network import AbstractNetwork, Address
from ...physics.conduction import (
    conductivity_parts,
    conductivity_table,
    material_network,
    materials_network,
    normal_conductivity,
    surface_conductivity,
)
from ...physics.flux_law import Forcing, Values
from ...physics.sheet_conduction import sheet_network
from ...physics.time_varying import check_temperature
from ...structures.kinds.air import AirVolume
from ...structures.kinds.full import FullVolume
from ...structures.kinds.sheet import Sheet
from ...voxels.sharded_lattice import padded_places
from ..scene import AbstractMaterials, Body, Scene


@eqx.filter_jit
def capacity_at(network: AbstractNetwork, address: Address) -> Float[Array, "*m"]:
    """Heat capacities of some of the nodes [J/K]; one number if all have the same."""
    # One program: some networks have twenty single operations.
    return network.capacity_at(address)


class _SectionPlaces(NamedTuple):
    """Positions of nodes in a list with an equally long part for each section."""

    address: Address
    """Positions in the state, padded with empty cells where sections have fewer."""
    places: Int[np.ndarray, " m"]
    """Place of each node in the list."""
    per_section: int
    """Number of places of each section."""


class PreparedBody(NamedTuple):
    """One body with its network and initial state."""

    number: int
    """Number of the body in the scene."""
    body: Body
    network: AbstractNetwork
    reference: Scalar
    """Temperature from which the state counts [K]."""
    state: Float[Values, "..."]
    """State at time 0; one number where it is uniform."""
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    fragment_node: Int[np.ndarray, " s"]
    surface_map: Any
    """Surface map as bound to the body."""
    conductivity_parts: Float[Array, "q s"] | None
    """Fractions of each fragment, see `conductivity_parts`; None for one material."""

    def address_of(self, nodes: Int[np.ndarray, " m"]) -> Address:
        """Position of some of the nodes in the state."""
        return tuple(map(device_array, self.body.structure.address_of(nodes)))

    def ordered_address(
        self, nodes: Int[np.ndarray, " m"]
    ) -> tuple[Address, Int[np.ndarray, " m"]]:
        """Positions of distinct nodes in the order of the state, and the rank of each.

        In that order memory is read and written fastest.
        """
        structure = self.body.structure
        address = structure.address_of(nodes)
        rank = np.arange(len(nodes))
        position = np.ravel_multi_index(address, structure.state_shape)
        if (np.diff(position) < 0).any():
            order = np.argsort(position)
            rank[order] = np.arange(len(nodes))
            address = tuple(index[order] for index in address)
        return tuple(map(device_array, address)), rank

    def section_places(self, nodes: Int[np.ndarray, " m"]) -> _SectionPlaces:
        """Positions of distinct nodes, by the sections of a body; see `gathered`.

        A body on one device has one section, with the positions of `ordered_address`.
        """
        address, rank = self.ordered_address(nodes)
        structure = self.body.structure
        lattice = structure.sharded if isinstance(structure, FullVolume) else None
        if lattice is None:
            return _SectionPlaces(address, places=rank, per_section=len(nodes))
        host = tuple(map(np.asarray, address))
        length = lattice.thickness + 2
        section = host[0] // length
        places, count = padded_places(section, lattice.count)
        # Empty cells in the rim of each section, where no temperature ever changes.
        empty = length * np.repeat(np.arange(1, lattice.count + 1), count) - 1
        padded = [empty, np.zeros_like(empty), np.zeros_like(empty)]
        for index, positions in zip(padded, host, strict=True):
            index[places] = positions
        padded_address = tuple(device_array(index, jnp.int32) for index in padded)
        return _SectionPlaces(padded_address, places=places[rank], per_section=count)


def prepare(number: int, body: Body, dtype: Any) -> PreparedBody:
    """Network, initial state and addresses of a body."""
    structure = body.structure
    material = body.material
    reference, theta = _initial(number, body, dtype)
    if isinstance(structure, Sheet):
        network = sheet_network(structure, dtype)
    elif isinstance(structure, AirVolume):
        air = body_of_air(structure.air_volume, body.temperature)
        network = material_network(
            structure, material=air, reference=reference, dtype=dtype
        )
    elif isinstance(material, AbstractMaterials):
        network = materials_network(
            structure,
            number=material.of_nodes(structure),
            materials=material.materials,
            reference=reference,
            dtype=dtype,
        )
    else:
        assert material is not None
        network = material_network(
            structure, material=material, reference=reference, dtype=dtype
        )
    return PreparedBody(
        number=number,
        body=body,
        network=network,
        reference=reference,
        state=network.state_of(jnp.asarray(theta)),
        half_cell=_half_cells(body, reference, dtype),
        fragment_node=structure.fragment_node(),
        surface_map=body.surface_map.bind(structure, dtype),
        conductivity_parts=_parts(body, reference, dtype),
    )


def _parts(body: Body, reference: Scalar, dtype: Any) -> Float[Array, "q s"] | None:
    grid = body.structure.grid
    material = body.material
    if material is None:
        return None
    number = np.zeros(len(grid.fragment_area), np.int32)
    materials: tuple = (material,)
    if isinstance(material, AbstractMaterials):
        number = material.of_fragments(body.structure.voxels)
        materials = material.materials
    return conductivity_parts(
        materials,
        number=number,
        normal=grid.fragment_normal,
        reference=reference,
        dtype=dtype,
    )


def _initial(
    number: int, body: Body, dtype: Any
) -> tuple[Scalar, Float[Values, "..."]]:
    # Reference temperature of a body, and its nodes' temperatures above it [K].
    # The reference is the initial mean and no variable: only the difference of a
    # traced initial state from it carries a derivative.
    values: Any = body.temperature
    if callable(values):
        values = values(body.structure.nodes().location)
    elif not is_traced(values):
        # One number for all nodes, which takes no memory until a run starts.
        return float(values), np.zeros((), dtype)
    theta = np.zeros(body.structure.state_shape, dtype)
    address = body.structure.node_address()
    if is_traced(values):
        values = values.astype(dtype)
        reference = jax.lax.stop_gradient(values.mean())
        return reference, jnp.asarray(theta).at[address].set(values - reference)
    values = np.asarray(values, float)
    wrong = values[~(np.isfinite(values) & (values >= 0))]
    if wrong.size:
        raise InputError(
            f"bodies[{number}]: Body(temperature=) gives {wrong.flat[0]:g} K: the "
            "function must give kelvin, 0 or more, at every position"
        )
    reference = float(values.mean())
    # The difference is taken in double precision: a float32 resolves 3e-5 K at 300 K.
    theta[address] = values - reference
    return reference, device_array(theta)


def surface_property(body: Body, field: str, dtype: Any) -> Float[Values, "*s"]:
    """A property of a body at its surface, by its name in `Material`."""
    material = body.material
    grid = body.structure.grid
    # One material needs no array of its property.
    if isinstance(body.structure, Sheet):
        values = body.structure.face_values(field, dtype)
    elif isinstance(material, AbstractMaterials):
        number = material.of_fragments(body.structure.voxels)
        values = material.table(field, dtype)[number]
    else:
        value = getattr(material, field)
        xp = namespace(value)
        values = xp.asarray(value, dtype)
    for number, coating in enumerate(body.coatings):
        with located(f"coatings[{number}]"):
            values = coating.over(values, field, grid)
    return values


def _half_cells(body: Body, reference: Scalar, dtype: Any) -> Float[Values, " s"]:
    # A conductivity that varies is evaluated at the reference temperature.
    structure = body.structure
    material = body.material
    grid = structure.grid
    if isinstance(structure, Sheet):
        return grid.fragment_area.astype(dtype) / structure.face_resistance(dtype)
    if isinstance(structure, AirVolume):
        return np.zeros(0, dtype)
    if isinstance(material, AbstractMaterials):
        table = conductivity_table(material.materials, reference, dtype)
        by_fragment = table[material.of_fragments(structure.voxels)]
        k = normal_conductivity(by_fragment, grid.fragment_normal)
    else:
        assert material is not None
        k = surface_conductivity(material.at(reference), grid.fragment_normal, dtype)
    # Area over distance to the node [m].
    return k * (grid.fragment_area / structure.fragment_distance()).astype(dtype)


class TemperatureBounds(NamedTuple):
    """Bounds of all temperatures of nodes and surfaces [K]."""

    highest: Float[Any, ""]
    lowest: Float[Any, ""]

    def known(self) -> Forcing | None:
        """Return the bounds as numbers; None where they are traced."""
        if is_traced(self):
            return None
        return Forcing(highest=float(self.highest), lowest=float(self.lowest))


def check_bodies(scene: Scene, prepared: tuple[PreparedBody, ...]) -> None:
    """Check initial temperatures that functions give, as a scene checks numbers.

    Raises:
        InputError: for a temperature outside the bounds.
    """
    if scene.allow_extreme_temperatures:
        return
    for n, body in enumerate(prepared):
        if callable(body.body.temperature):
            theta = body.network.temperature(jnp.asarray(body.state))
            xp = namespace(theta)
            theta = xp.asarray(theta)
            ends = xp.stack([theta.min(), theta.max()]) + body.reference
            check_temperature(ends, f"bodies[{n}]: Body(temperature=) gives")


def check_terms(scene: Scene, end: float | int) -> None:
    """Check temperatures of terms that functions give, as a scene checks numbers.

    Raises:
        InputError: for a temperature outside the bounds up to `end` [s].
    """
    if scene.allow_extreme_temperatures:
        return
    for n, term in enumerate(scene.terms):
        for name, value in term.temperatures.items():
            if callable(value):
                argument = f"terms[{n}]: {type(term).__name__}({name}=) gives"
                check_temperature(value, argument, end)
