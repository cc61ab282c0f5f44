"""Where a parameter lies in a scene: "bodies.0.structure.weights.within" and the like.

Names are those of the Python objects, `bodies`, `terms` and their fields; a list index
is a number. `weights` and `material` stand for those of a scene's only body, and a
term may be named by its mechanism, as in `sun.irradiance`.
"""

import difflib
from dataclasses import fields, is_dataclass
from typing import Any

import equinox as eqx

from jaxthermo.errors import InputError
from jaxthermo.scene.compile.compile import mechanism_names
from jaxthermo.scene.scene import Scene


Path = tuple[str | int, ...]

SHORT = {
    "weights": ("bodies", 0, "structure", "weights"),
    "material": ("bodies", 0, "material"),
    "temperature": ("bodies", 0, "temperature"),
}
"""Of a scene of one body."""

RENAMED = {"absorptivity": "own_absorptivity"}
"""Fields that are called otherwise where they are kept."""


def find(scene: Scene, name: str) -> Path:
    """The path that a name stands for.

    Args:
        scene: that it must lie in.
        name: dotted.

    Raises:
        InputError: if there is no such thing in the scene.
    """
    parts: Path = tuple(int(p) if p.isdigit() else p for p in name.split("."))
    parts = _spelled_out(scene, name, parts)
    here: Any = scene
    for depth, part in enumerate(parts):
        known = _parts_of(here)
        if part not in known:
            before = ".".join(map(str, parts[:depth])) or "a scene"
            close = difflib.get_close_matches(str(part), map(str, known), 1)
            hint = f"; did you mean '{close[0]}'?" if close else ""
            there = ", ".join(map(str, known)) or "nothing to be fitted"
            raise InputError(
                f"parameter {name}: {before} has no '{part}'{hint} (it has {there})"
            )
        here = _child(here, part)
    if _parts_of(here):
        some = ", ".join(map(str, _parts_of(here)))
        raise InputError(f"parameter {name}: name one of its parts: {some}")
    return parts


def _spelled_out(scene: Scene, name: str, parts: Path) -> Path:
    head, rest = parts[0], parts[1:]
    if head in SHORT:
        if len(scene.bodies) > 1:
            raise InputError(
                f"parameter {name}: the scene has {len(scene.bodies)} bodies: say "
                "which, as in " + ".".join(map(str, (*SHORT[str(head)], *rest)))
            )
        parts = (*SHORT[str(head)], *rest)
    elif head in (names := mechanism_names(scene)):
        parts = ("terms", names.index(str(head)), *rest)
    return tuple(RENAMED.get(p, p) if isinstance(p, str) else p for p in parts)


def get(scene: Scene, path: Path) -> Any:
    """What lies at a path."""
    here: Any = scene
    for part in path:
        here = _child(here, part)
    return here


def put(scene: Scene, path: Path, value: Any) -> Scene:
    """The scene with another value at a path."""
    return eqx.tree_at(
        lambda s: get(s, path), scene, value, is_leaf=lambda leaf: leaf is None
    )


def _child(here: Any, part: str | int) -> Any:
    if isinstance(part, int):
        return here[part]
    return getattr(here, part)


def _parts_of(here: Any) -> tuple[str | int, ...]:
    """Names or numbers of what lies within; none of a value."""
    if isinstance(here, list | tuple):
        return tuple(range(len(here)))
    if is_dataclass(here):
        return tuple(
            f.name for f in fields(here) if not f.metadata.get("static", False)
        )
    return ()
