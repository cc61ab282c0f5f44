"""The receipt of a compiled scene: what it includes, what was left out, and why."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass

from .scene import AbstractMaterials, Scene


@dataclass(frozen=True)
class Omission:
    """A mechanism that is not in the program."""

    what: str
    why: str


@dataclass(frozen=True)
class Part:
    """The surface of one body, or of two in contact, that a mechanism acts on."""

    mechanism: str
    bodies: tuple[int, ...]
    area: float
    """At the start [m^2]; 0 for what acts inside."""
    surface_share: float
    """Fraction of the surface of the first of the bodies [-]."""


@dataclass(frozen=True, eq=False)
class Receipt:
    """Contents of a compiled scene."""

    included: tuple[str, ...]
    parts: tuple[Part, ...]
    left_out: tuple[Omission, ...]
    notes: tuple[str, ...]
    """Remarks on the validity of laws: ranges that were left, data that is not sure."""
    nodes: int
    links: int
    fragments: int
    snapshots: int
    """Number of geometries, as bodies and sources move; 1 if nothing does."""
    capacity_ratios: tuple[float, ...]
    """Heat capacity of each body's nodes over that of the body [-]."""
    dtype: str
    memory_bytes: int
    """Estimate of the solver's peak: states, operators and surface arrays."""
    stable_step_s: float | None
    """Largest explicit step; None where there is no limit, or none is known."""

    def as_dict(self) -> dict:
        """Plain types, for `summary.json`."""
        return asdict(self)


_ABSENT = {
    "sun": ("the scene has no source", {"sun", "point_source", "area_source"}),
    "convection": (
        "the scene has no moving air or coefficient",
        {"convection", "wind", "free_convection"},
    ),
    "emission": ("the scene has no surroundings", {"emission"}),
}
# Why a mechanism of most scenes is not in this one, and the terms that stand for it.


def on_body(name: str, body: int, scene: Scene) -> str:
    """A mechanism's name on one body of a scene."""
    return f"{name} on body {body}" if len(scene.bodies) > 1 else name


def omissions(
    scene: Scene, omitted: list[list[Omission]], others: Iterable[Omission], moves: bool
) -> tuple[Omission, ...]:
    """All that was left out.

    Args:
        scene: as compiled.
        omitted: surface terms, by body.
        others: terms that do not act on surfaces.
        moves: True if the geometry changes in the run.
    """
    found = []
    for index, body in enumerate(scene.bodies):
        found += omitted[index]
        if not isinstance(body.material, AbstractMaterials):
            name = on_body("per-node conductivity", index, scene)
            found.append(Omission(name, "the material is uniform"))
    found += [*others, *_absent(scene)]
    if not moves:
        found.append(Omission("motion", "nothing moves: one snapshot"))
    return tuple(found)


def _absent(scene: Scene) -> list[Omission]:
    """Usual mechanisms that nothing in the scene asks for."""
    present = {term.name for term in scene.terms}
    missing = [
        Omission(name, why)
        for name, (why, kinds) in _ABSENT.items()
        if not present & kinds
    ]
    # Contact is missing for one of two reasons, unless a term asks for it.
    if "contact" in present:
        return missing
    one = "there is one body" if len(scene.bodies) == 1 else "no term joins the bodies"
    return [*missing, Omission("contact", one)]
