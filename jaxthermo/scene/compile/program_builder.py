"""From snapshots of a scene to programs, alike but for their numbers."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...network.nonlinear import NonlinearNetwork
from ...physics.contact.search import ContactPairs, no_pairs
from ...physics.flux_law import TemperatureRange, bound
from ...physics.heat_source import VolumeBinding
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface_energy_balance import MAX_ITERATIONS, SurfaceTerms
from ...physics.term import (
    AbstractExchangeTerm,
    AbstractPairTerm,
    AbstractVolumeTerm,
    Omitted,
    concatenated,
)
from ...physics.time_varying import breakpoints, for_jit, is_unknown_function
from ..scene import Scene
from .bodies import PreparedBody, device_address
from .linear_load import linear_programs
from .program import BodyProgram, LedgerEntry, Program, VolumeLoad
from .snapshots import PairKey, Snapshot, acting, pair_counts
from .surface_load import body_cells, surface_load


# Nodes that heat sources reach, by the numbers of the term and of the body.
_Volumes = dict[tuple[int, int], VolumeBinding]

# Entries of the energy ledger, the same at all snapshots, by the numbers of the term
# and of its body, or both bodies; they are counted in this order.
_Ledger = dict[tuple[int, ...], LedgerEntry]


def bind_volumes(scene: Scene) -> tuple[_Volumes, list[tuple[int, Omitted]]]:
    """Nodes that volume terms heat, and the numbers of terms that heat none."""
    found, omitted = {}, []
    for number, term in enumerate(scene.terms):
        if not isinstance(term, AbstractVolumeTerm):
            continue
        for index, body in enumerate(scene.bodies):
            result = term.bind(body.structure, index)
            if isinstance(result, Omitted):
                omitted.append((number, Omitted(result.reason, index)))
            else:
                found[number, index] = result
    return found, omitted


def ledger_entries(
    names: tuple[str, ...], snapshots: list[Snapshot], volumes: _Volumes, prune: bool
) -> _Ledger:
    """An entry for every body that a term acts on, in the order of the terms."""
    first = snapshots[0]
    omitted = {(number, body) for number, (_, body) in first.omitted}
    keys: set[tuple[int, ...]] = {*volumes, *pair_counts(snapshots)}
    for (number, _), where in zip(first.bindings, acting(snapshots), strict=True):
        for body, acts in enumerate(first.surface.apart(where)):
            # Without pruning an idle term has entries too: they stay 0.
            idle = not omitted & {(number, None), (number, body)}
            if acts.any() or (idle and not prune):
                keys.add((number, body))
    # Sorted by term, then by body, then by the other body of a pair.
    return {key: LedgerEntry(names[key[0]], *key[1:]) for key in sorted(keys)}


class ProgramBuilder:
    """Makes the program of each snapshot, in arrays of the same shapes."""

    def __init__(
        self,
        scene: Scene,
        prepared: tuple[PreparedBody, ...],
        snapshots: list[Snapshot],
        volumes: _Volumes,
        ledger: _Ledger,
        temperatures: TemperatureRange | None,
    ):
        self.scene, self.prepared, self.ledger = scene, prepared, ledger
        self.volumes, self.snapshots = volumes, snapshots
        self.entry = {key: n for n, key in enumerate(ledger)}
        self.pair_counts = pair_counts(snapshots)
        # Cells must be the same at all snapshots: they go by where a term ever acts.
        self.acting = acting(snapshots)
        self.numbers = list(dict.fromkeys(n for n, _ in snapshots[0].bindings))
        self.iterations = max(self._iterations(s, temperatures) for s in snapshots)
        # Only values of terms that act decide where steps end.
        used = sorted({key[0] for key in ledger})
        self.values = [value for n in used for value in scene.terms[n].values]
        self.exchange = next(
            (t for n in used if isinstance(t := scene.terms[n], AbstractExchangeTerm)),
            None,
        )

    def programs(self) -> tuple[Program, ...]:
        """One program per snapshot."""
        made = tuple(self._program(snapshot) for snapshot in self.snapshots)
        # Linear sums are made on the host, in double precision.
        if all(program.fragment_terms.is_linear for program in made):
            made = linear_programs(made) or made
        host = np.ndarray | np.generic
        on_device = lambda x: jnp.asarray(x) if isinstance(x, host) else x
        return jax.tree.map(on_device, made)

    def _program(self, snapshot: Snapshot) -> Program:
        fine = None
        if self.exchange is not None:
            fine = self.exchange.enclosure(snapshot.surface)
        terms = replace(self._fragment_terms(snapshot), iterations=self.iterations)
        load, enclosure = self._surface_load(snapshot, terms, fine)
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
            entries=tuple(self.ledger.values()),
            breakpoints=tuple(sorted({k for v in values for k in breakpoints(v)})),
            sampled=any(is_unknown_function(value) for value in values),
        )

    def _fragment_terms(self, snapshot: Snapshot) -> SurfaceTerms:
        order = {number: k for k, number in enumerate(self.numbers)}
        each = lambda bindings: tuple(
            (order[n], bound(b.effective_area, b.law)) for n, b in bindings
        )
        names = {key[0]: entry.mechanism for key, entry in self.ledger.items()}
        # Where a temperature is prescribed, that term holds the half cell.
        half_cells = [
            body.half_cell * body.natural.astype(body.dtype)
            for body in snapshot.surface.bodies
        ]
        return SurfaceTerms(
            names=tuple(names[number] for number in self.numbers),
            half_cell=concatenated(half_cells),
            natural=each(snapshot.natural),
            prescribed=each(snapshot.prescribed),
        )

    def _surface_load(
        self, snapshot: Snapshot, terms: SurfaceTerms, fine: Enclosure | None
    ):
        """The load on surface cells, and the radiation between them."""
        surface = snapshot.surface
        acting = list(zip(*map(surface.apart, self.acting), strict=True))
        # Fragments of one cell must be in one patch of the radiative exchange.
        groups: list = [None] * len(surface.bodies)
        if fine is not None:
            groups = surface.apart(np.asarray(fine.patch))
        found = [
            body_cells(body, list(acting[n]) if acting else [], groups[n])
            for n, body in enumerate(self.prepared)
        ]
        cells, cell = zip(*found, strict=True)
        rows = tuple(
            tuple(self.entry.get((number, n), -1) for n in range(len(surface.bodies)))
            for number in self.numbers
        )
        load, joined = surface_load(
            terms, cells, cell, surface.references, rows, len(self.entry)
        )
        if fine is None or load is None:
            return load, None
        return load, fine.coarsened(joined, load.counts)

    def _iterations(
        self, snapshot: Snapshot, temperatures: TemperatureRange | None
    ) -> int:
        """Newton iterations: the most that any body needs; linear laws need none."""
        surface, found, start = snapshot.surface, [], 0
        terms = self._fragment_terms(snapshot)
        for n, body in enumerate(surface.bodies):
            cells = slice(start, start + len(body.area))
            start = cells.stop
            acting = {k for k, m in enumerate(self.numbers) if (m, n) in self.entry}
            own = terms.selected(cells, acting, surface.references[n])
            if own.is_linear:
                continue
            if isinstance(self.prepared[n].network, NonlinearNetwork):
                return MAX_ITERATIONS
            found.append(own.newton_iterations(temperatures))
        return max(found, default=MAX_ITERATIONS)

    def _contact(self, key: PairKey, pairs: ContactPairs | None, size: int):
        term, *ends = self.scene.terms[key[0]], *(self.prepared[n] for n in key[1:])
        assert isinstance(term, AbstractPairTerm)
        if pairs is None:
            pairs = no_pairs(*(len(body.fragment_node) for body in ends))
        return term.bind(pairs, (ends[0], ends[1]), self.entry[key], size)

    def _body(self, index: int, snapshot: Snapshot) -> BodyProgram:
        body = self.prepared[index]
        surface = snapshot.surface.bodies[index]
        touched = any(index in key[1:] for key in self.pair_counts)
        # Bodies that never touch anything need no array of ones.
        exposed = surface.exposed_fraction if touched else np.ones((), surface.dtype)
        nodes, node = np.unique(body.fragment_node, return_inverse=True)
        return BodyProgram(
            network=body.network,
            reference=jnp.asarray(body.reference, surface.dtype),
            sources=tuple(
                _volume_load(self.entry[key], found, body, surface.dtype)
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
