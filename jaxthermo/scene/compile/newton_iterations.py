"""The number of Newton iterations at the surface, a constant of a compiled program.

It follows from bounds of the temperatures and from the numbers of a scene: a scene of
linear laws needs none, a stiff one all.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from ...physics.flux_law import Forcing
from ...physics.surface_energy_balance import MAX_ITERATIONS
from .program import Program
from .surface_load import SurfaceLoad


def with_iterations(
    programs: Sequence[Program], temperatures: Forcing, end: float
) -> tuple[Program, ...]:
    """Return programs of known numbers with as many iterations as all of them need.

    Args:
        programs: of one scene, one a snapshot.
        temperatures: bounds of all temperatures.
        end: end of the run [s].
    """
    count = max(_iterations(program, temperatures, end) for program in programs)
    return tuple(_iterating(program, count) for program in programs)


def _iterations(program: Program, temperatures: Forcing, end: float) -> int:
    """Newton iterations that every body needs at most; linear laws need none."""
    terms = program.fragment_terms
    if terms.is_linear:
        return MAX_ITERATIONS
    # On the host, where nothing is compiled for each shape of a body.
    terms = jax.tree.map(_on_host, terms)
    entries = set(program.entries)
    iterations = []
    for body, cells in zip(program.bodies, program.fragments(), strict=True):
        acting = {
            k
            for k, name in enumerate(terms.names)
            if any((name, (number,)) in entries for number in body.numbers)
        }
        body_terms = terms
        if len(program.bodies) > 1 or len(acting) < len(terms.names):
            body_terms = terms.selected(
                cells, acting, np.asarray(body.fragment_reference)
            )
        if body_terms.is_linear:
            continue
        if not body.network.is_linear:
            return MAX_ITERATIONS
        iterations.append(body_terms.newton_iterations(temperatures, end))
    return max(iterations, default=MAX_ITERATIONS)


def _on_host(leaf: Any) -> Any:
    return np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf


def _iterating(program: Program, count: int) -> Program:
    surface = program.surface
    if isinstance(surface, SurfaceLoad):
        terms = replace(surface.terms, iterations=count)
        surface = replace(surface, terms=terms)
    fragment_terms = replace(program.fragment_terms, iterations=count)
    return replace(program, surface=surface, fragment_terms=fragment_terms)
