"""Snapshots: the geometry of a scene, its contacts and bound terms at one moment.

Terms that prescribe a temperature are bound first: no other term acts there. What a
surface of prescribed temperature radiates to others is bound separately.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError, located
from ...findings import found
from ...geometry.mesh import Pose
from ...physics.contact.overlap import Overlap
from ...physics.contact.rays import PlacedGrid
from ...physics.contact.search import ContactPairs
from ...physics.flux_law import Forcing
from ...physics.radiation.irradiation import AbstractRadiativeTerm, Irradiation
from ...physics.surface import Binding, BodySurface, Omitted, Surface
from ...physics.term import (
    AbstractExchangeTerm,
    AbstractPairTerm,
    AbstractSurfaceTerm,
    AbstractTerm,
)
from ...voxels.grid import VoxelGrid
from ...voxels.selection import FragmentMask
from ..scene import Scene
from .bodies import PreparedBody, surface_property
from .placement import (
    enclosed_fragments,
    overlaps_of,
    placed_surface,
    scene_triangles,
    touching,
)


# Bindings with the number of their term in the scene.
_NumberedBindings = tuple[tuple[int, Binding], ...]

PairKey = tuple[int, int, int]
"""Numbers of a term and of both its bodies."""


class Snapshot(NamedTuple):
    """A scene at one moment: its surface, and what acts on it."""

    surface: Surface
    natural: _NumberedBindings
    """Terms that give a flux, where no temperature is prescribed."""
    prescribed: _NumberedBindings
    radiating: _NumberedBindings
    """Exchange of surfaces whose temperature is prescribed with others."""
    omitted: tuple[tuple[int, Omitted], ...]
    """Surface terms that do not act on a body, by their number."""
    irradiation: tuple[tuple[str, Irradiation], ...]
    """Radiation that reaches the surface, with the property that absorbs it."""
    pairs: dict[PairKey, ContactPairs]
    unpaired: tuple[tuple[int, str], ...]
    """Pair terms that do not act, by their number, and why."""
    overlaps: dict[tuple[int, int], Overlap]
    """Bodies that overlap by more than a contact, by their numbers."""

    @property
    def bindings(self) -> _NumberedBindings:
        """All bindings, natural ones first."""
        return (*self.natural, *self.prescribed, *self.radiating)


def take_snapshots(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    starts: tuple[float, ...],
    end: float | int,
    temperatures: Forcing | None,
    prune: bool,
) -> list[Snapshot]:
    """The scene at every snapshot, from its start, with the same bindings at each.

    Terms without effect are left out if `prune`.
    """
    # Several snapshots need the same bindings: a term that does not act now is omitted
    # only where there is one snapshot.
    once = prune and len(starts) == 1
    stops = (*starts[1:], max(end, starts[-1]))
    snapshots, known = [], {}
    for start, stop in zip(starts, stops, strict=True):
        # The geometry halfway between two snapshots is exact to second order in their
        # distance for whatever moves smoothly.
        time = (start + stop) / 2
        poses = tuple(body.pose.at(time) for body in scene.bodies)
        placed = tuple(
            PlacedGrid(body.structure.grid, pose, f"body {index}")
            for index, (body, pose) in enumerate(zip(scene.bodies, poses, strict=True))
        )
        overlaps = overlaps_of(placed, known)
        pairs, covered, unpaired = _find_contacts(scene, placed)
        surface = Surface(
            bodies=_body_surfaces(
                scene, prepared=prepared, poses=poses, covered=covered, prune=once
            ),
            references=tuple(body.reference for body in prepared),
            temperatures=temperatures,
            end=end,
        )
        bound = _bind_terms([term.at(time) for term in scene.terms], surface)
        snapshots.append(Snapshot(*bound, pairs, unpaired, overlaps))
    if not prune:
        return snapshots
    keep = [bool(where.any()) for where in acting(snapshots)]
    pick = lambda row, flags: tuple(x for x, k in zip(row, flags, strict=True) if k)
    one = len(snapshots[0].natural)
    two = one + len(snapshots[0].prescribed)
    return [
        snapshot._replace(
            natural=pick(snapshot.natural, keep[:one]),
            prescribed=pick(snapshot.prescribed, keep[one:two]),
            radiating=pick(snapshot.radiating, keep[two:]),
        )
        for snapshot in snapshots
    ]


def acting(snapshots: list[Snapshot]) -> list[Bool[np.ndarray, " s"]]:
    """Fragments on which each binding acts at any snapshot."""
    # A light that moves reaches a fragment at some snapshots only.
    rows = zip(*(each.bindings for each in snapshots), strict=True)
    return [np.any([binding.acting for _, binding in row], axis=0) for row in rows]


def _body_surfaces(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    poses: tuple[Pose, ...],
    covered: list[Float[np.ndarray, " _"] | None],
    prune: bool,
) -> tuple[BodySurface, ...]:
    # Covered is the fraction of each fragment that another body touches, if any.
    dtype: Any = np.dtype(scene.dtype)
    placed = [
        placed_surface(body.structure.grid, pose)
        for body, pose in zip(scene.bodies, poses, strict=True)
    ]
    shadow = scene_triangles(placed)
    enclosed = enclosed_fragments(scene, poses)
    surfaces = []
    for index, (body, pose) in enumerate(zip(scene.bodies, poses, strict=True)):
        grid, own = body.structure.grid, covered[index]
        exposed, half_cell = _exposed(grid, own, dtype), prepared[index].half_cell
        with located(f"bodies[{index}]"):
            emissivity = surface_property(body, "emissivity", dtype)
            absorptivity = surface_property(body, "absorptivity", dtype)
        surfaces.append(
            BodySurface(
                body=index,
                grid=grid,
                pose=pose,
                position=placed[index].position,
                normal=placed[index].normal,
                area=exposed.area,
                exposed_fraction=exposed.fraction,
                natural=exposed.natural,
                half_cell=half_cell if own is None else half_cell * exposed.fraction,
                emissivity=emissivity,
                absorptivity=absorptivity,
                scene_triangles=shadow,
                dtype=dtype,
                enclosed=enclosed[index],
                prune=prune,
            )
        )
    return tuple(surfaces)


class _Exposed(NamedTuple):
    """The part of each fragment of a body that nothing touches."""

    area: Float[np.ndarray, " s"]
    """[m^2]"""
    fraction: Float[np.ndarray, " s"]
    natural: Bool[np.ndarray, " s"]
    """True where the fraction is not 0."""


def _exposed(
    grid: VoxelGrid, covered: Float[np.ndarray, " s"] | None, dtype: Any
) -> _Exposed:
    """The exposed part of a surface of which these fractions are covered, or none."""

    def of(fraction: Float[np.ndarray, " s"]) -> _Exposed:
        area = (grid.fragment_area * fraction).astype(dtype)
        return _Exposed(area, fraction.astype(dtype), fraction > 0)

    if covered is not None:
        return of(1 - covered)
    # The same arrays in all runs: what follows from them alone is found once, too.
    whole = lambda: of(np.ones(len(grid.fragment_area)))
    return found((grid,), ("exposed", np.dtype(dtype).name), whole)


def _reached(term: AbstractSurfaceTerm, surface: Surface) -> Surface:
    """The surface that a term reaches: from outside none in closed cavities."""
    # A mask names every single fragment, so it is taken as given.
    named = isinstance(getattr(term, "on", None), FragmentMask)
    return surface.outside if term.from_outside and not named else surface


def _irradiation(
    term: AbstractRadiativeTerm, surface: Surface
) -> tuple[Irradiation, ...]:
    """Irradiation by a term, without the closed cavities that it does not reach."""
    everywhere = term.irradiation(surface)
    where = _reached(term, surface)
    if where is surface:
        return everywhere
    enclosed = np.concatenate(
        [
            np.zeros(n, bool) if body.enclosed is None else body.enclosed
            for n, body in zip(surface.counts, surface.bodies, strict=True)
        ]
    )
    return tuple(e._replace(factor=e.factor * ~enclosed) for e in everywhere)


def _find_contacts(
    scene: Scene, placed: tuple[PlacedGrid, ...]
) -> tuple[
    dict[PairKey, ContactPairs],
    list[Float[np.ndarray, " _"] | None],
    tuple[tuple[int, str], ...],
]:
    """Touching fragments of each pair of bodies, covered fractions, and omissions.

    A body that nothing touches has no array of fractions.

    Raises:
        InputError: if bodies overlap deeply, or two terms join the same ones.
    """
    terms = [
        (n, term)
        for n, term in enumerate(scene.terms)
        if isinstance(term, AbstractPairTerm)
    ]
    # Fractions of fragments that another body covers: no other term acts there.
    covered: list[Any] = [None for _ in scene.bodies]
    if not terms or len(scene.bodies) == 1:
        return {}, covered, tuple((n, "there is one body") for n, _ in terms)
    pairs: dict[PairKey, ContactPairs] = {}
    taken: dict[tuple[int, int], int] = {}
    omitted = []
    for number, term in terms:
        touches = touching(placed, term.max_gap)
        joined = {key: each for key, each in touches.items() if term.connects(*key)}
        if not joined:
            omitted.append((number, "no bodies touch"))
        # An idle pair still covers the surface: it insulates it.
        elif term.is_idle:
            omitted.append((number, "its conductance is 0"))
        for (one, other), each in joined.items():
            if (one, other) in taken:
                raise InputError(
                    f"terms[{taken[one, other]}] and terms[{number}] both join bodies "
                    f"{one} and {other}: say which bodies each joins"
                )
            if not term.is_idle:
                pairs[number, one, other] = each
                taken[one, other] = number
            for body, part in ((one, each.coverage_a), (other, each.coverage_b)):
                before = 0 if covered[body] is None else covered[body]
                covered[body] = np.minimum(before + part, 1)
    return pairs, covered, tuple(omitted)


def _bind_terms(
    terms: Sequence[AbstractTerm], surface: Surface
) -> tuple[
    Surface,
    _NumberedBindings,
    _NumberedBindings,
    _NumberedBindings,
    tuple[tuple[int, Omitted], ...],
    tuple[tuple[str, Irradiation], ...],
]:
    """The first fields of a snapshot, up to the irradiation.

    Raises:
        InputError: if two terms prescribe the temperature of one piece of surface, or
            both compute its emission.
    """
    acts = [(n, t) for n, t in enumerate(terms) if isinstance(t, AbstractSurfaceTerm)]
    omitted: list[tuple[int, Omitted]] = []
    # A camera sees what reaches the surface even where none of it is absorbed.
    radiative = [(n, t) for n, t in acts if isinstance(t, AbstractRadiativeTerm)]
    named = lambda n: located(f"terms[{n}], {terms[n].name}")
    brought: dict[int, tuple[Irradiation, ...]] = {}
    for n, term in radiative:
        with named(n):
            brought[n] = _irradiation(term, surface)
    irradiation = [(t.absorbed_by, each) for n, t in radiative for each in brought[n]]

    def bound(number: int, term: AbstractSurfaceTerm, where: Surface):
        with named(number):
            if isinstance(term, AbstractRadiativeTerm):
                return term.absorbed(_reached(term, where), brought[number])
            return term.bind(_reached(term, where))

    def bind(chosen, where: Surface) -> _NumberedBindings:
        pairs = [(n, each) for n, term in chosen for each in bound(n, term, where)]
        omitted.extend((n, each) for n, each in pairs if isinstance(each, Omitted))
        return tuple((n, each) for n, each in pairs if not isinstance(each, Omitted))

    prescribed = bind([(n, t) for n, t in acts if t.is_dirichlet], surface)
    rest = held = surface
    if prescribed:
        # What other terms bring there has no effect: they are not bound.
        taken = _claimed(
            prescribed, surface=surface, verb="hold", what="at a temperature"
        )
        rest, held = _within(surface, taken < 0), _within(surface, taken >= 0)
    natural = bind([(n, t) for n, t in acts if not t.is_dirichlet], rest)
    # But what others receive from there has one, and is part of the balance.
    exchanging = [(n, t) for n, t in acts if isinstance(t, AbstractExchangeTerm)]
    unseen = len(omitted)
    radiating = bind(exchanging, held) if prescribed else ()
    del omitted[unseen:]
    reached = {
        (n, body)
        for n, binding in radiating
        for body, own in enumerate(surface.apart(binding.acting))
        if own.any()
    }
    omitted = [(n, each) for n, each in omitted if (n, each.body) not in reached]
    emits = {n for n, term in acts if term.name == "emission"}
    emission = [(n, each) for n, each in (*natural, *radiating) if n in emits]
    if len(emission) > 1:
        _claimed(emission, surface=surface, verb="count the emission of", what="")
    bindings = natural, prescribed, radiating
    return rest, *bindings, tuple(omitted), tuple(irradiation)


def _claimed(
    bindings: Sequence[tuple[int, Binding]], surface: Surface, verb: str, what: str
) -> Int[np.ndarray, " s"]:
    """Number of the term that each fragment belongs to, or -1.

    Raises:
        InputError: with these words, if two terms claim one fragment.
    """
    taken = np.full(len(surface.body), -1)
    for number, binding in bindings:
        other = binding.acting & (taken >= 0) & (taken != number)
        if other.any():
            raise InputError(
                f"terms[{taken[other].max()}] and terms[{number}] both {verb} a piece "
                f"of body {surface.body[other][0]}'s surface {what}".rstrip()
                + ": keep their `on` apart"
            )
        taken[binding.acting] = number
    return taken


def _within(surface: Surface, part: Bool[np.ndarray, " s"]) -> Surface:
    """The surface with natural boundaries on a part of it alone."""
    pairs = zip(surface.bodies, surface.apart(part), strict=True)
    bodies = tuple(replace(body, natural=body.natural & own) for body, own in pairs)
    return replace(surface, bodies=bodies)
