"""What is in a compiled program and how far it reaches; what is not, and why."""

import numpy as np

from .compile.contacts import Touching
from .compile.program import LedgerEntry
from .compile.surface_terms import Bound
from .receipt import Omission, Part
from .scene import AbstractMaterials, Scene


ABSENT = {
    "sun": "the scene has no source",
    "convection": "the scene has no moving air or coefficient",
    "emission": "the scene has no surroundings",
}
"""Why a mechanism of most scenes is not in this one."""

SOURCES = {"sun", "point_source", "area_source"}
AIR = {"convection", "wind", "free_convection"}


def omissions(
    scene: Scene,
    names: tuple[str, ...],
    bounds: list[Bound],
    others: list[Omission],
    moving: bool,
) -> tuple[Omission, ...]:
    """All that was left out.

    Args:
        scene: as compiled.
        names: of its terms.
        bounds: of every body, at the first moment.
        others: of terms that do not act on surfaces.
        moving: whether the scene is taken anew while it runs.
    """
    found = []
    for index, (body, bound) in enumerate(zip(scene.bodies, bounds, strict=True)):
        where = f" on body {index}" if len(bounds) > 1 else ""
        found += [Omission(names[n] + where, why) for n, why in bound.omitted]
        if not isinstance(body.material, AbstractMaterials):
            found.append(
                Omission(f"per-node conductivity{where}", "the material is uniform")
            )
    found += [*others, *_absent(scene)]
    if not moving:
        found.append(Omission("motion", "nothing moves: one snapshot"))
    return tuple(found)


def _absent(scene: Scene) -> list[Omission]:
    """Mechanisms that one might look for and that nothing in the scene asks for."""
    present = {term.name for term in scene.terms}
    present |= {"sun"} if present & SOURCES else set()
    present |= {"convection"} if present & AIR else set()
    missing = [
        Omission(name, why) for name, why in ABSENT.items() if name not in present
    ]
    if "contact" in present:
        return missing
    one = "there is one body" if len(scene.bodies) == 1 else "no term joins the bodies"
    return [*missing, Omission("contact", one)]


def parts(
    entries: tuple[LedgerEntry, ...],
    numbers: list[tuple[int, ...]],
    bounds: list[Bound],
    touching: Touching,
) -> tuple[Part, ...]:
    """How much of the bodies' surfaces each entry of the ledger acts on.

    Args:
        entries: of the ledger.
        numbers: of each, its term and its bodies.
        bounds: of every body.
        touching: the bodies in contact.
    """
    found = []
    for entry, (number, *bodies) in zip(entries, numbers, strict=True):
        bound = bounds[bodies[0]]
        area = bound.surface.grid.fragment_area
        if len(bodies) == 2:
            pairs = touching.pairs.get((number, bodies[0], bodies[1]))
            reached = 0.0 if pairs is None else float(pairs.area.sum())
        else:
            acts = [e.binding.acts for e in bound.everything if e.number == number]
            reached = float(area[np.any(acts, axis=0)].sum()) if acts else 0.0
        share = reached / float(area.sum())
        found.append(Part(entry.mechanism, tuple(bodies), reached, share))
    return tuple(found)
