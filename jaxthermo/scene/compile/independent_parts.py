"""Parts of a compiled scene between which no heat flows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .program import Program


def exchanging_bodies(programs: Sequence[Program]) -> Int[np.ndarray, " b"]:
    """The same number for bodies that exchange heat, directly or by others."""
    count = programs[0].body_count
    if any(program.fine_enclosure is not None for program in programs):
        return np.zeros(count, np.int32)
    pairs = []
    for program in programs:
        pairs += [bodies for _, bodies in program.entries if len(bodies) == 2]
        for air in program.airs:
            for wall in air.walls:
                _, (body,) = program.entries[wall]
                pairs.append((air.body, body))
    return _components(pairs, count)


def independent_groups(programs: Sequence[Program]) -> list[tuple[int, ...]]:
    """Numbers of the groups of each part, in all programs of a scene.

    One group, and a scene with air or with exchange of radiation, is one part.
    """
    first = programs[0]
    groups = range(len(first.bodies))
    has_exchange = any(p.airs or p.enclosure is not None for p in programs)
    if len(groups) == 1 or has_exchange:
        return [tuple(groups)]
    of_body = exchanging_bodies(programs).tolist()
    pairs = []
    for group, body in enumerate(first.bodies):
        # Exchanging bodies follow the groups.
        pairs += [(group, len(groups) + of_body[number]) for number in body.numbers]
    component = _components(pairs, len(groups) + len(of_body))[: len(groups)]
    return [
        tuple(np.flatnonzero(component == n).tolist()) for n in np.unique(component)
    ]


def _components(pairs: list[tuple[int, int]], count: int) -> Int[np.ndarray, " n"]:
    """Number of the connected component of each of the nodes of a graph."""
    first, second = np.array(pairs, int).reshape(-1, 2).T
    graph = coo_array((np.ones(len(pairs)), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def program_of(program: Program, groups: tuple[int, ...]) -> Program:
    """The program of some groups, for steps alone: it observes nothing.

    No heat may flow between these and the others. The ledger keeps all entries.
    """
    new_number = {group: index for index, group in enumerate(groups)}
    contacts = []
    for contact in program.contacts:
        first, second = contact.bodies
        if first in new_number:
            contacts.append(
                replace(contact, bodies=(new_number[first], new_number[second]))
            )
    surface = program.surface
    return replace(
        program,
        bodies=tuple(program.bodies[group] for group in groups),
        order=None,
        surface=None if surface is None else surface.of_groups(new_number),
        contacts=tuple(contacts),
        probes=(),
        surface_heat=None,
    )
