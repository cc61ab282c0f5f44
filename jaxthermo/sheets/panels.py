"""Panels of a sheet: plates for its convection.

A panel is a connected part of the surface without a crease: across each of its edges
the normals turn by less than 30 degrees. Its silhouette along the direction in which it
is flattest is that of the plate.
"""

import numpy as np
from jaxtyping import Float, Int

from ..geometry.mesh import connected_labels, edges_of
from ..geometry.vectors import row_dot, unit_vectors
from ..memo.found import found
from ..voxels.body_shape import Plate, Plates, plate_across
from .sheet_grid import SheetGrid


_CREASE = np.cos(np.radians(30))
"""Cosine of the turn from which an edge is a crease."""


def panels(grid: SheetGrid) -> Plates:
    """Panels of a sheet as plates, and the one that each fragment is on."""
    return found((grid,), "panels", lambda: _panels(grid))


def _panels(grid: SheetGrid) -> Plates:
    cells = grid.cells
    triangle_panel = _without_creases(cells.vertices, cells.faces)
    fragments = cells.fragments
    # A fragment has nearly one normal, and is on one panel but for slivers.
    member = np.zeros(len(fragments.area), np.int64)
    member[fragments.of_corner.ravel()] = np.repeat(triangle_panel, 3)
    used, member = np.unique(member, return_inverse=True)
    plates = [
        _plate(cells.vertices, cells.faces[triangle_panel == number]) for number in used
    ]
    return Plates(tuple(plates), np.tile(member, 2))


def _without_creases(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> Int[np.ndarray, " t"]:
    """Number of the part without a crease that each triangle belongs to."""
    count = len(faces)
    edges = edges_of(faces)
    triangle = edges.order // 3
    # Neighbours along an edge, whatever their number.
    same = np.flatnonzero(np.diff(edges.edge[edges.order]) == 0)
    first = triangle[same]
    second = triangle[same + 1]
    corners = vertices[faces]
    normal = unit_vectors(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    )
    # Neighbours of any orientation: a mesh need not be consistently oriented.
    smooth = np.abs(row_dot(normal[first], normal[second])) > _CREASE
    return connected_labels(count, np.stack([first[smooth], second[smooth]], axis=1))


def _plate(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]) -> Plate:
    corners = vertices[np.unique(faces)]
    centred = corners - corners.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return plate_across(axes[:, 0], corners)
