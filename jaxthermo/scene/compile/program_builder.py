"""From snapshots of a scene to programs, alike but for their numbers."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...network.nonlinear import NonlinearNetwork
from ...physics.contact.links import ContactSide
from ...physics.contact.pairs import ContactPairs, no_pairs
from ...physics.flux_law import TemperatureRange, bound
from ...physics.heat_source import VolumeBinding
from ...physics.newton_iteration_bound import MAX_ITERATIONS, newton_iterations
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.term import (
    AbstractExchangeTerm,
    AbstractPairTerm,
    AbstractVolumeTerm,
    Omitted,
    concatenated,
)
from ...physics.time_varying import breakpoints, for_jit, is_unknown_function
from ..receipt import Omission, Part, on_body
from ..scene import Scene
from .bodies import PreparedBody, device_address
from .linear_load import linear_programs
from .program import BodyProgram, LedgerEntry, Program, VolumeLoad
from .snapshots import PairKey, Snapshot, pair_counts
from .surface_load import body_cells, surface_load
from .surface_terms import BoundSurface, acting, ledger_bodies


# Nodes that heat sources reach, by the numbers of the term and of the body.
_Volumes = dict[tuple[int, int], VolumeBinding]


def bind_volumes(
    scene: Scene, names: tuple[str, ...]
) -> tuple[_Volumes, list[Omission]]:
    """Nodes that volume terms heat, and the terms that heat none."""
    found, omitted = {}, []
    for number, term in enumerate(scene.terms):
        if not isinstance(term, AbstractVolumeTerm):
            continue
        for index, body in enumerate(scene.bodies):
            result = term.bind(body.structure, index)
            if isinstance(result, Omitted):
                name = on_body(names[number], index, scene)
                omitted.append(Omission(name, result.reason))
            else:
                found[number, index] = result
    return found, omitted


class Ledger(NamedTuple):
    """Entries of the energy ledger, which are the same at all snapshots."""

    entries: tuple[LedgerEntry, ...]
    number: dict[tuple[int, ...], int]
    """Number of each entry, by its term and its body, or both bodies."""

    def parts(self, snapshot: Snapshot) -> tuple[Part, ...]:
        """The surface that each entry acts on."""
        found = []
        surface, bindings = snapshot.surface.surface, snapshot.surface.bindings
        for entry, (number, *bodies) in zip(self.entries, self.number, strict=True):
            area = surface.bodies[bodies[0]].grid.fragment_area
            if len(bodies) == 2:
                pairs = snapshot.pairs.get((number, bodies[0], bodies[1]))
                reached = 0.0 if pairs is None else float(pairs.area.sum())
            else:
                acts = [
                    surface.apart(binding.acts)[bodies[0]]
                    for n, binding in bindings
                    if n == number
                ]
                reached = float(area[np.any(acts, axis=0)].sum()) if acts else 0.0
            part = reached / float(area.sum())
            found.append(Part(entry.mechanism, tuple(bodies), reached, part))
        return tuple(found)


def number_entries(
    names: tuple[str, ...], snapshots: list[Snapshot], volumes: _Volumes, prune: bool
) -> Ledger:
    """An entry for every body that a term acts on, in the order of the terms."""
    surfaces = [snapshot.surface for snapshot in snapshots]
    keys: set[tuple[int, ...]] = {
        (number, body)
        for number, bodies in ledger_bodies(surfaces, prune).items()
        for body in bodies
    }
    # Sorted by term, then by body, then by the other body of a pair.
    ordered = sorted({*keys, *volumes, *pair_counts(snapshots)})
    entries = tuple(LedgerEntry(names[key[0]], *key[1:]) for key in ordered)
    return Ledger(entries, {key: n for n, key in enumerate(ordered)})


class ProgramBuilder:
    """Makes the program of each snapshot, in arrays of the same shapes."""

    def __init__(
        self,
        scene: Scene,
        prepared: tuple[PreparedBody, ...],
        snapshots: list[Snapshot],
        volumes: _Volumes,
        ledger: Ledger,
        temperatures: TemperatureRange | None,
    ):
        self.scene, self.prepared, self.ledger = scene, prepared, ledger
        self.volumes, self.snapshots = volumes, snapshots
        self.pair_counts = pair_counts(snapshots)
        surfaces = [snapshot.surface for snapshot in snapshots]
        # Cells must be the same at all snapshots: they go by where a term ever acts.
        self.acting = acting(surfaces)
        self.numbers = list(dict.fromkeys(n for n, _ in surfaces[0].bindings))
        self.iterations = max(self._iterations(each, temperatures) for each in surfaces)
        # Only values of terms that act decide where steps end.
        used = sorted({key[0] for key in ledger.number})
        self.values = [value for n in used for value in scene.terms[n].values]
        self.exchange = next(
            (t for n in used if isinstance(t := scene.terms[n], AbstractExchangeTerm)),
            None,
        )

    def programs(self) -> tuple[Program, ...]:
        """One program per snapshot."""
        made = tuple(self._program(snapshot) for snapshot in self.snapshots)
        # Linear sums are made on the host, in double precision.
        return jax.tree.map(_on_device, linear_programs(made) or made)

    def _program(self, snapshot: Snapshot) -> Program:
        fine = None
        if self.exchange is not None:
            fine = self.exchange.enclosure(snapshot.surface.surface)
        terms = self._fragment_terms(snapshot.surface)
        terms = replace(terms, iterations=self.iterations)
        load, enclosure = self._surface_load(snapshot.surface, terms, fine)
        values = self.values
        return Program(
            bodies=tuple(self._body(n, snapshot) for n in range(len(self.prepared))),
            surface=load,
            fragment_terms=terms,
            contacts=tuple(
                self._contact(key, snapshot.pairs.get(key), size)
                for key, size in self.pair_counts.items()
            ),
            enclosure=enclosure,
            fine_enclosure=fine,
            entries=self.ledger.entries,
            breakpoints=tuple(sorted({k for v in values for k in breakpoints(v)})),
            sampled=any(is_unknown_function(value) for value in values),
        )

    def _fragment_terms(self, bound_surface: BoundSurface) -> SurfaceTerms:
        surface = bound_surface.surface
        order = {number: k for k, number in enumerate(self.numbers)}
        each = lambda bindings: tuple(
            (order[n], bound(b.effective_area, b.law)) for n, b in bindings
        )
        pairs = zip(self.ledger.number, self.ledger.entries, strict=True)
        names = {key[0]: entry.mechanism for key, entry in pairs}
        # Where a temperature is prescribed, that term holds the half cell.
        half_cells = [
            body.half_cell * body.natural.astype(body.dtype) for body in surface.bodies
        ]
        return SurfaceTerms(
            names=tuple(names[number] for number in self.numbers),
            half_cell=concatenated(half_cells),
            natural=each(bound_surface.natural),
            prescribed=each(bound_surface.prescribed),
        )

    def _surface_load(
        self, bound_surface: BoundSurface, terms: SurfaceTerms, fine: Enclosure | None
    ):
        """The load on surface cells, and the radiation between them."""
        surface = bound_surface.surface
        acting = list(zip(*map(surface.apart, self.acting), strict=True))
        # Fragments of one cell must be in one patch of the radiative exchange.
        groups: list = [None] * len(surface.bodies)
        if fine is not None:
            groups = surface.apart(np.asarray(fine.exchange.patch))
        found = [
            body_cells(n, body, list(acting[n]) if acting else [], groups[n])
            for n, body in enumerate(self.prepared)
        ]
        cells, cell = zip(*found, strict=True)
        entry = self.ledger.number
        rows = tuple(
            tuple(entry.get((number, n), -1) for n in range(len(surface.bodies)))
            for number in self.numbers
        )
        load, joined = surface_load(
            terms, cells, cell, surface.references, rows, len(entry)
        )
        if fine is None or load is None:
            return load, None
        return load, fine.coarsened(joined, load.counts)

    def _iterations(
        self, bound_surface: BoundSurface, temperatures: TemperatureRange | None
    ) -> int:
        """Newton iterations: the most that any body needs; linear laws need none."""
        surface, found, start = bound_surface.surface, [], 0
        terms = self._fragment_terms(bound_surface)
        for n, body in enumerate(surface.bodies):
            cells = slice(start, start + len(body.area))
            start = cells.stop
            entries = [(number, n) in self.ledger.number for number in self.numbers]
            acting = set(np.flatnonzero(entries).tolist())
            own = terms.selected(cells, acting, surface.references[n])
            if own.is_linear:
                continue
            if isinstance(self.prepared[n].network, NonlinearNetwork):
                return MAX_ITERATIONS
            natural = [term for _, term in own.natural]
            found.append(newton_iterations(body.half_cell, natural, temperatures))
        return max(found, default=MAX_ITERATIONS)

    def _contact(self, key: PairKey, pairs: ContactPairs | None, size: int):
        number, *bodies = key
        term = self.scene.terms[number]
        assert isinstance(term, AbstractPairTerm)
        sides = [self._side(body) for body in bodies]
        if pairs is None:
            pairs = no_pairs(*(len(side.fragment_node) for side in sides))
        return term.bind(pairs, (sides[0], sides[1]), self.ledger.number[key], size)

    def _side(self, index: int) -> ContactSide:
        body = self.prepared[index]
        area = body.body.structure.grid.fragment_area
        return ContactSide(
            index, body.fragment_node, body.address, body.half_cell, area, body.network
        )

    def _body(self, index: int, snapshot: Snapshot) -> BodyProgram:
        body = self.prepared[index]
        surface = snapshot.surface.surface.bodies[index]
        touched = any(index in key[1:] for key in self.pair_counts)
        # Bodies that never touch anything need no array of ones.
        exposed = surface.exposed_fraction if touched else np.ones((), surface.dtype)
        nodes, node = np.unique(body.fragment_node, return_inverse=True)
        return BodyProgram(
            network=body.network,
            reference=jnp.asarray(body.reference, surface.dtype),
            sources=tuple(
                _volume_load(self.ledger.number[key], found, body, surface.dtype)
                for key, found in self.volumes.items()
                if key[1] == index
            ),
            address=device_address(body.address, nodes),
            node=jnp.asarray(node.reshape(-1).astype(np.int32)),
            exposed_fraction=jnp.asarray(exposed),
            surface_map=body.surface_map,
        )


def _volume_load(
    entry: int, found: VolumeBinding, body: PreparedBody, dtype: Any
) -> VolumeLoad:
    nodes = np.flatnonzero(found.volume)
    address = device_address(body.address, nodes)
    reached = np.asarray(found.volume[nodes], dtype)
    return VolumeLoad(
        entry=entry,
        address=address,
        rise=jnp.asarray(reached) / body.network.capacity_at(address),
        volume=jnp.asarray(reached.sum(dtype=float), dtype),
        heat_rate_density=for_jit(found.heat_rate_density, dtype),
    )


def _on_device(leaf: Any) -> Any:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray | np.generic) else leaf
