"""Terms meet bodies: which of them act on a body's surface, where, and how much.

A term that can do nothing is not bound, and the receipt says why. What holds the
surface at a temperature is bound first: where it holds, nothing else acts.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...arrays import Scalar
from ...errors import InputError
from ...geometry.pose import Pose
from ...physics.term import AbstractSurfaceTerm, Binding, Omitted, Surface
from ..scene import Scene
from .bodies import PreparedBody, surface_property


class Numbered(NamedTuple):
    """One binding of the term with this number in the scene."""

    number: int
    binding: Binding


class Bound(NamedTuple):
    """The terms on one body at one moment, and what was left out with the reason."""

    natural: tuple[Numbered, ...]
    prescribed: tuple[Numbered, ...]
    omitted: tuple[tuple[int, str], ...]
    surface: Surface

    @property
    def everything(self) -> tuple[Numbered, ...]:
        """What acts at the surface's temperature, then what holds it."""
        return (*self.natural, *self.prescribed)

    @property
    def numbers(self) -> set[int]:
        """Of the terms that act."""
        return {each.number for each in self.everything}


def body_surface(
    index: int,
    one: PreparedBody,
    pose: Pose,
    covered: Float[np.ndarray, " s"],
    triangles: Float[np.ndarray, "f 3 3"],
    dtype: Any,
) -> Surface:
    """The surface of a body as terms see it.

    Args:
        index: of the body.
        one: the body.
        pose: where it stands at this moment.
        covered: share of each fragment that another body touches.
        triangles: of all bodies, in the world [m].
        dtype: of the state.
    """
    body, bare = one.body, 1 - covered
    grid = body.structure.grid
    return Surface(
        body=index,
        grid=grid,
        pose=pose,
        position=pose.place(grid.fragment_position),
        normal=pose.turn(grid.fragment_normal),
        area=(grid.fragment_area * bare).astype(dtype),
        exposed_fraction=bare.astype(dtype),
        natural=bare > 0,
        half_cell=one.half_cell * bare.astype(dtype),
        emissivity=surface_property(body, "emissivity", dtype),
        absorptivity=surface_property(body, "absorptivity", dtype),
        scene_triangles=triangles,
        dtype=dtype,
    )


def bind_terms(
    terms: tuple[tuple[int, AbstractSurfaceTerm], ...],
    surface: Surface,
    reference: Scalar,
) -> Bound:
    """What holds the surface first, then all that acts where nothing holds it.

    Raises:
        InputError: if two terms hold one piece of the surface.
    """
    omitted: list[tuple[int, str]] = []
    holding = [(n, term) for n, term in terms if term.is_dirichlet]
    held = _bind(holding, surface, reference, omitted)
    taken = np.full(len(surface.natural), -1)
    for number, binding in held:
        _refuse_twice(taken[binding.acts], number, surface.body)
        taken[binding.acts] = number
    rest = replace(surface, natural=surface.natural & (taken < 0))
    acting = [(n, term) for n, term in terms if not term.is_dirichlet]
    free = _bind(acting, rest, reference, omitted)
    return Bound(free, held, tuple(sorted(omitted)), rest)


def _bind(terms, surface, reference, omitted) -> tuple[Numbered, ...]:
    numbered = []
    for number, term in terms:
        bindings = term.bind(surface, reference)
        if isinstance(bindings, Omitted):
            omitted.append((number, bindings.reason))
        else:
            numbered += [Numbered(number, each) for each in bindings]
    return tuple(numbered)


def _refuse_twice(before: np.ndarray, number: int, body: int) -> None:
    if (before >= 0).any():
        raise InputError(
            f"terms[{before.max()}] and terms[{number}] both hold a piece of body "
            f"{body}'s surface at a temperature: keep their `on` apart"
        )


def acts_ever(bounds: list[Bound]) -> list[Bool[np.ndarray, " s"]]:
    """Where each binding acts at any of the moments, which have the same bindings."""
    rows = zip(*(bound.everything for bound in bounds), strict=True)
    return [np.any([each.binding.acts for each in row], axis=0) for row in rows]


def drop_idle(bounds: list[Bound]) -> list[Bound]:
    """One body's bindings at all moments, without those that never act."""
    kept = [acts.any() for acts in acts_ever(bounds)]
    free = len(bounds[0].natural)
    pick = lambda row, keep: tuple(x for x, k in zip(row, keep, strict=True) if k)
    return [
        b._replace(
            natural=pick(b.natural, kept[:free]),
            prescribed=pick(b.prescribed, kept[free:]),
        )
        for b in bounds
    ]


def surface_terms(
    scene: Scene, time: float
) -> tuple[tuple[int, AbstractSurfaceTerm], ...]:
    """Terms at surfaces as they stand at a moment [s], with their numbers."""
    return tuple(
        (number, frozen)
        for number, term in enumerate(scene.terms)
        if isinstance(frozen := term.at(time), AbstractSurfaceTerm)
    )
