"""Paths of fitted numbers in a scene, as in "bodies.0.structure.weights.within".

A path consists of the fields of the Python objects and of list indices. `weights`,
`material` and `temperature` stand for those of a scene's only body, and a term may be
named by its mechanism, as in `sun.irradiance`.
"""

import difflib
from dataclasses import fields, is_dataclass
from typing import Any

import equinox as eqx

from jaxthermo.errors import InputError
from jaxthermo.scene.compile.compile import mechanism_names
from jaxthermo.scene.scene import Scene


Path = tuple[str | int, ...]

_ABBREVIATIONS: dict[str, Path] = {
    "weights": ("bodies", 0, "structure", "weights"),
    "material": ("bodies", 0, "material"),
    "temperature": ("bodies", 0, "temperature"),
}
"""Short names in a scene of one body."""

# The constructor's argument and the field that keeps it differ.
_FIELD_OF = {"absorptivity": "given_absorptivity"}


def find_path(scene: Scene, name: str) -> Path:
    """Resolve a dotted name in a scene.

    Raises:
        InputError: if the scene has no such number.
    """
    path: Path = tuple(int(p) if p.isdigit() else p for p in name.split("."))
    path = _expand(scene, name, path)
    node: Any = scene
    for depth, part in enumerate(path):
        known = _children(node)
        if part not in known:
            parent = ".".join(map(str, path[:depth])) or "a scene"
            close = difflib.get_close_matches(str(part), map(str, known), 1)
            hint = f"; did you mean '{close[0]}'?" if close else ""
            listed = ", ".join(map(str, known)) or "nothing to be fitted"
            raise InputError(
                f"parameter {name}: {parent} has no '{part}'{hint} (it has {listed})"
            )
        node = _child(node, part)
    if _children(node):
        listed = ", ".join(map(str, _children(node)))
        raise InputError(f"parameter {name}: name one of its parts: {listed}")
    return path


def _expand(scene: Scene, name: str, path: Path) -> Path:
    head, rest = path[0], path[1:]
    if head in _ABBREVIATIONS:
        if len(scene.bodies) > 1:
            raise InputError(
                f"parameter {name}: the scene has {len(scene.bodies)} bodies: say "
                "which, as in "
                + ".".join(map(str, (*_ABBREVIATIONS[str(head)], *rest)))
            )
        path = (*_ABBREVIATIONS[str(head)], *rest)
    elif head in (names := mechanism_names(scene)):
        path = ("terms", names.index(str(head)), *rest)
    return tuple(_FIELD_OF.get(p, p) if isinstance(p, str) else p for p in path)


def value_at(scene: Scene, path: Path) -> Any:
    """Value at a path."""
    node: Any = scene
    for part in path:
        node = _child(node, part)
    return node


def with_value(scene: Scene, path: Path, value: Any) -> Scene:
    """Copy of the scene with another value at a path."""
    # A value of None is no leaf by default, and could not be replaced.
    return eqx.tree_at(
        lambda s: value_at(s, path), scene, value, is_leaf=lambda leaf: leaf is None
    )


def _child(node: Any, part: str | int) -> Any:
    return node[part] if isinstance(part, int) else getattr(node, part)


def _children(node: Any) -> tuple[str | int, ...]:
    if isinstance(node, list | tuple):
        return tuple(range(len(node)))
    if is_dataclass(node):
        # Static fields are compiled into the program and cannot be fitted.
        return tuple(
            f.name for f in fields(node) if not f.metadata.get("static", False)
        )
    return ()
