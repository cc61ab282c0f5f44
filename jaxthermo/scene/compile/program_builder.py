"""From looks at a scene to its programs: alike at all moments but for their numbers."""

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
    enclosure,
    merged_enclosure,
    patches_of,
)
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.term import Reach
from ...physics.time_varying import is_unknown_function, knots
from ..loads.join import join_loads
from ..loads.linear_load import by_nodes
from ..loads.load import surface_load, surface_reading
from ..scene import Scene
from .bodies import Prepared
from .contacts import Key, contact_links, touching_sizes
from .program import BodyProgram, Entry, Program
from .snapshots import Look
from .surface_terms import Bound, acts_ever
from .volume import volume_load


Volumes = dict[tuple[int, int], VolumeBinding]
"""What sources inside bodies reach, by the numbers of the term and of the body."""


class Entries(NamedTuple):
    """The entries of a ledger, and where to find them."""

    entries: tuple[Entry, ...]
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
    names: tuple[str, ...], looks: list[Look], volumes: Volumes
) -> Entries:
    """An entry for every body that a term acts on, in the order of the terms.

    Args:
        names: of the terms.
        looks: at all moments.
        volumes: what acts inside bodies.
    """
    keys = {
        (number, body)
        for look in looks
        for body, bound in enumerate(look.bounds)
        for number in bound.numbers
    }
    touching = touching_sizes([look.touching for look in looks])
    ordered = sorted({*keys, *volumes, *touching})
    entries = tuple(Entry(names[key[0]], *key[1:]) for key in ordered)
    return Entries(entries, {key: n for n, key in enumerate(ordered)})


def programs(
    scene: Scene,
    prepared: tuple[Prepared, ...],
    looks: list[Look],
    volumes: Volumes,
    entries: Entries,
    reach: Reach | None,
) -> tuple[Program, ...]:
    """One a moment.

    Args:
        scene: bodies and terms.
        prepared: the bodies.
        looks: at all moments.
        volumes: what acts inside bodies.
        entries: of the ledger.
        reach: what the run can get to, if that is known.
    """
    bodies = range(len(prepared))
    rules = Rules(
        entries=entries,
        sizes=touching_sizes([look.touching for look in looks]),
        acts=[acts_ever([look.bounds[b] for look in looks]) for b in bodies],
        steps=[
            max(_steps(prepared[b], look.bounds[b], reach) for look in looks)
            for b in bodies
        ],
    )
    made = tuple(_program(scene, prepared, look, volumes, rules) for look in looks)
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


def _steps(one: Prepared, bound: Bound, reach: Reach | None) -> int:
    if isinstance(one.network, NonlinearNetwork):
        return ALL_STEPS
    terms = [each.binding.term for each in bound.free]
    return newton_steps(bound.surface.half_cell, terms, reach)


def _program(scene, prepared, look: Look, volumes: Volumes, rules: Rules) -> Program:
    used = {key[0] for key in rules.entries.number}
    values = [value for n in used for value in scene.terms[n].values]
    dtype = jnp.dtype(scene.dtype)
    around = _enclosure(scene, prepared, look, used)
    groups = [None] * len(prepared) if around is None else patches_of(around)
    bodies, places = [], []
    for one, bound, group in zip(prepared, look.bounds, groups, strict=True):
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
                look.touching,
                key,
                size,
                rules.entries.number[key],
                dtype,
            )
            for key, size in rules.sizes.items()
        ),
        enclosure=None if around is None else merged_enclosure(around, places, counts),
        fine_enclosure=around,
        entries=rules.entries.entries,
        knots=tuple(sorted({k for value in values for k in knots(value)})),
        sampled=any(is_unknown_function(value) for value in values),
    )


def _enclosure(scene: Scene, prepared, look: Look, used: set[int]) -> Enclosure | None:
    """What bodies radiate to each other, if a term asks for it and they do."""
    for number in sorted(used):
        term = scene.terms[number]
        if isinstance(term, RadiativeExchange):
            surfaces = tuple(bound.surface for bound in look.bounds)
            return enclosure(term, surfaces, tuple(one.reference for one in prepared))
    return None


def _body(
    one: Prepared,
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
    bare = bound.surface.bare if touched else np.ones((), dtype)
    terms = SurfaceTerms(
        names=tuple(entry.mechanism for entry in rules.entries.entries),
        half_cell=bound.surface.half_cell * bound.surface.free.astype(dtype),
        free=tuple((number[n, index], b.term) for n, b in bound.free),
        held=tuple((number[n, index], b.term) for n, b in bound.held),
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
        reading=surface_reading(one, terms, bare),
    )
    return program, place


def _on_device(leaf: Any) -> Any:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray | np.generic) else leaf
