"""Snapshots: the geometry of a scene, its contacts and bound terms at one moment.

Terms that prescribe a temperature are bound first: no other term acts there. What a
surface of prescribed temperature radiates to others is bound separately.
"""

import itertools
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...errors import located
from ...geometry.mesh import Pose
from ...memo.found import found
from ...physics.contact.overlap import AnyOverlap, find_overlaps
from ...physics.contact.rays import PlacedGrid
from ...physics.flux_law import Forcing
from ...physics.occluder import Occluder
from ...physics.radiation.irradiation import AbstractRadiativeTerm, Irradiation
from ...physics.surface import (
    Binding,
    BodySurface,
    Omitted,
    Surface,
    enclosing_bodies,
    placed_surface,
)
from ...physics.term import (
    AbstractExchangeTerm,
    AbstractSurfaceTerm,
    AbstractTerm,
)
from ...voxels.abstract_grid import AbstractGrid
from ...voxels.selection import AbstractSelection
from ..air import bodies_with_surface
from ..motion import moving_together
from ..scene import Body, Scene
from .bodies import (
    PreparedGroup,
    half_cells_of,
    references_of,
    surface_property,
)
from .claims import claimed_fragments
from .contacts import PairKey, TouchingPairs, find_contacts


# Bindings with the number of their term in the scene.
_NumberedBindings = tuple[tuple[int, Binding], ...]


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
    pairs: dict[PairKey, TouchingPairs]
    unpaired: tuple[tuple[int, str], ...]
    """Pair terms that do not act, by their number, and why."""
    overlaps: dict[tuple[int, int], AnyOverlap]
    """Bodies that overlap by more than a contact, by their numbers."""

    @property
    def bindings(self) -> _NumberedBindings:
        """All bindings, natural ones first."""
        return (*self.natural, *self.prescribed, *self.radiating)


def take_snapshots(
    scene: Scene,
    prepared: tuple[PreparedGroup, ...],
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
    # The geometry halfway between two snapshots is exact to second order in their
    # distance for whatever moves smoothly.
    times = [(start + stop) / 2 for start, stop in zip(starts, stops, strict=True)]
    snapshots = []
    surfaced = bodies_with_surface(scene)
    poses_at = [tuple(body.pose.at(time) for body in surfaced) for time in times]
    together = moving_together(
        poses_at, min(body.structure.grid.pitch for body in surfaced)
    )
    for time, poses in zip(times, poses_at, strict=True):
        placed = tuple(
            PlacedGrid(body.structure.grid, pose, f"body {index}")
            for index, (body, pose) in enumerate(zip(surfaced, poses, strict=True))
        )
        overlaps = _overlaps(placed)
        contacts = find_contacts(scene, placed)
        bodies = _body_surfaces(
            surfaced,
            poses=poses,
            together=together,
            covered=contacts.covered,
            dtype=np.dtype(scene.dtype),
            prune=once,
        )
        half_cell = half_cells_of(prepared)
        if any(fraction is not None for fraction in contacts.covered):
            exposed = [body.exposed_fraction for body in bodies]
            half_cell = half_cell * np.concatenate(exposed)
        surface = Surface(
            bodies=bodies,
            half_cell=half_cell,
            references=references_of(prepared)[: len(surfaced)],
            temperatures=temperatures,
            end=end,
        )
        terms = [term.at(time) for term in scene.terms]
        bound = _bind_terms(terms, surface)
        snapshots.append(
            Snapshot(
                surface=bound.surface,
                natural=bound.natural,
                prescribed=bound.prescribed,
                radiating=bound.radiating,
                omitted=bound.omitted,
                irradiation=bound.irradiation,
                pairs=contacts.pairs,
                unpaired=contacts.unpaired,
                overlaps=overlaps,
            )
        )
    return _without_idle(snapshots) if prune else snapshots


def _without_idle(snapshots: list[Snapshot]) -> list[Snapshot]:
    """The snapshots without bindings that act at none of them."""
    flags = iter([bool(is_acting.any()) for is_acting in acting(snapshots)])
    first = snapshots[0]
    is_used = {
        field: [next(flags) for _ in getattr(first, field)]
        for field in ("natural", "prescribed", "radiating")
    }
    return [
        snapshot._replace(
            **{
                field: tuple(itertools.compress(getattr(snapshot, field), used))
                for field, used in is_used.items()
            }
        )
        for snapshot in snapshots
    ]


def acting(snapshots: list[Snapshot]) -> list[Bool[np.ndarray, " s"]]:
    """Fragments on which each binding acts at any snapshot."""
    # A light that moves reaches a fragment at some snapshots only.
    rows = zip(*(snapshot.bindings for snapshot in snapshots), strict=True)
    return [np.any([binding.acting for _, binding in row], axis=0) for row in rows]


def _body_surfaces(
    bodies: tuple[Body, ...],
    poses: tuple[Pose, ...],
    together: tuple[tuple[int, ...], ...],
    covered: list[Float[np.ndarray, " _"] | None],
    dtype: Any,
    prune: bool,
) -> tuple[BodySurface, ...]:
    # Covered is the fraction of each fragment that another body touches, if any.
    grids = tuple(body.structure.grid for body in bodies)
    placed = [
        placed_surface(grid, pose) for grid, pose in zip(grids, poses, strict=True)
    ]
    occluders = tuple(
        Occluder.of_bodies(
            tuple(grids[number] for number in group),
            poses=tuple(poses[number] for number in group),
            triangles=[placed[number].triangles for number in group],
        )
        for group in together
    )
    enclosing = enclosing_bodies(
        grids,
        poses=poses,
        inside=tuple(body.inside for body in bodies),
    )
    surfaces = []
    for index, (body, pose) in enumerate(zip(bodies, poses, strict=True)):
        grid = body.structure.grid
        exposed = _exposed(grid, covered[index], dtype)
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
                emissivity=emissivity,
                absorptivity=absorptivity,
                occluders=occluders,
                dtype=dtype,
                enclosing=enclosing[index],
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
    grid: AbstractGrid, covered: Float[np.ndarray, " s"] | None, dtype: Any
) -> _Exposed:
    """The exposed part of a surface with these covered fractions; None for none."""
    fraction = np.ones(len(grid.fragment_area))
    if covered is not None:
        fraction = 1 - covered
    area = (grid.fragment_area * fraction).astype(dtype)
    return _Exposed(area, fraction.astype(dtype), fraction > 0)


def _reached(term: AbstractSurfaceTerm, surface: Surface) -> Surface:
    """The surface that a term reaches; terms from outside reach no closed cavity."""
    # A mask names every single fragment and a face one side: they apply as they are.
    selection: AbstractSelection | None = getattr(term, "on", None)
    named = selection is not None and not selection.is_geometric
    return surface.outside if term.from_outside and not named else surface


def _irradiation(
    term: AbstractRadiativeTerm, surface: Surface
) -> tuple[Irradiation, ...]:
    """Irradiation by a term, without the closed cavities that it does not reach."""
    everywhere = term.irradiation(surface)
    if _reached(term, surface) is surface:
        return everywhere
    enclosed = np.concatenate(
        [
            np.zeros(n, bool) if body.enclosed is None else body.enclosed
            for n, body in zip(surface.counts, surface.bodies, strict=True)
        ]
    )
    return tuple(
        irradiation._replace(factor=irradiation.factor * ~enclosed)
        for irradiation in everywhere
    )


# Overlaps depend on voxels and poses alone: they are computed once for all runs, and
# again for pairs of which one has moved.
def _overlaps(
    placed: tuple[PlacedGrid, ...],
) -> dict[tuple[int, int], AnyOverlap]:
    if len(placed) == 1:
        return {}
    return found(
        tuple(body.grid for body in placed),
        by=("overlaps", tuple(body.pose.key for body in placed)),
        find=lambda: find_overlaps(placed),
    )


class _BoundTerms(NamedTuple):
    """Surface terms bound to a surface; see the fields of `Snapshot`."""

    surface: Surface
    natural: _NumberedBindings
    prescribed: _NumberedBindings
    radiating: _NumberedBindings
    omitted: tuple[tuple[int, Omitted], ...]
    irradiation: tuple[tuple[str, Irradiation], ...]


def _bind_terms(terms: Sequence[AbstractTerm], surface: Surface) -> _BoundTerms:
    """Bind all surface terms, those that prescribe a temperature first.

    Raises:
        InputError: if two terms prescribe the temperature of one piece of surface, or
            both compute its emission.
    """
    surface_terms = {
        n: term for n, term in enumerate(terms) if isinstance(term, AbstractSurfaceTerm)
    }
    irradiation = _bind_irradiation(surface_terms, surface)
    dirichlet = {n: term for n, term in surface_terms.items() if term.is_dirichlet}
    prescribed, omitted = _bind_laws(dirichlet, surface, irradiation)
    free = surface
    radiating: _NumberedBindings = ()
    if prescribed:
        # Other terms have no effect where a temperature is prescribed.
        claimed = claimed_fragments(
            prescribed, dirichlet, surface=surface, verb="hold", how="at a temperature"
        )
        free = _within(surface, claimed < 0)
        # But other surfaces receive radiation from there, which the balance needs.
        exchange = {
            n: term
            for n, term in surface_terms.items()
            if isinstance(term, AbstractExchangeTerm)
        }
        held = _within(surface, claimed >= 0)
        radiating, _ = _bind_laws(exchange, held, irradiation)
    natural, omitted_natural = _bind_laws(
        {n: term for n, term in surface_terms.items() if not term.is_dirichlet},
        free,
        irradiation,
    )
    reached = {
        (n, body)
        for n, binding in radiating
        for body, is_acting in enumerate(surface.apart(binding.acting))
        if is_acting.any()
    }
    emission = [
        (n, binding)
        for n, binding in (*natural, *radiating)
        if terms[n].name == "emission"
    ]
    if len(emission) > 1:
        claimed_fragments(
            emission,
            surface_terms,
            surface=surface,
            verb="count the emission of",
            how="",
        )
    return _BoundTerms(
        surface=free,
        natural=natural,
        prescribed=prescribed,
        radiating=radiating,
        omitted=tuple(
            (n, omission)
            for n, omission in (*omitted, *omitted_natural)
            if (n, omission.body) not in reached
        ),
        irradiation=tuple(
            (term.absorbed_by, reaching)
            for n, term in surface_terms.items()
            if isinstance(term, AbstractRadiativeTerm)
            for reaching in irradiation[n]
        ),
    )


def _located(number: int, term: AbstractTerm) -> AbstractContextManager:
    return located(f"terms[{number}], {term.name}")


def _bind_irradiation(
    terms: dict[int, AbstractSurfaceTerm], surface: Surface
) -> dict[int, tuple[Irradiation, ...]]:
    """Irradiation by each radiative term, by its number."""
    # A camera sees what reaches the surface even where none of it is absorbed.
    irradiation = {}
    for n, term in terms.items():
        if isinstance(term, AbstractRadiativeTerm):
            with _located(n, term):
                irradiation[n] = _irradiation(term, surface)
    return irradiation


def _bind_laws(
    terms: Mapping[int, AbstractSurfaceTerm],
    surface: Surface,
    irradiation: dict[int, tuple[Irradiation, ...]],
) -> tuple[_NumberedBindings, list[tuple[int, Omitted]]]:
    """Bindings of terms to a surface, and omissions, with the numbers of the terms."""
    bindings = []
    omitted = []
    for n, term in terms.items():
        with _located(n, term):
            reached = _reached(term, surface)
            if isinstance(term, AbstractRadiativeTerm):
                results = term.absorbed(reached, irradiation[n])
            else:
                results = term.bind(reached)
            for result in results:
                if isinstance(result, Omitted):
                    omitted.append((n, result))
                else:
                    bindings.append((n, result))
    return tuple(bindings), omitted


def _within(surface: Surface, is_within: Bool[np.ndarray, " s"]) -> Surface:
    """The surface with natural boundaries on a part of it alone."""
    pairs = zip(surface.bodies, surface.apart(is_within), strict=True)
    bodies = tuple(
        replace(body, natural=body.natural & body_within) for body, body_within in pairs
    )
    return replace(surface, bodies=bodies)
