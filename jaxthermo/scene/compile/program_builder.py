"""From snapshots of a scene to programs, alike but for their numbers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from ...arrays import consecutive, device_array, typed_array
from ...memo.once import once
from ...network.group_order import GroupOrder
from ...network.network import Address
from ...network.segment_sums import segment_sums, sums_of_lists
from ...physics.contact.links import ContactLinks
from ...physics.contact.search import Joint
from ...physics.convection.enclosed_air import AirExchange, EnclosedAir
from ...physics.convection.mixed_convection import (
    Beside,
    MixedConvection,
    mixed,
    mixed_law,
    mixing,
)
from ...physics.flux_law import BoundTerm, Values, bound
from ...physics.heat_source import VolumeBinding
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface import Omitted, Surface
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.term import (
    AbstractExchangeTerm,
    AbstractPairTerm,
    AbstractSurfaceTerm,
    AbstractTerm,
    AbstractVolumeTerm,
)
from ...physics.time_varying import breakpoints, changes_unseen, for_jit
from ..scene import Scene, mechanism_names
from .bodies import PreparedGroup
from .body_program import BodyProgram, Members, VolumeLoad
from .claims import acting_fraction
from .contacts import PairKey, TouchingPairs
from .groups import BodyGroup, fragment_order
from .linear_load import linear_programs
from .probes import bind_probes
from .program import Program, surface_heat
from .snapshots import Snapshot, acting
from .surface_cells import body_cells
from .surface_load import CellLayout


Volumes = dict[tuple[int, int], VolumeBinding]
"""Nodes that heat sources reach, by the numbers of the term and of the body."""

Ledger = dict[tuple[int, ...], str]
"""Mechanisms in the energy ledger, in its order, by the numbers of the term and of its
body, or of both its bodies; the same at all snapshots."""


def bind_volumes(scene: Scene) -> tuple[Volumes, list[tuple[int, Omitted]]]:
    """Nodes that volume terms heat, and the numbers of terms that heat none."""
    bindings = {}
    omitted = []
    for number, term in enumerate(scene.terms):
        if not isinstance(term, AbstractVolumeTerm):
            continue
        for index, body in enumerate(scene.bodies):
            result = term.bind(body.structure, index)
            if isinstance(result, Omitted):
                omitted.append((number, Omitted(result.reason, index)))
            else:
                bindings[number, index] = result
    return bindings, omitted


def ledger_entries(
    scene: Scene, snapshots: list[Snapshot], volumes: Volumes, prune: bool
) -> Ledger:
    """An entry for every body that a term acts on, in the order of the terms."""
    first = snapshots[0]
    omitted = {(number, body) for number, (_, body) in first.omitted}
    names = mechanism_names(scene)
    airs = {
        (number, term.air_number)
        for number, term in enumerate(scene.terms)
        if isinstance(term, EnclosedAir)
    }
    keys: set[tuple[int, ...]] = {*volumes, *_pair_counts(snapshots), *airs}
    for (number, _), where in zip(first.bindings, acting(snapshots), strict=True):
        for body, is_acting in enumerate(first.surface.apart(where)):
            # Without pruning an idle term has entries too: they stay 0.
            idle = not omitted & {(number, None), (number, body)}
            if is_acting.any() or (idle and not prune):
                keys.add((number, body))
    # Sorted by term, then by body, then by the second body of a pair.
    return {key: names[key[0]] for key in sorted(keys)}


def acting_terms(ledger: Ledger) -> tuple[int, ...]:
    """Numbers of the terms that act somewhere."""
    return tuple(sorted({key[0] for key in ledger}))


def breakpoints_of(scene: Scene, acting: tuple[int, ...]) -> tuple[float, ...]:
    """Times at which a value of a term that acts has a kink or jump [s]."""
    values = [value for number in acting for value in scene.terms[number].values]
    return tuple(sorted({time for value in values for time in breakpoints(value)}))


class _OnSurface(NamedTuple):
    """Parts of the programs of all snapshots on one surface."""

    half_cell: Float[Values, " s"]
    """Conductance from the natural part of each fragment to its node [W/K]."""
    bodies: tuple[BodyProgram, ...]
    cells: CellLayout | None
    fine_enclosure: Enclosure | None
    """Radiation between fragments; None without a term for it."""
    enclosure: Enclosure | None
    """Radiation between surface cells."""
    accuracy: Any
    """Accuracy of the exchange, see `AbstractExchangeTerm.enclosure`."""


@dataclass(frozen=True, eq=False)
class ProgramBuilder:
    """Bodies, snapshots and ledger from which the programs of a scene are made."""

    scene: Scene
    prepared: tuple[PreparedGroup, ...]
    snapshots: list[Snapshot]
    volumes: Volumes
    ledger: Ledger

    @property
    def _dtype(self) -> Any:
        return self.snapshots[0].surface.dtype

    @cached_property
    def _entry(self) -> dict[tuple[int, ...], int]:
        return {key: n for n, key in enumerate(self.ledger)}

    @cached_property
    def _names(self) -> dict[int, str]:
        """Names of the terms on the surface, by their number in the scene."""
        mechanism = {key[0]: name for key, name in self.ledger.items()}
        return {n: mechanism[n] for n, _ in self.snapshots[0].bindings}

    @cached_property
    def _rows(self) -> tuple[tuple[int, ...], ...]:
        """Entry of each of these terms on each body in the ledger; -1 for none."""
        body_count = len(self.scene.bodies)
        return tuple(
            tuple(self._entry.get((n, body), -1) for body in range(body_count))
            for n in self._names
        )

    @cached_property
    def _order(self) -> tuple[Int[np.ndarray, " s"], GroupOrder | None]:
        """Fragment of the scene of each fragment of the groups, and their order."""
        return fragment_order(tuple(body.group for body in self.prepared))

    @cached_property
    def _group_of(self) -> dict[int, tuple[int, int]]:
        """Number of the group of each body, and of its first fragment in the group."""
        return {
            number: (body.number, fragments.start)
            for body in self.prepared
            for number, fragments in zip(
                body.group.numbers, body.group.fragments, strict=True
            )
        }

    def _by_group(self, values: Shaped[np.ndarray, " s"]) -> list[Any]:
        """Values of the fragments of each group."""
        counts = [len(body.fragment_node) for body in self.prepared]
        index, _ = self._order
        return [values[index[fragments]] for fragments in consecutive(counts)]

    @cached_property
    def _acting(self) -> list[Bool[np.ndarray, " s"]]:
        # Cells must be the same at all snapshots: they go by where a term ever acts.
        return acting(self.snapshots)

    @cached_property
    def _mixing(self) -> dict[int, list[Beside]]:
        """Natural bindings of convection that act beside others at any snapshot."""
        first = self.snapshots[0]

        def fraction(place: int) -> Float[np.ndarray, " s"]:
            number, _ = first.natural[place]
            term = self.scene.terms[number]
            assert isinstance(term, AbstractSurfaceTerm)
            # Natural bindings are the first of all.
            return acting_fraction(term, first.surface, self._acting[place])

        return mixing(first.natural, fraction, self._dtype)

    @cached_property
    def _pair_sizes(self) -> dict[PairKey, int]:
        return _pair_counts(self.snapshots)

    @cached_property
    def _used_terms(self) -> list[AbstractTerm]:
        return [self.scene.terms[number] for number in acting_terms(self.ledger)]

    @cached_property
    def _exchange(self) -> AbstractExchangeTerm | None:
        terms = self._used_terms
        return next((t for t in terms if isinstance(t, AbstractExchangeTerm)), None)

    @cached_property
    def _bodies(self) -> tuple[BodyProgram, ...]:
        return tuple(self._body(body) for body in self.prepared)

    def programs(self) -> tuple[tuple[Program, ...], tuple[str, ...]]:
        """The program of each snapshot, all with arrays of the same shapes, and notes.

        What snapshots share is made once, and is the same arrays in their programs. The
        notes for the receipt state the accuracy of an exchange.
        """
        values = [value for term in self._used_terms for value in term.values]
        # Areas of fragments and nodes of probes do not change as bodies move.
        probes = ()
        if self.scene.probes:
            probes = bind_probes(self.scene, self.prepared, self._dtype)
        surfaces = self.snapshots[0].surface.bodies
        areas = [body.grid.fragment_area for body in surfaces]
        outputs = surface_heat(self.scene, areas, tuple(self._names))
        airs = self._airs()
        on_surface = once(self._on_surface)
        contacts = once(self._contacts)
        programs = []
        accuracies = []
        for snapshot in self.snapshots:
            parts = on_surface(snapshot.surface)
            accuracies.append(parts.accuracy)
            terms = self._fragment_terms(snapshot, parts.half_cell)
            cells = parts.cells
            program = Program(
                bodies=parts.bodies,
                surface=None if cells is None else cells.load(terms),
                fragment_terms=terms,
                order=self._order[1],
                contacts=contacts(snapshot.pairs),
                enclosure=parts.enclosure,
                fine_enclosure=parts.fine_enclosure,
                airs=airs,
                probes=probes,
                surface_heat=outputs,
                entries=tuple((name, key[1:]) for key, name in self.ledger.items()),
                sampled=any(changes_unseen(value) for value in values),
            )
            programs.append(program)
        # Linear sums are made on the host, in double precision.
        if all(program.fragment_terms.is_linear for program in programs):
            programs = linear_programs(programs) or programs
        return tuple(programs), _accuracy_notes(self._exchange, accuracies)

    def _on_surface(self, surface: Surface) -> _OnSurface:
        touched = {
            self._group_of[number][0] for key in self._pair_sizes for number in key[1:]
        }
        exposed = self._by_group(
            np.concatenate([body.exposed_fraction for body in surface.bodies])
        )
        fine = None
        accuracy = None
        if self._exchange is not None:
            fine, accuracy = self._exchange.enclosure(surface)
        cells = self._cells(fine)
        # Where a temperature is prescribed, that term holds the half cell.
        half_cell = surface.half_cell
        if not surface.natural.all():
            half_cell = half_cell * surface.natural.astype(surface.dtype)
        return _OnSurface(
            half_cell=half_cell,
            bodies=tuple(
                replace(body, exposed_fraction=exposed[n]) if n in touched else body
                for n, body in enumerate(self._bodies)
            ),
            cells=cells,
            fine_enclosure=fine,
            enclosure=None if fine is None or cells is None else cells.enclosure(fine),
            accuracy=accuracy,
        )

    def _airs(self) -> tuple[AirExchange, ...]:
        return tuple(
            term.exchanged(
                self._entry[number, term.air_number],
                walls=tuple(
                    entry
                    for key, entry in self._entry.items()
                    if key[0] == number and key[1] != term.air_number
                ),
                dtype=self._dtype,
            )
            for number, term in enumerate(self.scene.terms)
            if isinstance(term, EnclosedAir)
        )

    @cached_property
    def _fragment_term(self) -> Callable[..., BoundTerm]:
        return once(bound)

    @cached_property
    def _mixed_law(self) -> Callable[..., MixedConvection]:
        return once(mixed_law)

    def _fragment_terms(
        self, snapshot: Snapshot, half_cell: Float[Values, " s"]
    ) -> SurfaceTerms:
        """The terms on the fragments of all bodies, by their number in the scene."""
        order = {number: k for k, number in enumerate(self._names)}

        def numbered(bindings):
            return tuple(
                (order[number], self._fragment_term(b.effective_area, b.law))
                for number, b in bindings
            )

        natural = mixed(snapshot.natural, self._mixing, self._mixed_law)
        return SurfaceTerms(
            names=tuple(self._names.values()),
            half_cell=half_cell,
            natural=numbered(natural),
            prescribed=numbered(snapshot.prescribed),
            radiating=numbered(snapshot.radiating),
        )

    @cached_property
    def _cells(self) -> Callable[[Enclosure | None], CellLayout | None]:
        # Cells go by where terms act at any snapshot: moving bodies have the same ones
        # as long as no patches of an exchange divide them.
        return once(self._cell_layout)

    def _cell_layout(self, fine: Enclosure | None) -> CellLayout | None:
        """The surface cells of all bodies."""
        # By term, and by group.
        masks = [self._by_group(is_acting) for is_acting in self._acting]
        # Fragments of one cell must be in one patch of the radiative exchange.
        patches: list = [None] * len(self.prepared)
        if fine is not None:
            patches = self._by_group(np.asarray(fine.patch))
        cells = []
        numbers = []
        first = 0
        for n, body in enumerate(self.prepared):
            group_masks = [mask[n] for mask in masks]
            layout, cell = body_cells(body, group_masks, patches[n])
            cells.append(layout)
            numbers.append(np.where(cell >= 0, cell + first, -1))
            first += 0 if layout is None else layout.node.shape[0]
        index, _ = self._order
        joined = np.empty(len(index), np.int64)
        joined[index] = np.concatenate(numbers)
        return CellLayout.of_groups(
            cells,
            cell=joined,
            references=[body.reference for body in self.prepared],
            entries=self._rows,
            entry_count=len(self.ledger),
            dtype=self._dtype,
        )

    def _contacts(
        self, pairs: dict[PairKey, TouchingPairs]
    ) -> tuple[ContactLinks, ...]:
        """Links of all touching bodies, those of the same term and groups together."""
        joined: dict[tuple[int, int, int], list[PairKey]] = {}
        for key in self._pair_sizes:
            number, first, second = key
            groups = self._group_of[first][0], self._group_of[second][0]
            joined.setdefault((number, *groups), []).append(key)
        return tuple(self._contact(keys, pairs) for keys in joined.values())

    def _contact(
        self, keys: list[PairKey], pairs_by_key: dict[PairKey, TouchingPairs]
    ) -> ContactLinks:
        joints = []
        for key in keys:
            _, *bodies = key
            pairs = pairs_by_key.get(key)
            first, second = (self._group_of[body][1] for body in bodies)
            joints.append(
                Joint(
                    pairs=None if pairs is None else pairs.shifted(first, second),
                    entry=self._entry[key],
                    size=self._pair_sizes[key],
                    bodies=(bodies[0], bodies[1]),
                )
            )
        number, *bodies = keys[0]
        term = self.scene.terms[number]
        assert isinstance(term, AbstractPairTerm)
        first, second = (self.prepared[self._group_of[body][0]] for body in bodies)
        return term.bind(joints, (first, second))

    def _body(self, body: PreparedGroup) -> BodyProgram:
        structure = body.structure
        group = body.group
        address, node = structure.found("surface_nodes", lambda: _surface_nodes(body))
        members = None
        if not group.is_single:
            members = structure.found("members", lambda: _members_of(group))
        terms = {term for term, number in self.volumes if number in group.numbers}
        return BodyProgram(
            numbers=group.numbers,
            fragment_counts=tuple(c.stop - c.start for c in group.fragments),
            network=body.network,
            reference=typed_array(body.reference, self._dtype),
            members=members,
            sources=tuple(self._volume_load(term, body) for term in sorted(terms)),
            address=address,
            node=node,
            # Bodies that never touch anything need no array of ones.
            exposed_fraction=np.ones((), self._dtype),
            surface_map=body.surface_map,
            conductivity_parts=body.conductivity_parts,
        )

    def _volume_load(self, term: int, body: PreparedGroup) -> VolumeLoad:
        dtype = self._dtype
        group = body.group
        heated = [number for number in group.numbers if (term, number) in self.volumes]
        bindings = [self.volumes[term, number] for number in heated]
        volume = np.zeros(body.structure.node_count)
        nodes_of = dict(zip(group.numbers, group.nodes, strict=True))
        for number, binding in zip(heated, bindings, strict=True):
            volume[nodes_of[number]] = binding.volume
        nodes = np.flatnonzero(volume)
        sections = body.section_places(nodes)
        reached = np.zeros(len(sections.address[0]), dtype)
        # A term has the same values on all bodies.
        density = bindings[0].heat_rate_density
        total = 1.0
        if bindings[0].heat_rate is not None:
            # Each cubic metre has one share of the heat rate of all bodies.
            total = self._heated_volume(term)
            density = bindings[0].heat_rate
        reached[sections.places] = volume[nodes] / total
        by_body = [binding.volume.sum() / total for binding in bindings]
        return VolumeLoad(
            entries=tuple(self._entry[term, number] for number in heated),
            address=sections.address,
            rise=jnp.asarray(reached) / body.network.capacity_at(sections.address),
            mesh=body.network.mesh,
            volume=np.asarray(by_body, dtype),
            heat_rate_density=for_jit(density, dtype),
        )

    def _heated_volume(self, number: int) -> float:
        """Volume of all bodies that a term heats [m^3]."""
        volumes = [
            float(binding.volume.sum())
            for (term, _), binding in self.volumes.items()
            if term == number
        ]
        return sum(volumes)


def _accuracy_notes(
    exchange: AbstractExchangeTerm | None, accuracies: list[Any]
) -> tuple[str, ...]:
    """The note on the least accurate snapshot."""
    stated = [accuracy for accuracy in accuracies if accuracy is not None]
    if exchange is None or not stated:
        return ()
    return (
        f"{exchange.name}: {max(stated, key=lambda accuracy: accuracy.error).note}",
    )


def _members_of(group: BodyGroup) -> Members:
    return Members(
        of_node=device_array(group.member_of_node),
        of_fragment=device_array(group.member_of_fragment),
        sums=sums_of_lists(group.nodes, group.structure.node_count),
        fragment_sums=segment_sums(group.fragments, len(group.member_of_fragment)),
    )


def _surface_nodes(body: PreparedGroup) -> tuple[Address, Int[Array, " s"]]:
    """Position of the surface nodes, and the index of each fragment's node."""
    nodes, node = np.unique(body.fragment_node, return_inverse=True)
    address, rank = body.ordered_address(nodes)
    return address, device_array(rank[node.reshape(-1)].astype(np.int32))


def _pair_counts(snapshots: list[Snapshot]) -> dict[PairKey, int]:
    """Largest number of touching pairs at any snapshot, by bodies that ever touch."""
    counts: dict[PairKey, int] = {}
    for snapshot in snapshots:
        for key, pairs in snapshot.pairs.items():
            counts[key] = max(counts.get(key, 0), pairs.rows)
    return {key: counts[key] for key in sorted(counts)}
