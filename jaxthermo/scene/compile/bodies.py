"""Bodies before a run: networks, initial states, and the limits that follow from them.

None of it changes as bodies and sources move.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, device_array, is_traced, namespace, rows_of, stacked
from ...errors import InputError, located
from ...material.air import body_of_air
from ...material.material import Material
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
from ...physics.sheet_conduction import Conduction, sheets_conduction
from ...physics.surface import concatenated
from ...physics.time_varying import check_temperature
from ...structures.kinds.air import AirVolume
from ...structures.kinds.full import FullVolume
from ...structures.kinds.sheet import Sheet
from ...structures.structure import AbstractStructure
from ...voxels.sharded_lattice import padded_places
from ..body_materials import AbstractMaterials
from ..scene import Body, Scene
from .groups import BodyGroup, fragment_order


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


class PreparedGroup(NamedTuple):
    """Bodies that conduct as one network, with it and their initial state."""

    number: int
    """Number of the group in the program."""
    group: BodyGroup
    network: AbstractNetwork
    references: tuple[Scalar, ...]
    """Temperature from which the state of each body counts [K]."""
    state: Float[Values, "..."]
    """State at time 0; one number where it is uniform."""
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    fragment_node: Int[np.ndarray, " s"]
    surface_map: Any
    """Surface map as bound to the bodies."""
    conductivity_parts: Float[Array, "q s"] | None
    """Fractions of each fragment, see `conductivity_parts`; None for one material."""

    @property
    def structure(self) -> AbstractStructure:
        """Nodes of all bodies."""
        return self.group.structure

    @property
    def reference(self) -> Float[Values, "*b"]:
        """References of the bodies [K]; one number where all are equal."""
        return one_or_all(self.references)

    def start_ranges(self) -> Iterator[tuple[int, Float[Values, "2"]]]:
        """Lowest and highest initial temperature of each body that has a function [K].

        Each with the number of the body in the scene.
        """
        members = zip(
            self.group.numbers,
            self.group.bodies,
            self.group.nodes,
            self.references,
            strict=True,
        )
        for number, body, nodes, reference in members:
            if not callable(body.temperature):
                continue
            theta = self.network.temperature(jnp.asarray(self.state))
            if not self.group.is_single and theta.ndim:
                theta = theta[nodes]
            # On the host nothing is compiled for each shape of a body.
            xp = namespace(theta)
            theta = xp.asarray(theta)
            yield number, xp.stack([theta.min(), theta.max()]) + reference

    def address_of(self, nodes: Int[np.ndarray, " m"]) -> Address:
        """Position of some of the nodes in the state."""
        return tuple(map(device_array, self.structure.address_of(nodes)))

    def ordered_address(
        self, nodes: Int[np.ndarray, " m"]
    ) -> tuple[Address, Int[np.ndarray, " m"]]:
        """Positions of distinct nodes in the order of the state, and the rank of each.

        In that order memory is read and written fastest.
        """
        structure = self.structure
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
        structure = self.structure
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


def one_or_all(values: Sequence[Scalar]) -> Float[Values, "*b"]:
    """Numbers as an array, or as one number where all are equal."""
    is_one = not is_traced(values) and len({float(value) for value in values}) == 1
    if is_one or len(values) == 1:
        return namespace(values).asarray(values[0])
    if is_traced(values):
        return stacked(values, jnp.result_type(*values))
    return np.asarray(values, float)


def prepare(number: int, group: BodyGroup, dtype: Any) -> PreparedGroup:
    """Network, initial state and addresses of a group of bodies."""
    references, theta = _start_of_group(group, dtype)
    body = group.bodies[0]
    conduction = _conduction(group, references[0], dtype)
    parts = _parts(body, references[0], dtype) if group.is_single else None
    return PreparedGroup(
        number=number,
        group=group,
        network=conduction.network,
        references=references,
        state=conduction.network.state_of(jnp.asarray(theta)),
        half_cell=conduction.half_cell,
        fragment_node=group.structure.fragment_node(),
        surface_map=body.surface_map.bind(group.structure, dtype),
        conductivity_parts=parts,
    )


def _conduction(group: BodyGroup, reference: Scalar, dtype: Any) -> Conduction:
    structure = group.structure
    sheets = [
        body.structure for body in group.bodies if isinstance(body.structure, Sheet)
    ]
    if sheets:
        return sheets_conduction(structure, sheets, dtype)
    if group.is_single:
        (body,) = group.bodies
        return Conduction(
            _network(body, reference, dtype),
            half_cell=_half_cells(body, reference, dtype),
        )
    table = MaterialRows.of_group(group)
    network = materials_network(
        structure,
        number=table.of_nodes,
        materials=table.materials,
        # Constant materials have no reference.
        reference=0.0,
        dtype=dtype,
    )
    return Conduction(network, half_cell=table.half_cells(group, dtype))


def _network(body: Body, reference: Scalar, dtype: Any) -> AbstractNetwork:
    structure = body.structure
    material = body.material
    if isinstance(structure, AirVolume):
        air = body_of_air(structure.air_volume, body.temperature)
        return material_network(
            structure, material=air, reference=reference, dtype=dtype
        )
    if isinstance(material, AbstractMaterials):
        return materials_network(
            structure,
            number=material.of_nodes(structure),
            materials=material.materials,
            reference=reference,
            dtype=dtype,
        )
    assert material is not None
    return material_network(
        structure, material=material, reference=reference, dtype=dtype
    )


class MaterialRows(NamedTuple):
    """Constant materials of a group of bodies, one body after the other."""

    materials: tuple[Material, ...]
    of_nodes: Int[np.ndarray, " n"]
    """Number of the material of each node."""
    of_fragments: Int[np.ndarray, " s"]
    """Number of the material under each fragment."""

    @classmethod
    def of_group(cls, group: BodyGroup) -> "MaterialRows":
        """Materials of the nodes and fragments of all bodies."""
        materials: list[Material] = []
        of_nodes = []
        of_fragments = []
        for body in group.bodies:
            structure = body.structure
            material = body.material
            first = np.int32(len(materials))
            if isinstance(material, AbstractMaterials):
                materials += material.materials
                of_nodes.append(material.of_nodes(structure) + first)
                of_fragments.append(material.of_fragments(structure.voxels) + first)
            else:
                assert material is not None
                materials.append(material)
                of_nodes.append(first)
                count = len(structure.grid.fragment_area)
                of_fragments.append(np.full(count, first))
        return cls(
            materials=tuple(materials),
            of_nodes=group.on_nodes(of_nodes),
            of_fragments=np.concatenate(of_fragments),
        )

    def half_cells(self, group: BodyGroup, dtype: Any) -> Float[Values, " s"]:
        """Conductance from each fragment to its node, k A / distance [W/K]."""
        structure = group.structure
        table = conductivity_table(self.materials, 0.0, dtype)
        normal = structure.grid.fragment_normal
        k = normal_conductivity(table[self.of_fragments], normal)
        length = structure.grid.fragment_area / structure.fragment_distance
        return k * length.astype(dtype)


def _start_of_group(
    group: BodyGroup, dtype: Any
) -> tuple[tuple[Scalar, ...], Float[Values, "..."]]:
    """References of the bodies, and the temperatures of all nodes above them [K]."""
    values: list[Any] = [body.temperature for body in group.bodies]
    are_numbers = all(
        is_traced(value) and not callable(value) and value.ndim == 0 for value in values
    )
    if are_numbers and not group.is_single:
        temperatures = stacked(values, dtype)
        fixed = jax.lax.stop_gradient(temperatures)
        return tuple(rows_of(fixed)), (temperatures - fixed)[group.member_of_node]
    starts = [
        _initial(number, body, dtype)
        for number, body in zip(group.numbers, group.bodies, strict=True)
    ]
    references = tuple(start.reference for start in starts)
    if group.is_single:
        return references, starts[0].theta
    return references, _joined_start([start.theta for start in starts], group)


def _joined_start(
    starts: list[Float[Values, "..."]], group: BodyGroup
) -> Float[Values, "..."]:
    """Temperatures of all nodes above their references [K]; one number if uniform."""
    if not is_traced(starts) and not any(theta.any() for theta in starts):
        return np.zeros((), starts[0].dtype)
    return group.on_nodes(starts)


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


class _Start(NamedTuple):
    """Initial temperatures of a body."""

    reference: Scalar
    """Their mean [K]."""
    theta: Float[Values, "..."]
    """Nodes above the reference, as a state [K]; one number where it is uniform."""


def _initial(number: int, body: Body, dtype: Any) -> _Start:
    # The reference is the initial mean and no variable: only the difference of a
    # traced initial state from it carries a derivative.
    values: Any = body.temperature
    if callable(values):
        values = values(body.structure.nodes().location)
    elif not is_traced(values):
        # One number for all nodes, which takes no memory until a run starts.
        return _Start(float(values), np.zeros((), dtype))
    theta = np.zeros(body.structure.state_shape, dtype)
    address = body.structure.node_address()
    if is_traced(values):
        values = values.astype(dtype)
        reference = jax.lax.stop_gradient(values.mean())
        start = jnp.asarray(theta).at[address].set(values - reference)
        return _Start(reference, start)
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
    return _Start(reference, device_array(theta))


def references_of(prepared: tuple[PreparedGroup, ...]) -> tuple[Scalar, ...]:
    """References of all bodies, in the order of the scene [K]."""
    references = {
        number: reference
        for group in prepared
        for number, reference in zip(group.group.numbers, group.references, strict=True)
    }
    return tuple(references[number] for number in sorted(references))


def half_cells_of(prepared: tuple[PreparedGroup, ...]) -> Float[Values, " s"]:
    """Half cells of all fragments, in the order of the scene [W/K]."""
    half_cell = concatenated([group.half_cell for group in prepared])
    index, order = fragment_order(tuple(group.group for group in prepared))
    return half_cell if order is None else half_cell[np.argsort(index)]


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
    return k * (grid.fragment_area / structure.fragment_distance).astype(dtype)


class TemperatureBounds(NamedTuple):
    """Bounds of all temperatures of nodes and surfaces [K]."""

    highest: Float[Any, ""]
    lowest: Float[Any, ""]

    def known(self) -> Forcing | None:
        """Return the bounds as numbers; None where they are traced."""
        if is_traced(self):
            return None
        return Forcing(highest=float(self.highest), lowest=float(self.lowest))


def check_bodies(scene: Scene, prepared: tuple[PreparedGroup, ...]) -> None:
    """Check initial temperatures that functions give, as a scene checks numbers.

    Raises:
        InputError: for a temperature outside the bounds.
    """
    if scene.allow_extreme_temperatures:
        return
    for group in prepared:
        for number, ends in group.start_ranges():
            check_temperature(ends, f"bodies[{number}]: Body(temperature=) gives")


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
