"""Parts of equal geometry at several positions: one mesh, and a pose of each part."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .mesh import Mesh, Pose
from .vectors import triple


_TOLERANCE = 1e-5
"""Distance between positions that are equal, over the extent of the part [-]: the
digits of a text file, or of float32."""


class PlacedPart(NamedTuple):
    """A part in a frame that it shares with all parts of its geometry."""

    mesh: Mesh
    """In the frame of the first of these parts, which is that of the file."""
    pose: Pose
    """From that frame to the position of this part in the file."""


def placed_parts(parts: Mapping[str, Mesh]) -> dict[str, PlacedPart]:
    """Find the parts that are copies of another one, turned and moved.

    A copy has the same triangles in the same order. A part of another scale, and a
    mirror image, has a mesh of its own.
    """
    alike: dict[tuple[int, bytes], list[Mesh]] = {}
    placed = {}
    for name, mesh in parts.items():
        meshes = alike.setdefault((len(mesh.vertices), mesh.faces.tobytes()), [])
        poses = ((first, _pose_between(first, mesh)) for first in meshes)
        copies = (PlacedPart(first, pose) for first, pose in poses if pose is not None)
        part = next(copies, None)
        if part is None:
            meshes.append(mesh)
            part = PlacedPart(mesh, Pose())
        placed[name] = part
    return placed


def _pose_between(first: Mesh, second: Mesh) -> Pose | None:
    """The pose that takes the vertices of a mesh to those of another; None for none.

    Source: Kabsch, "A solution for the best rotation to relate two sets of vectors"
    (1976).
    """
    centre = first.vertices.mean(axis=0)
    second_centre = second.vertices.mean(axis=0)
    arms = first.vertices - centre
    second_arms = second.vertices - second_centre
    allowed = _TOLERANCE * float(np.abs(arms).max(initial=0.0))
    if np.abs(arms - second_arms).max(initial=0.0) <= allowed:
        return Pose(triple(second_centre - centre))
    left, _, right = np.linalg.svd(arms.T @ second_arms)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs @ right).T
    if np.abs(arms @ rotation.T - second_arms).max() > allowed:
        return None
    rows = tuple(map(triple, rotation))
    return Pose(triple(second_centre - rotation @ centre), rows)
