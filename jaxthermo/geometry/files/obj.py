"""OBJ files: vertices and faces, in objects, groups and materials."""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from .file_mesh import ABSENT, FileContents, FileFault, FileMesh, PartName
from .polygons import Polygons, triangulated
from .text import decoded, integers, positions


_NAME_FIELDS = {"o": "node", "g": "mesh", "usemtl": "material"}
"""Keywords that begin a part, and the name that they change."""


class _Lines(NamedTuple):
    """Lines of vertices and faces."""

    vertices: list[list[str]]
    faces: list[str]
    vertices_before: list[int]
    """Number of vertices above each face."""
    parts: list[int]
    """Number of the part of each face."""
    names: tuple[PartName, ...]


def read_obj(contents: FileContents) -> FileMesh:
    """Read an OBJ: a part for each combination of object, group and material.

    An OBJ cut off at the end of a line looks complete.
    """
    lines = _lines(decoded(contents.data))
    vertices = positions(lines.vertices)
    # Of v/vt/vn the position alone.
    rows = [re.sub(r"/\S*", "", values).split() for values in lines.faces]
    counts = np.array([len(row) for row in rows], np.int64)
    before = np.array(lines.vertices_before, np.int64)
    corners = _from_first(
        integers([word for row in rows for word in row]),
        vertices_before=np.repeat(before, counts),
    )
    triangles = triangulated(vertices, Polygons(corners, counts=counts))
    return FileMesh(
        vertices=vertices,
        faces=triangles.faces,
        part=np.array(lines.parts, np.int64)[triangles.polygon],
        names=lines.names,
    )


def _lines(text: str) -> _Lines:
    vertices: list[list[str]] = []
    faces: list[str] = []
    vertices_before: list[int] = []
    parts: list[int] = []
    numbers: dict[PartName, int] = {}
    name = PartName()
    for line in text.replace("\\\n", " ").split("\n"):
        keyword, _, values = (
            line.partition("#")[0].strip().replace("\t", " ").partition(" ")
        )
        if keyword == "v":
            vertices.append(values.split())
        elif keyword == "f":
            faces.append(values)
            vertices_before.append(len(vertices))
            parts.append(numbers.setdefault(name, len(numbers)))
        elif keyword in _NAME_FIELDS:
            name = name._replace(**{_NAME_FIELDS[keyword]: values.strip() or ABSENT})
    return _Lines(
        vertices=vertices,
        faces=faces,
        vertices_before=vertices_before,
        parts=parts,
        names=tuple(numbers),
    )


def _from_first(
    corners: Int[np.ndarray, " n"], vertices_before: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Numbers of vertices from 0, of those from 1 or back from the last one above."""
    if (corners == 0).any():
        raise FileFault("a face index is 0, and OBJ counts from 1: it is out of range")
    first = np.where(corners > 0, corners - 1, vertices_before + corners)
    if (first < 0).any():
        index = int(corners[np.argmax(first < 0)])
        raise FileFault(f"a face index is out of range: {index}, back from the last")
    return first
