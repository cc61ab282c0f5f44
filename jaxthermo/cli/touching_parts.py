"""Parts of a mesh file that touch: candidates for the joints of a scene.

Two parts touch where their faces do, or a border of an open part and the other part, up
to the gaps that contacts and seams have by default. Points on the meshes decide, before
there are any voxels or cells.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..geometry.mesh import Mesh, edges_of
from ..geometry.nearby import nearest_triangles, overlapping_boxes
from ..geometry.sample import mesh_sample
from ..geometry.vectors import row_dot, triangle_normals, unit_vectors
from ..physics.contact.search import SHEET_GAP, default_gap


_MIN_COSINE = 0.7
"""Cosine over which two directions are one."""

_ROUNDING = 1e-6
"""Length of a way that rounding makes, over the gap [-]."""

_MIN_POINTS = 200
_MAX_POINTS = 20_000
"""Number of points on the faces, or on the borders, of a part."""


class DividedPart(NamedTuple):
    """A part with the size of its cells."""

    mesh: Mesh
    pitch: float
    """Edge of its voxels, or of the cells of its sheet [m]."""
    is_sheet: bool

    @property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Corners of its faces [m]."""
        return self.mesh.vertices[self.mesh.faces]


def touching_parts(parts: Sequence[DividedPart]) -> list[tuple[int, int]]:
    """Pairs i < j of parts that touch over more than a point."""
    bounds = np.stack([part.mesh.bounds for part in parts])
    pitch = np.array([part.pitch for part in parts])[:, None]
    near = overlapping_boxes(bounds[:, 0] - pitch, bounds[:, 1] + pitch).tolist()
    return [(i, j) for i, j in near if _touch(parts[i], parts[j])]


def _touch(a: DividedPart, b: DividedPart) -> bool:
    pitches = a.pitch, b.pitch
    gap = default_gap(pitches, are_sheets=a.is_sheet and b.is_sheet)
    smaller, larger = sorted((a, b), key=lambda part: part.mesh.area)
    if _touching_area(smaller, larger, gap) >= gap**2:
        return True
    gap = SHEET_GAP * min(pitches)
    length = sum(
        _touching_length(part, other, gap)
        for part, other in ((a, b), (b, a))
        if part.is_sheet
    )
    return length >= gap


def _touching_area(part: DividedPart, other: DividedPart, gap: float) -> float:
    """Area of a part that faces another one within a gap [m^2]."""
    count = int(np.clip(part.mesh.area / gap**2, _MIN_POINTS, _MAX_POINTS))
    sample = mesh_sample(part.mesh, count)
    hits = nearest_triangles(sample.position, other.triangles, gap)
    normal = sample.normal[hits.sample]
    other_normal = unit_vectors(triangle_normals(other.triangles))[hits.triangle]
    facing = -row_dot(normal, other_normal)
    if part.is_sheet or other.is_sheet:
        facing = np.abs(facing)
    way = hits.point - sample.position[hits.sample]
    ahead = np.abs(row_dot(way, normal))
    touches = ahead >= _MIN_COSINE * np.linalg.norm(way, axis=1) - _ROUNDING * gap
    touches &= facing > _MIN_COSINE
    return int(touches.sum()) / count * part.mesh.area


def _touching_length(part: DividedPart, other: DividedPart, gap: float) -> float:
    """Length of the border of a part within a gap of another one [m]."""
    edges = edges_of(part.mesh.faces)
    alone = edges.border
    start = part.mesh.vertices[edges.start[alone]]
    along = part.mesh.vertices[edges.end[alone]] - start
    length = np.linalg.norm(along, axis=1)
    spacing = max(gap, float(length.sum()) / _MAX_POINTS)
    pieces = np.ceil(length / spacing).astype(int)
    edge = np.repeat(np.arange(len(alone)), pieces)
    first = np.cumsum(pieces) - pieces
    fraction = (np.arange(len(edge)) - first[edge] + 0.5) / pieces[edge]
    point = start[edge] + fraction[:, None] * along[edge]
    hits = nearest_triangles(point, other.triangles, gap)
    # Beyond the end of a seam the way to the other part goes along the border.
    way = hits.point - point[hits.sample]
    aside = np.abs(row_dot(way, unit_vectors(along)[edge[hits.sample]]))
    touches = aside <= _MIN_COSINE * np.linalg.norm(way, axis=1) + _ROUNDING * gap
    touching_edge = edge[hits.sample[touches]]
    return float((length / np.maximum(pieces, 1))[touching_edge].sum())
