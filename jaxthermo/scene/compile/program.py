"""A compiled scene: all that the solver needs, and a receipt of what it contains."""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int, Shaped

from ...arrays import Time, consecutive, device_array, taken
from ...network.group_order import GroupOrder, apart, together
from ...parallel.lattice import spread
from ...physics.contact.links import ContactLinks
from ...physics.convection.enclosed_air import AirExchange
from ...physics.half_cells import varying_half_cells
from ...physics.radiation.irradiation import SceneRadiation
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface import Note
from ...physics.surface_energy_balance import SurfaceTerms
from ...structures.surface_map import Range, SurfaceState
from ..receipt_model import Receipt
from ..scene import BodyGeometry, Scene, SolvedSurface
from .bodies import TemperatureBounds
from .body_program import BodyProgram, SurfaceCoefficients
from .probes import BodyProbes
from .stable_rates import StableRates
from .surface_load import AbstractSurfaceLoad


State = tuple[Float[Array, "..."], ...]
"""Temperature above the reference at every node, one array per group of bodies [K];
where the heat capacity depends on temperature, heat over the capacity at the
reference."""


LedgerEntries = tuple[tuple[str, tuple[int, ...]], ...]
"""Lines of the energy ledger: a mechanism and the body that it heats, or the two bodies
that it carries heat between, from the first to the second."""


class SurfaceHeat(Module):
    """Outputs of a scene for the fragments of all bodies."""

    outputs: tuple[str, ...] = eqx.field(static=True)
    """Names of the outputs in the scene, see `SURFACE_OUTPUTS`."""
    area: Float[Array, " s"]
    """[m^2]"""
    convective: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the terms of convection among the surface terms."""

    def evaluate(
        self,
        terms: SurfaceTerms,
        time: Time,
        theta: Float[Array, " s"],
        by_contacts: Float[Array, " s"],
    ) -> dict[str, Float[Array, " s"]]:
        """Values of every fragment, by the name of the output.

        Args:
            terms: on the fragments, as they act above nodes of temperatures `theta`.
            time: of the loads [s].
            theta: temperatures of the nodes above the reference [K].
            by_contacts: heat rates into the fragments from other bodies [W].
        """
        values = {}
        if "heat_flux" in self.outputs:
            heat, _ = terms.rates(time, theta)
            values["heat_flux"] = (heat + by_contacts) / self.area
        if "heat_transfer_coefficient" in self.outputs:
            conductance = jnp.zeros_like(theta)
            above = theta + terms.surface_excess(time, theta)
            for number, term in terms.natural:
                if number in self.convective:
                    h = term.law.heat_transfer_coefficient(time, above)
                    conductance = conductance + jnp.asarray(term.effective_area) * h
            values["heat_transfer_coefficient"] = conductance / self.area
        return values


def surface_heat(
    scene: Scene, areas: list[Float[np.ndarray, " _"]], numbers: tuple[int, ...]
) -> SurfaceHeat | None:
    """The outputs of a scene; None if it has none.

    Args:
        scene: with the names of its outputs.
        areas: of each body's fragments [m^2].
        numbers: in the scene, of each term that acts on surfaces.
    """
    if not scene.surface_outputs:
        return None
    return SurfaceHeat(
        outputs=scene.surface_outputs,
        area=device_array(np.concatenate(areas), jnp.dtype(scene.dtype)),
        convective=tuple(
            k for k, n in enumerate(numbers) if scene.terms[n].is_convective
        ),
    )


def _static_field(**options: Any) -> Any:
    """Field of a dataclass that is no array, so that compiled programs compare it."""
    return field(metadata={"static": True}, **options)


# A plain dataclass: each new module is searched for arrays, its ledger entries too.
@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False, kw_only=True)
class Program:
    """All that the solver needs, and nothing else."""

    bodies: tuple[BodyProgram, ...]
    """Groups of bodies."""
    order: GroupOrder | None
    """None where the groups have the order of the scene."""
    surface: AbstractSurfaceLoad | None
    """None where nothing acts on any surface."""
    fragment_terms: SurfaceTerms
    """Surface terms on the fragments of all bodies, for reading temperatures."""
    contacts: tuple[ContactLinks, ...]
    enclosure: Enclosure | None
    """Radiation between surface cells."""
    fine_enclosure: Enclosure | None
    """Radiation between fragments, for reading temperatures."""
    airs: tuple[AirExchange, ...]
    """Bodies of air, which exchange heat with surfaces."""
    probes: tuple[BodyProbes, ...]
    surface_heat: SurfaceHeat | None
    """Outputs for every fragment; None for none."""
    entries: LedgerEntries = _static_field()
    sampled: bool = _static_field()
    """True if some value changes at times at which steps do not end."""

    @property
    def mesh(self) -> Mesh | None:
        """Devices that the lattices are spread over; None where there is one."""
        return next((b.network.mesh for b in self.bodies if b.network.mesh), None)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Names, each once, without exchange between bodies."""
        outer = (name for name, bodies in self.entries if len(bodies) == 1)
        return tuple(dict.fromkeys(outer))

    def group_of(self, number: int) -> int:
        """Number of the group of a body, by that of the body in the scene."""
        return next(n for n, body in enumerate(self.bodies) if number in body.numbers)

    @property
    def body_count(self) -> int:
        """Number of bodies in the scene."""
        return sum(len(body.numbers) for body in self.bodies)

    def by_body(self, values: Sequence[Float[Array, " _"]]) -> Float[Array, " b"]:
        """Values of the bodies of each group, in the order of the scene."""
        joined = values[0] if len(values) == 1 else jnp.concatenate(values)
        numbers = np.concatenate([body.numbers for body in self.bodies])
        order = np.argsort(numbers)
        is_sorted = bool((np.diff(numbers) > 0).all())
        return joined if is_sorted else taken(joined, order)

    def fragments(self) -> list[slice | Int[np.ndarray, " _"]]:
        """Fragments of each group among those of the scene."""
        slices = consecutive(body.node.shape[0] for body in self.bodies)
        if self.order is None:
            return list(slices)
        index = np.asarray(self.order.of_groups)
        return [index[of_group] for of_group in slices]

    def by_group(self, values: Shaped[Array, " s"]) -> list[Shaped[Array, " _"]]:
        """Values of all fragments of a scene, those of each group."""
        counts = [body.node.shape[0] for body in self.bodies]
        return apart(values, counts, self.order)

    def in_scene(self, values: Sequence[Float[Array, " _"]]) -> Float[Array, " s"]:
        """Values of the fragments of each group, in the order of the scene."""
        return together(values, self.order)

    def in_air(self, states: State, start: State | None = None) -> "Program":
        """The program with its terms at the temperatures of the bodies of air.

        The states are changes since `start` if that is not None.
        """
        if not self.airs:
            return self
        temperatures = {}
        for air in self.airs:
            number = self.group_of(air.body)
            body = self.bodies[number]
            state = states[number]
            if start is not None:
                state = state + start[number]
            temperatures[air.body] = body.reference + body.network.temperature(state)[0]
        load = self.surface
        if load is not None:
            by_cell = load.by_cell
            load = replace(by_cell, terms=by_cell.terms.in_air(temperatures))
        return replace(
            self,
            surface=load,
            fragment_terms=self.fragment_terms.in_air(temperatures),
            airs=tuple(
                replace(air, temperature=temperatures[air.body]) for air in self.airs
            ),
        )

    def stored_heat(self, states: State) -> Float[Array, " b"]:
        """Heat of every body above its reference [J]."""
        pairs = zip(self.bodies, states, strict=True)
        return self.by_body([body.stored(state) for body, state in pairs])

    def total_capacity(self) -> Float[Array, " b"]:
        """Heat capacity of every body [J/K]."""
        return self.by_body([body.total_capacity() for body in self.bodies])

    def surface_temperatures(
        self,
        states: State,
        time: Time | None,
        contact_excess: Sequence[Float[Array, " _"] | None],
        is_limited: bool = True,
    ) -> list[Float[Array, " _"]]:
        """Temperatures of every group's fragments above their references [K].

        Args:
            states: states of the groups.
            time: time at which loads act [s]; None if none has acted yet.
            contact_excess: excess of each group's fragments over their nodes that
                contacts cause [K].
            is_limited: False for an affine function of the states where all laws are
                linear, which may leave the range of what surrounds a fragment.
        """
        pairs = zip(self.bodies, states, strict=True)
        theta = [body.network.temperature(state) for body, state in pairs]
        below = [
            body.below(body_theta)
            for body, body_theta in zip(self.bodies, theta, strict=True)
        ]
        acting: Sequence[SurfaceState | None] = [None] * len(self.bodies)
        if time is not None:
            acting = self.in_air(states)._surface_states(
                time, [fragments for _, fragments in below], contact_excess, is_limited
            )
        return [
            body.surface_map.read(theta[n], below[n][0], body.node, acting[n])
            for n, body in enumerate(self.bodies)
        ]

    def held_fragments(self) -> Sequence[Bool[Array, " _"] | None]:
        """Fragments of each group whose temperature is prescribed; None for none."""
        areas = [term.effective_area for _, term in self.fragment_terms.prescribed]
        if not areas:
            return [None] * len(self.bodies)
        is_held = jnp.stack([jnp.asarray(area) > 0 for area in areas]).any(axis=0)
        return self.by_group(is_held)

    def _surface_states(
        self,
        time: Time,
        below: list[Float[Array, " _"]],
        contact_excess: Sequence[Float[Array, " _"] | None],
        is_limited: bool,
    ) -> Sequence[SurfaceState | None]:
        """State of the surface of each group, as far as its map needs it."""
        # The balance at the surface is solved again only for maps that read it.
        maps = [body.surface_map for body in self.bodies]
        is_limited = is_limited and any(m.is_limited for m in maps)
        is_read = is_limited or any(m.needs_excess for m in maps)
        if not (is_read or self.fragment_terms.prescribed):
            return [None] * len(self.bodies)
        terms, joined = self.terms_above(time, below)
        excess = self.by_group(terms.surface_excess(time, joined))
        equilibrium: Sequence = [None] * len(self.bodies)
        if is_limited:
            equilibrium = self.by_group(terms.equilibrium(time, joined))
        held = self.held_fragments()
        states = []
        for n, body in enumerate(self.bodies):
            body_excess = excess[n]
            contact = contact_excess[n]
            if contact is not None:
                # A fragment in contact in part has the area mean of both.
                body_excess = body_excess * body.exposed_fraction + contact
            states.append(SurfaceState(body_excess, held[n], equilibrium[n]))
        return states

    def probe_temperatures(
        self,
        states: State,
        surface: Sequence[Float[Array, " _"]],
        is_limited: bool,
    ) -> Float[Array, " p"] | None:
        """Temperatures at the probes of the scene [K]; None without any.

        Args:
            states: states of the groups.
            surface: temperatures of every group's fragments above its reference [K].
            is_limited: False where no load has acted on the surface yet.
        """
        if not self.probes:
            return None
        temperatures = []
        held = self.held_fragments()
        for probes in self.probes:
            body = self.bodies[probes.body]
            theta = body.network.temperature(states[probes.body])
            fragments = surface[probes.body]
            above = probes.read(
                theta, fragments, held[probes.body] if is_limited else None
            )
            if is_limited:
                nodes, _ = body.below(theta)
                around = Range(nodes, nodes).including_groups(fragments, body.node)
                above = probes.limited(above, theta, around, body.node)
            temperatures.append(body.reference_at(probes.address) + above)
        order = np.argsort(np.concatenate([probes.number for probes in self.probes]))
        return jnp.concatenate(temperatures)[order]

    def fragment_outputs(
        self,
        states: State,
        time: Time | None,
        contact_heat: Sequence[Float[Array, " _"] | None],
    ) -> dict[str, Float[Array, " s"]]:
        """The outputs that the scene asks for at every fragment, by name.

        `contact_heat` are the heat rates into each group's fragments by contacts [W].
        Zeros where no load has acted yet and `time` is None.
        """
        if self.surface_heat is None:
            return {}
        pairs = zip(self.bodies, states, strict=True)
        theta = [body.network.temperature(state) for body, state in pairs]
        pairs = zip(self.bodies, theta, strict=True)
        below = [body.below(body_theta)[1] for body, body_theta in pairs]
        if time is None:
            none = self.in_scene([jnp.zeros_like(body_below) for body_below in below])
            return dict.fromkeys(self.surface_heat.outputs, none)
        by_contacts = [
            jnp.zeros_like(body_below) if heat is None else heat
            for body_below, heat in zip(below, contact_heat, strict=True)
        ]
        terms, joined = self.in_air(states).terms_above(time, below)
        return self.surface_heat.evaluate(
            terms, time, joined, self.in_scene(by_contacts)
        )

    def terms_above(self, time, below: list) -> tuple[SurfaceTerms, Array]:
        """The terms on fragments as they act above nodes of these temperatures [K]."""
        varying = varying_half_cells(
            [body.network for body in self.bodies],
            fractions=[body.conductivity_parts for body in self.bodies],
            counts=[len(body_below) for body_below in below],
            order=self.order,
        )
        terms = replace(self.fragment_terms, varying=varying)
        joined = self.in_scene(below)
        if self.fine_enclosure is not None:
            radiating = joined + terms.prescribed_excess(time, joined)
            received = self.fine_enclosure.irradiation(time, radiating)
            terms = terms.irradiated(received)
        return terms, joined


# A plain dataclass: methods of modules are pytrees, which takes long for large ones.
@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False, kw_only=True)
class Compiled:
    """Programs with the initial state, surfaces and the receipt."""

    programs: tuple[Program, ...]
    """One per snapshot; they differ in numbers only."""
    starts: tuple[float, ...] = _static_field()
    """Start of each program [s]; the first at 0."""
    acting: tuple[int, ...] = _static_field()
    """Numbers of the terms that act."""
    classes: tuple[int, ...] = _static_field()
    """Class of each body, see `grouped_numbers`."""
    start: tuple[Float[Array | np.ndarray, "..."], ...]
    """State at time 0; one number where it is uniform."""
    state_shapes: tuple[tuple[int, ...], ...] = _static_field()
    """Shape of the state of each group of bodies."""
    geometries: tuple[BodyGeometry, ...] = _static_field()
    """Shape and pose of each body."""
    emissivity: SurfaceCoefficients
    absorptivity: SurfaceCoefficients
    radiation: SceneRadiation
    """Radiation that reaches the surfaces, absorbed or not."""
    temperatures: TemperatureBounds
    """Bounds of temperatures up to the end."""
    stable_rates: StableRates
    """Rates that limit the explicit steps of each group."""
    stable_step: Float[Any, ""]
    """Largest explicit step that is stable [s]; infinite without a limit."""
    notes: tuple[tuple[str, Note], ...]
    """Remarks on the validity of laws, with the mechanism of each."""
    receipt: Receipt = _static_field()
    # Not in the programs, which would be compiled again for other times of a table.
    breakpoints: tuple[float, ...] = _static_field(default=())
    """Times that steps end at, besides the save times [s]."""

    @cached_property
    def surfaces(self) -> tuple[SolvedSurface, ...]:
        """Surfaces of the bodies, for a camera."""
        bodies = zip(
            self.geometries,
            self.emissivity.by_body(),
            self.absorptivity.by_body(),
            strict=True,
        )
        return tuple(SolvedSurface(*body) for body in bodies)

    @property
    def state(self) -> State:
        """State at time 0, in new arrays, which a run may overwrite."""
        mesh = self.program.mesh
        pairs = zip(self.start, self.state_shapes, strict=True)
        return tuple(_new_state(values, shape, mesh) for values, shape in pairs)

    @property
    def program(self) -> Program:
        """The first one; the only one where nothing moves."""
        return self.programs[0]

    def number_at(self, time: float) -> int:
        """Number of the program that is valid from a time on [s]."""
        # The start of a step may be a rounding error before that of its program.
        return bisect.bisect_right(self.starts, time * (1 + 1e-12)) - 1


def _new_state(
    values: Float[Array | np.ndarray, "..."], shape: tuple[int, ...], mesh: Mesh | None
) -> Float[Array, "..."]:
    if mesh is not None:
        return spread(mesh, np.broadcast_to(values, shape))
    return _filled(values, shape) if values.shape != shape else jnp.array(values)


# One program; `jnp.full` dispatches several operations.
@partial(jax.jit, static_argnums=1)
def _filled(value: Float[Any, ""], shape: tuple[int, ...]) -> Float[Array, "..."]:
    return jnp.broadcast_to(value, shape)
