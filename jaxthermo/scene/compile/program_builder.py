"""From snapshots of a scene to programs, alike but for their numbers."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from ...arrays import device_array, typed_array
from ...module import replaced
from ...network.network import Address
from ...physics.contact.links import ContactLinks
from ...physics.contact.search import ContactPairs
from ...physics.flux_law import Forcing, bound
from ...physics.heat_source import VolumeBinding
from ...physics.radiation.radiative_exchange import Enclosure
from ...physics.surface import Omitted, Surface, concatenated
from ...physics.surface_energy_balance import MAX_ITERATIONS, SurfaceTerms
from ...physics.term import (
    AbstractExchangeTerm,
    AbstractPairTerm,
    AbstractTerm,
    AbstractVolumeTerm,
)
from ...physics.time_varying import breakpoints, for_jit, is_unknown_function
from ..scene import Scene
from .bodies import PreparedBody
from .linear_load import linear_programs
from .probes import bind_probes
from .program import BodyProgram, Program, VolumeLoad, surface_heat
from .snapshots import PairKey, Snapshot, acting
from .surface_load import AbstractSurfaceLoad, body_cells, surface_load


# Nodes that heat sources reach, by the numbers of the term and of the body.
_Volumes = dict[tuple[int, int], VolumeBinding]

Ledger = dict[tuple[int, ...], str]
"""Mechanisms in the energy ledger, in its order, by the numbers of the term and of its
body, or of both its bodies; the same at all snapshots."""

# Entry of each term on each body in the ledger; -1 where it has none.
_Rows = tuple[tuple[int, ...], ...]


def bind_volumes(scene: Scene) -> tuple[_Volumes, list[tuple[int, Omitted]]]:
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
    names: tuple[str, ...], snapshots: list[Snapshot], volumes: _Volumes, prune: bool
) -> Ledger:
    """An entry for every body that a term acts on, in the order of the terms."""
    first = snapshots[0]
    omitted = {(number, body) for number, (_, body) in first.omitted}
    keys: set[tuple[int, ...]] = {*volumes, *_pair_counts(snapshots)}
    for (number, _), where in zip(first.bindings, acting(snapshots), strict=True):
        for body, is_acting in enumerate(first.surface.apart(where)):
            # Without pruning an idle term has entries too: they stay 0.
            idle = not omitted & {(number, None), (number, body)}
            if is_acting.any() or (idle and not prune):
                keys.add((number, body))
    # Sorted by term, then by body, then by the second body of a pair.
    return {key: names[key[0]] for key in sorted(keys)}


def _used_terms(scene: Scene, ledger: Ledger) -> list[AbstractTerm]:
    return [scene.terms[n] for n in sorted({key[0] for key in ledger})]


def breakpoints_of(scene: Scene, ledger: Ledger) -> tuple[float, ...]:
    """Times at which a value of a term that acts has a kink or jump [s]."""
    values = [v for term in _used_terms(scene, ledger) for v in term.values]
    return tuple(sorted({time for value in values for time in breakpoints(value)}))


def make_programs(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    snapshots: list[Snapshot],
    volumes: _Volumes,
    ledger: Ledger,
    temperatures: Forcing | None,
    end: float,
) -> tuple[tuple[Program, ...], tuple[str, ...]]:
    """The program of each snapshot, all with arrays of the same shapes, and notes.

    The notes for the receipt state the accuracy of an exchange.
    """
    entry = {key: n for n, key in enumerate(ledger)}
    mechanism = {key[0]: name for key, name in ledger.items()}
    names = {n: mechanism[n] for n, _ in snapshots[0].bindings}
    rows = tuple(
        tuple(entry.get((n, body.number), -1) for body in prepared) for n in names
    )
    terms = [_fragment_terms(snapshot, names) for snapshot in snapshots]
    iterations = max(
        _iterations(
            fragment_terms,
            surface=snapshot.surface,
            prepared=prepared,
            rows=rows,
            temperatures=temperatures,
            end=end,
        )
        for fragment_terms, snapshot in zip(terms, snapshots, strict=True)
    )
    used = _used_terms(scene, ledger)
    values = [value for term in used for value in term.values]
    exchange = next((t for t in used if isinstance(t, AbstractExchangeTerm)), None)
    # Cells must be the same at all snapshots: they go by where a term ever acts.
    acting_fragments = acting(snapshots)
    counts = _pair_counts(snapshots)
    touched = {number for key in counts for number in key[1:]}
    dtype = snapshots[0].surface.dtype
    bodies = [
        _body(body, entry=entry, volumes=volumes, dtype=dtype) for body in prepared
    ]
    # Areas of fragments and nodes of probes do not change as bodies move.
    probes = bind_probes(scene, prepared, dtype)
    areas = [body.grid.fragment_area for body in snapshots[0].surface.bodies]
    outputs = surface_heat(scene, areas, tuple(names))
    programs = []
    accuracies = []
    for snapshot, snapshot_terms in zip(snapshots, terms, strict=True):
        surface = snapshot.surface
        fine = None
        if exchange is not None:
            fine, accuracy = exchange.enclosure(surface)
            accuracies.append(accuracy)
        fragment_terms = replaced(snapshot_terms, iterations=iterations)
        load, enclosure = _surface_load(
            fragment_terms,
            surface=surface,
            prepared=prepared,
            acting_fragments=acting_fragments,
            fine=fine,
            rows=rows,
            entry_count=len(ledger),
        )
        exposed = [body.exposed_fraction for body in surface.bodies]
        program = Program(
            bodies=tuple(
                replaced(body, exposed_fraction=exposed[n]) if n in touched else body
                for n, body in enumerate(bodies)
            ),
            surface=load,
            fragment_terms=fragment_terms,
            contacts=tuple(
                _contact(
                    scene,
                    prepared=prepared,
                    key=key,
                    pairs=snapshot.pairs.get(key),
                    entry=entry,
                    size=size,
                )
                for key, size in counts.items()
            ),
            enclosure=enclosure,
            fine_enclosure=fine,
            probes=probes,
            surface_heat=outputs,
            entries=tuple((name, key[1:]) for key, name in ledger.items()),
            sampled=any(is_unknown_function(value) for value in values),
        )
        programs.append(program)
    # Linear sums are made on the host, in double precision.
    if all(program.fragment_terms.is_linear for program in programs):
        programs = linear_programs(programs) or programs
    return tuple(programs), _accuracy_notes(exchange, accuracies)


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


def _fragment_terms(snapshot: Snapshot, names: dict[int, str]) -> SurfaceTerms:
    """The terms on the fragments of all bodies, named by their number in the scene."""
    order = {number: k for k, number in enumerate(names)}

    def numbered(bindings):
        return tuple(
            (order[number], bound(binding.effective_area, binding.law))
            for number, binding in bindings
        )

    # Where a temperature is prescribed, that term holds the half cell.
    half_cells = [
        body.half_cell
        if body.natural.all()
        else body.half_cell * body.natural.astype(body.dtype)
        for body in snapshot.surface.bodies
    ]
    return SurfaceTerms(
        names=tuple(names.values()),
        half_cell=concatenated(half_cells),
        natural=numbered(snapshot.natural),
        prescribed=numbered(snapshot.prescribed),
        radiating=numbered(snapshot.radiating),
    )


def _surface_load(
    terms: SurfaceTerms,
    surface: Surface,
    prepared: tuple[PreparedBody, ...],
    acting_fragments: list[Bool[np.ndarray, " s"]],
    fine: Enclosure | None,
    rows: _Rows,
    entry_count: int,
) -> tuple[AbstractSurfaceLoad | None, Enclosure | None]:
    """The load on surface cells, and the radiation between them."""
    # By term, and by body.
    masks = [surface.apart(is_acting) for is_acting in acting_fragments]
    # Fragments of one cell must be in one patch of the radiative exchange.
    groups: list = [None] * len(prepared)
    if fine is not None:
        groups = surface.apart(np.asarray(fine.patch))
    cells = []
    cell = []
    for n, body in enumerate(prepared):
        body_masks = [mask[n] for mask in masks]
        cells_of_body, cell_of_fragment = body_cells(body, body_masks, groups[n])
        cells.append(cells_of_body)
        cell.append(cell_of_fragment)
    load, joined = surface_load(
        terms,
        cells=tuple(cells),
        cell=cell,
        references=surface.references,
        entries=rows,
        entry_count=entry_count,
    )
    if fine is None or load is None:
        return load, None
    return load, fine.coarsened(joined, load.counts)


def _iterations(
    terms: SurfaceTerms,
    surface: Surface,
    prepared: tuple[PreparedBody, ...],
    rows: _Rows,
    temperatures: Forcing | None,
    end: float,
) -> int:
    """Newton iterations that every body needs at most; linear laws need none."""
    iterations = []
    start = 0
    for n, count in enumerate(surface.counts):
        cells = slice(start, start + count)
        start = cells.stop
        acting_terms = {k for k, row in enumerate(rows) if row[n] >= 0}
        body_terms = terms
        if len(surface.counts) > 1 or len(acting_terms) < len(rows):
            reference = surface.references[n]
            body_terms = terms.selected(cells, acting_terms, reference)
        if body_terms.is_linear:
            continue
        if not prepared[n].network.is_linear:
            return MAX_ITERATIONS
        iterations.append(body_terms.newton_iterations(temperatures, end))
    return max(iterations, default=MAX_ITERATIONS)


def _contact(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    key: PairKey,
    pairs: ContactPairs | None,
    entry: dict[tuple[int, ...], int],
    size: int,
) -> ContactLinks:
    term = scene.terms[key[0]]
    first = prepared[key[1]]
    second = prepared[key[2]]
    assert isinstance(term, AbstractPairTerm)
    if pairs is None:
        pairs = ContactPairs.none(len(first.fragment_node), len(second.fragment_node))
    return term.bind(pairs, (first, second), entry[key], size)


def _body(
    body: PreparedBody,
    entry: dict[tuple[int, ...], int],
    volumes: _Volumes,
    dtype: Any,
) -> BodyProgram:
    structure = body.body.structure
    address, node = structure.found("surface_nodes", lambda: _surface_nodes(body))
    return BodyProgram(
        network=body.network,
        reference=typed_array(body.reference, dtype),
        sources=tuple(
            _volume_load(entry[key], binding=binding, body=body, dtype=dtype)
            for key, binding in volumes.items()
            if key[1] == body.number
        ),
        address=address,
        node=node,
        # Bodies that never touch anything need no array of ones.
        exposed_fraction=np.ones((), dtype),
        surface_map=body.surface_map,
        conductivity_parts=body.conductivity_parts,
    )


def _surface_nodes(body: PreparedBody) -> tuple[Address, Int[Array, " s"]]:
    """Position of the surface nodes, and the index of each fragment's node."""
    nodes, node = np.unique(body.fragment_node, return_inverse=True)
    address, rank = body.ordered_address(nodes)
    return address, device_array(rank[node.reshape(-1)].astype(np.int32))


def _volume_load(
    entry: int, binding: VolumeBinding, body: PreparedBody, dtype: Any
) -> VolumeLoad:
    nodes = np.flatnonzero(binding.volume)
    sections = body.section_places(nodes)
    reached = np.zeros(len(sections.address[0]), dtype)
    reached[sections.places] = binding.volume[nodes]
    return VolumeLoad(
        entry=entry,
        address=sections.address,
        rise=jnp.asarray(reached) / body.network.capacity_at(sections.address),
        mesh=body.network.mesh,
        volume=np.asarray(reached.sum(dtype=float), dtype),
        heat_rate_density=for_jit(binding.heat_rate_density, dtype),
    )


def _pair_counts(snapshots: list[Snapshot]) -> dict[PairKey, int]:
    """Largest number of touching pairs at any snapshot, by bodies that ever touch."""
    counts: dict[PairKey, int] = {}
    for snapshot in snapshots:
        for key, pairs in snapshot.pairs.items():
            counts[key] = max(counts.get(key, 0), len(pairs.area))
    return {key: counts[key] for key in sorted(counts)}
