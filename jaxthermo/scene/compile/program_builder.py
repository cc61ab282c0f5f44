"""From snapshots of a scene to programs, alike but for their numbers."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...network.nonlinear import NonlinearNetwork
from ...physics.heat_source import VolumeBinding
from ...physics.newton_iteration_bound import ALL_STEPS, newton_steps
from ...physics.radiation.radiative_exchange import (
    Enclosure,
    RadiativeExchange,
    coarsened_enclosure,
    enclosure,
    patches_of,
)
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.term import TemperatureRange
from ...physics.time_varying import breakpoints, is_unknown_function
from ..loads.join import join_loads
from ..loads.linear_load import by_nodes
from ..loads.load import surface_load, surface_reading
from ..scene import Scene
from .bodies import PreparedBody
from .contacts import Key, contact_links, touching_sizes
from .program import BodyProgram, LedgerEntry, Program
from .snapshots import Snapshot
from .surface_terms import Bound, acts_ever
from .volume import volume_load


Volumes = dict[tuple[int, int], VolumeBinding]
"""What sources inside bodies reach, by the numbers of the term and of the body."""


class Entries(NamedTuple):
    """The entries of a ledger, and where to find them."""

    entries: tuple[LedgerEntry, ...]
    number: dict[tuple[int, ...], int]
    """Of the term's number with that of its body, or of both its bodies."""


class Rules(NamedTuple):
    """What holds for the programs of all moments."""

    entries: Entries
    sizes: dict[Key, int]
    """Of the contacts."""
    acts: list[list[np.ndarray]]
    """Of each body, where each binding acts at any moment."""
    steps: list[int]
    """Of each body, of Newton's method."""


def number_entries(
    names: tuple[str, ...], snapshots: list[Snapshot], volumes: Volumes
) -> Entries:
    """An entry for every body that a term acts on, in the order of the terms.

    Args:
        names: of the terms.
        snapshots: at all moments.
        volumes: what acts inside bodies.
    """
    keys = {
        (number, body)
        for snapshot in snapshots
        for body, bound in enumerate(snapshot.bounds)
        for number in bound.numbers
    }
    touching = touching_sizes([s.touching for s in snapshots])
    ordered = sorted({*keys, *volumes, *touching})
    entries = tuple(LedgerEntry(names[key[0]], *key[1:]) for key in ordered)
    return Entries(entries, {key: n for n, key in enumerate(ordered)})


def programs(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    snapshots: list[Snapshot],
    volumes: Volumes,
    entries: Entries,
    reach: TemperatureRange | None,
) -> tuple[Program, ...]:
    """One a moment.

    Args:
        scene: bodies and terms.
        prepared: the bodies.
        snapshots: at all moments.
        volumes: what acts inside bodies.
        entries: of the ledger.
        reach: what the run can get to, if that is known.
    """
    bodies = range(len(prepared))
    rules = Rules(
        entries=entries,
        sizes=touching_sizes([s.touching for s in snapshots]),
        acts=[acts_ever([s.bounds[b] for s in snapshots]) for b in bodies],
        steps=[
            max(_steps(prepared[b], s.bounds[b], reach) for s in snapshots)
            for b in bodies
        ],
    )
    made = tuple(_program(scene, prepared, s, volumes, rules) for s in snapshots)
    return jax.tree.map(_on_device, by_nodes(made) or _joined(made))


def _joined(made: tuple[Program, ...]) -> tuple[Program, ...]:
    """With the loads of all bodies as one, where more than one has any."""
    loads = [
        tuple(body.load.places for body in program.bodies if body.load is not None)
        for program in made
    ]
    if len(loads[0]) < 2:
        return made
    pairs = zip(made, join_loads(loads), strict=True)
    return tuple(replace(program, joined=joined) for program, joined in pairs)


def _steps(one: PreparedBody, bound: Bound, reach: TemperatureRange | None) -> int:
    if isinstance(one.network, NonlinearNetwork):
        return ALL_STEPS
    terms = [each.binding.term for each in bound.natural]
    return newton_steps(bound.surface.half_cell, terms, reach)


def _program(
    scene, prepared, snapshot: Snapshot, volumes: Volumes, rules: Rules
) -> Program:
    used = {key[0] for key in rules.entries.number}
    values = [value for n in used for value in scene.terms[n].values]
    dtype = jnp.dtype(scene.dtype)
    around = _enclosure(scene, prepared, snapshot, used)
    groups = [None] * len(prepared) if around is None else patches_of(around)
    bodies, places = [], []
    for one, bound, group in zip(prepared, snapshot.bounds, groups, strict=True):
        body, place = _body(one, bound, volumes, rules, group, around, dtype)
        bodies.append(body)
        places.append(place)
    counts = tuple(0 if b.load is None else len(b.load.places.node) for b in bodies)
    return Program(
        bodies=tuple(bodies),
        joined=None,
        contacts=tuple(
            contact_links(
                scene.terms[key[0]],
                prepared,
                snapshot.touching,
                key,
                size,
                rules.entries.number[key],
                dtype,
            )
            for key, size in rules.sizes.items()
        ),
        enclosure=None
        if around is None
        else coarsened_enclosure(around, places, counts),
        fine_enclosure=around,
        entries=rules.entries.entries,
        breakpoints=tuple(sorted({k for value in values for k in breakpoints(value)})),
        sampled=any(is_unknown_function(value) for value in values),
    )


def _enclosure(
    scene: Scene, prepared, snapshot: Snapshot, used: set[int]
) -> Enclosure | None:
    """What bodies radiate to each other, if a term asks for it and they do."""
    for number in sorted(used):
        term = scene.terms[number]
        if isinstance(term, RadiativeExchange):
            surfaces = tuple(bound.surface for bound in snapshot.bounds)
            return enclosure(term, surfaces, tuple(one.reference for one in prepared))
    return None


def _body(
    one: PreparedBody,
    bound: Bound,
    volumes: Volumes,
    rules: Rules,
    group: np.ndarray | None,
    around: Enclosure | None,
    dtype: Any,
) -> tuple[BodyProgram, np.ndarray]:
    """The program of one body, and the place that each of its fragments is in."""
    index, number = bound.surface.body, rules.entries.number
    touched = any(index in key[1:] for key in rules.sizes)
    exposed = bound.surface.exposed_fraction if touched else np.ones((), dtype)
    terms = SurfaceTerms(
        names=tuple(entry.mechanism for entry in rules.entries.entries),
        half_cell=bound.surface.half_cell * bound.surface.natural.astype(dtype),
        natural=tuple((number[n, index], b.term) for n, b in bound.natural),
        prescribed=tuple((number[n, index], b.term) for n, b in bound.prescribed),
        steps=rules.steps[index],
    )
    if around is not None:
        terms = terms.above(around.base)
    sources = tuple(
        volume_load(number[key], found, one, dtype)
        for key, found in volumes.items()
        if key[1] == index
    )
    load, place = surface_load(one, terms, rules.acts[index], group)
    program = BodyProgram(
        network=one.network,
        reference=jnp.asarray(one.reference, dtype),
        load=load,
        sources=sources,
        reading=surface_reading(one, terms, exposed),
    )
    return program, place


def _on_device(leaf: Any) -> Any:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray | np.generic) else leaf
