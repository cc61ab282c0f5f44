"""Named parts of a mesh file, and patterns of their names."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from ..errors import InputError
from .files.file_mesh import ABSENT, FileMesh, unique_labels
from .files.read import read_contents, read_mesh
from .load import FileScale, file_scale, placed_mesh
from .mesh import Mesh, joined
from .repair import repair_mesh


def load_parts(
    path: str | os.PathLike[str],
    *,
    unit: str | float | int | None = None,
    height: float | int | None = None,
    up: str = "z",
) -> dict[str, Mesh]:
    """Read the named parts of a mesh file, each as a separate mesh.

    A part's name is "node/mesh/material": node, mesh and material of a GLB, glTF or
    DAE, object, group and material of an OBJ; "-" stands for one that there is not. The
    second part of a name ends in "#2". Names are in the order of the file, and the same
    in every run. Parts have the positions that `load_mesh` gives them with the same
    arguments. A part may be closed, or a patch of a surface: no hole is filled, and the
    front of a patch is where the file has it.

    Args:
        path: the file.
        unit: length of one file unit, as a name ("mm") or in metres.
        height: instead of `unit`: the extent of all parts along the up axis [m].
        up: the file's axis that points up.

    Raises:
        InputError: as `load_mesh`.
    """
    path = Path(path).expanduser()
    scale = file_scale(path, unit=unit, height=height, up=up)
    return separate_parts(path, read_mesh(path, read_contents(path)), scale)


def separate_parts(path: Path, mesh: FileMesh, scale: FileScale) -> dict[str, Mesh]:
    """The parts of the mesh of a file, as `load_parts` returns them.

    Raises:
        InputError: for a flat mesh that the height would scale.
    """
    placed = placed_mesh(path, mesh, scale)
    counts = np.bincount(placed.part, minlength=len(placed.names))
    by_part = placed.faces[np.argsort(placed.part, kind="stable")]
    faces_of_parts = np.split(by_part, np.cumsum(counts)[:-1])
    meshes = {}
    for label, faces in zip(unique_labels(placed.names), faces_of_parts, strict=True):
        if not len(faces):
            continue
        # Its own vertices alone: repairing all of them takes as long as all parts.
        used, renumbered = np.unique(faces, return_inverse=True)
        patch = Mesh(
            vertices=placed.vertices[used],
            faces=renumbered.reshape(faces.shape),
            name=label,
            axes=scale.axes,
        )
        # Welded, so that a closed part is watertight.
        meshes[label] = repair_mesh(patch, max_hole_edges=0, turns_open=False)
    return meshes


def matching_parts(pattern: str, names: Iterable[str]) -> list[str]:
    """Names of parts that a pattern stands for.

    A pattern with a "/" is that of a whole name. One without matches the node, the mesh
    or the material. In it "*" stands for any characters, and "?" for one.
    """
    names = list(names)
    if pattern in names:
        return [pattern]
    expression = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    if "/" in pattern:
        return [name for name in names if re.fullmatch(expression, name)]
    return [
        name
        for name in names
        if any(re.fullmatch(expression, word) for word in _words(name))
    ]


def _words(name: str) -> list[str]:
    return [name, *re.sub(r"#\d+$", "", name).split("/")]


def short_names(names: Sequence[str]) -> list[str]:
    """The first word of each name of a part, or all of it where others have that word.

    The first word is the node, else the mesh or the material that the file names.
    """
    firsts = [_first_word(name) for name in names]
    count = Counter(firsts)
    return [
        first if count[first] == 1 else name
        for first, name in zip(firsts, names, strict=True)
    ]


def _first_word(name: str) -> str:
    _, *words = _words(name)
    return next((word for word in words if word != ABSENT), name)


_MAX_LISTED = 12
"""Largest number of names of parts in a message."""


def pattern_of_parts(
    names: list[str], patterns: list[str], argument: str
) -> dict[str, str]:
    """The pattern that is for each part, by the part's name.

    A pattern without "/" matches the node, the mesh or the material of a part; "*" is
    for all parts that nothing else names.

    Raises:
        InputError: for a part of no or of several patterns, or a pattern of no part.
    """
    listed = listed_names(names)
    pattern_of: dict[str, str] = {}
    for pattern in patterns:
        matching = [] if pattern == "*" else matching_parts(pattern, names)
        if not matching and pattern != "*":
            raise InputError(
                f"{argument}: there is no part {pattern!r}; there are {listed}"
            )
        for name in matching:
            earlier = pattern_of.setdefault(name, pattern)
            # A whole name says more than a pattern.
            if name == pattern:
                pattern_of[name] = pattern
            elif earlier not in (name, pattern):
                raise InputError(
                    f"{argument}: both {earlier!r} and {pattern!r} match the part "
                    f"{name!r}: give its whole name"
                )
    missing = [name for name in names if name not in pattern_of]
    if missing and "*" not in patterns:
        raise InputError(
            f"{argument}: the part {missing[0]!r} has none: give one for each of "
            f"{listed}, or '*' for all others"
        )
    return {name: pattern_of.get(name, "*") for name in names}


def listed_names(names: Sequence[str]) -> str:
    """Names of parts in a message: "roof, door and 58 more"."""
    listed = ", ".join(names[:_MAX_LISTED])
    if len(names) > _MAX_LISTED:
        listed += f" and {len(names) - _MAX_LISTED:,} more (jaxthermo parts lists them)"
    return listed


class RuleFault(NamedTuple):
    """A rule that does nothing, or parts without a rule."""

    rule: int | None
    """Number of the rule; None for parts without one."""
    line: str


class AssignedRules(NamedTuple):
    """Rules of parts."""

    rule_of: dict[str, int]
    """Number of the rule of each part by its name, in the order of the parts."""
    faults: list[RuleFault]


def assign_rules(
    rules: Sequence[Sequence[str]], short: Mapping[str, str]
) -> AssignedRules:
    """Find the first rule that matches each part.

    Args:
        rules: patterns of names of each rule, as in `matching_parts`; a short name is
            a pattern of this part alone.
        short: names of all parts, with their short names.
    """
    rule_of: dict[str, int] = {}
    faults = []
    for number, patterns in enumerate(rules):
        count = len(rule_of)
        unmatched = []
        for pattern in patterns:
            matching = [name for name in short if pattern == short[name]]
            matching = matching or matching_parts(pattern, short)
            if not matching:
                unmatched.append(pattern)
            for name in matching:
                rule_of.setdefault(name, number)
        if unmatched:
            existing = listed_names(list(short.values()))
            line = f"there is no part {unmatched[0]!r}; there are {existing}"
            faults.append(RuleFault(number, line))
        # One for all that is left may find nothing left.
        elif len(rule_of) == count and "*" not in patterns:
            line = "earlier rules match all of its parts: move it up, or remove it"
            faults.append(RuleFault(number, line))
    missing = [short[name] for name in short if name not in rule_of]
    # A pattern that matches nothing explains parts without a rule.
    if missing and not faults:
        line = (
            f"no rule is for {listed_names(missing)}: give one, or '*' for all others"
        )
        faults.append(RuleFault(None, line))
    in_order = {name: rule_of[name] for name in short if name in rule_of}
    return AssignedRules(in_order, faults)


class JoinedParts(NamedTuple):
    """One mesh of several parts."""

    mesh: Mesh
    face_part: Int[np.ndarray, " f"]
    """Number of the part that each face belongs to."""


def joined_parts(meshes: Sequence[Mesh]) -> JoinedParts:
    """Concatenate meshes in their order; a single one is returned as it is."""
    counts = [len(mesh.faces) for mesh in meshes]
    face_part = np.repeat(np.arange(len(meshes)), counts)
    if len(meshes) == 1:
        return JoinedParts(meshes[0], face_part)
    vertices, faces = joined([(mesh.vertices, mesh.faces) for mesh in meshes])
    first = meshes[0]
    mesh = Mesh(vertices=vertices, faces=faces, name=first.name, axes=first.axes)
    return JoinedParts(mesh, face_part)
