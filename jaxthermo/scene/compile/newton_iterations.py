"""The number of Newton iterations at the surface, a constant of a compiled program.

It follows from bounds of the temperatures and from the numbers of a scene: a scene of
linear laws needs none, a stiff one all.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import numpy as np
from jaxtyping import Float, Int

from ...memo.once import once
from ...physics.flux_law import (
    AbstractFluxLaw,
    BoundTerm,
    FluxBounds,
    Forcing,
    bound,
)
from ...physics.surface_energy_balance import MAX_ITERATIONS, SurfaceTerms
from .body_program import BodyProgram
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
    count = _iterations(programs, temperatures, end)
    return tuple(_iterating(program, count) for program in programs)


def _iterations(programs: Sequence[Program], within: Forcing, end: float) -> int:
    """Newton iterations that every body needs at most; linear laws need none."""
    snapshots = _with_shared_laws(programs)
    if any(terms.is_linear for terms in snapshots):
        return MAX_ITERATIONS
    first = programs[0]
    mechanisms: dict[int, set[str]] = {}
    for name, ends in first.entries:
        if len(ends) == 1:
            mechanisms.setdefault(ends[0], set()).add(name)
    iterations = []
    for body, cells in zip(first.bodies, first.fragments(), strict=True):
        acting = set().union(*(mechanisms.get(n, ()) for n in body.numbers))
        reference = _references(body)
        bounds = once(partial(_bounds, cells, reference, within, end))
        for terms in snapshots:
            natural = [(k, t) for k, t in terms.natural if terms.names[k] in acting]
            if all(term.law.is_linear for _, term in natural):
                continue
            if not body.network.is_linear:
                return MAX_ITERATIONS
            on_body = replace(
                terms,
                half_cell=terms.half_cell[cells],
                natural=tuple(
                    (k, bound(term.effective_area[cells], term.law))
                    for k, term in natural
                ),
            )
            iterations.append(on_body.newton_iterations(bounds))
    return max(iterations, default=MAX_ITERATIONS)


def _references(body: BodyProgram) -> Float[np.ndarray, "*s"]:
    """Reference of each fragment [K]; one number where all are equal."""
    reference = np.asarray(body.reference)
    if body.members is None or not reference.ndim:
        return reference
    return reference[np.asarray(body.members.of_fragment)]


def _bounds(
    cells: slice | Int[np.ndarray, " _"],
    reference: Float[np.ndarray, "*_"],
    within: Forcing,
    end: float,
    law: AbstractFluxLaw,
) -> FluxBounds:
    """Bounds of a law on the cells of one body, with its reference [K]."""
    on_body = law.coarsened(lambda values: values[..., cells])
    return on_body.above(reference).bounds(within, end)


def _with_shared_laws(programs: Sequence[Program]) -> list[SurfaceTerms]:
    """Terms of each program on the host; laws of the same arrays are one object."""
    laws: dict[object, AbstractFluxLaw] = {}

    def with_shared_law(term: BoundTerm) -> BoundTerm:
        leaves, structure = jax.tree.flatten(term.law)
        key = (structure, *map(id, leaves))
        if key not in laws:
            laws[key] = jax.device_get(term.law)
        area = np.asarray(term.effective_area)
        return replace(term, effective_area=area, law=laws[key])

    return [
        replace(
            program.fragment_terms.mapped(with_shared_law),
            half_cell=np.asarray(program.fragment_terms.half_cell),
        )
        for program in programs
    ]


def _iterating(program: Program, count: int) -> Program:
    surface = program.surface
    if isinstance(surface, SurfaceLoad):
        terms = replace(surface.terms, iterations=count)
        surface = replace(surface, terms=terms)
    fragment_terms = replace(program.fragment_terms, iterations=count)
    return replace(program, surface=surface, fragment_terms=fragment_terms)
