"""The mesh of a file as every reader returns it, and the reason why there is none."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...extras import install_commands, is_installed


ABSENT = "-"
"""Name of a node, mesh or material that a file does not have."""


class FileFault(Exception):
    """Reason why a file is no readable mesh, and what its owner can do."""

    def __init__(self, fault: str, remedy: str = "export or copy the file again"):
        super().__init__(fault)
        self.remedy = remedy


class FileContents(NamedTuple):
    """Bytes of a mesh file and of the files that it refers to."""

    data: bytes
    files: Mapping[str, bytes]
    """Content of the files of a glTF by their addresses in it."""


class PartName(NamedTuple):
    """Names of a part of a file."""

    node: str = ABSENT
    """Node of a scene, object of an OBJ, or solid of an STL."""
    mesh: str = ABSENT
    """Mesh of the node, or group of an OBJ."""
    material: str = ABSENT

    @property
    def label(self) -> str:
        """The name as users write it: node/mesh/material."""
        return "/".join(name.replace("/", "_") for name in self)


class FilePart(NamedTuple):
    """Triangles of one part, with vertices of its own."""

    name: PartName
    vertices: Float[np.ndarray, "v 3"]
    """Positions in units of the file."""
    faces: Int[np.ndarray, "f 3"]


def placed_part(
    name: PartName,
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    matrix: Float[np.ndarray, "4 4"],
) -> FilePart:
    """A part, moved by the matrix from the coordinates of its node to the scene's."""
    linear = np.asarray(matrix[:3, :3], np.float64)
    # A reflection turns the surface inside out.
    is_mirrored = np.linalg.det(linear) < 0.0
    return FilePart(
        name,
        vertices=vertices @ linear.T + np.asarray(matrix[:3, 3], np.float64),
        faces=faces[:, ::-1] if is_mirrored else faces,
    )


class FileMesh(NamedTuple):
    """All triangles of a file, in its units and axes."""

    vertices: Float[np.ndarray, "v 3"]
    """Positions in units of the file."""
    faces: Int[np.ndarray, "f 3"]
    part: Int[np.ndarray, " f"]
    """Number of the part of each triangle."""
    names: tuple[PartName, ...]
    """Names of the parts; they may be equal."""
    metres_per_unit: float | None = None
    """Length of a unit that the file or its format states [m]."""


Reader = Callable[[FileContents], FileMesh]


def joined_parts(
    parts: Sequence[FilePart], metres_per_unit: float | None = None
) -> FileMesh:
    """The mesh of several parts.

    Raises:
        FileFault: for a face with a vertex that its part does not have.
    """
    vertices: list[np.ndarray] = [np.zeros((0, 3))]
    faces: list[np.ndarray] = [np.zeros((0, 3), np.int64)]
    part: list[np.ndarray] = [np.zeros(0, np.int64)]
    first_vertex = 0
    for number, file_part in enumerate(parts):
        # Beyond its part an index would be a vertex of another one.
        require_vertices(file_part.faces, len(file_part.vertices))
        vertices.append(file_part.vertices)
        faces.append(file_part.faces.astype(np.int64) + first_vertex)
        part.append(np.full(len(file_part.faces), number))
        first_vertex += len(file_part.vertices)
    return FileMesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        part=np.concatenate(part),
        names=tuple(file_part.name for file_part in parts),
        metres_per_unit=metres_per_unit,
    )


def require_vertices(indices: Int[np.ndarray, "..."], vertex_count: int) -> None:
    """Refuse indices of vertices that do not exist.

    Raises:
        FileFault: naming the index.
    """
    if not indices.size:
        return
    lowest = int(indices.min())
    highest = int(indices.max())
    if lowest < 0 or highest >= vertex_count:
        index = lowest if lowest < 0 else highest
        raise FileFault(
            f"a face index is out of range: {index}, counted from 0, of "
            f"{vertex_count} vertices"
        )


def require_package(package: str, purpose: str) -> None:
    """Refuse what needs a package that is not installed.

    Args:
        package: its name as a module.
        purpose: what needs it, as the beginning of a sentence: "3MF files".

    Raises:
        FileFault: with the command that installs it.
    """
    if not is_installed(package):
        raise FileFault(
            f"{purpose} need the package {package}",
            remedy=f"run {install_commands('formats')}",
        )


def unique_labels(names: Sequence[PartName]) -> list[str]:
    """Labels of parts; the second part of a name ends in #2."""
    used: set[str] = set()
    next_number: dict[str, int] = {}
    labels = []
    for name in names:
        label = name.label
        while label in used:
            number = next_number.get(name.label, 2)
            next_number[name.label] = number + 1
            label = f"{name.label}#{number}"
        used.add(label)
        labels.append(label)
    return labels
