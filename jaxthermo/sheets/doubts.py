"""Doubts about a surface as a wall: it curves too much, lies twice, or is too narrow.

A wall of thickness d on a surface whose principal curvatures add up to K has a volume
that the surface times d misses by d K / 2, and a back that differs by d K from its
front: from d K = 1 on the wall would fold.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from ..geometry.mesh import edges_of
from ..geometry.vectors import row_dot, row_length, triangle_normals, unit_vectors
from ..memo.found import found
from .coarse import SheetLinks
from .node_complex import CLOSED
from .sheet_grid import SheetGrid


# Sharper edges are corners of the body, such as those of a box.
_SHARPEST_BEND = np.radians(60)

# Cosine of the angle within which two faces are parallel.
_PARALLEL = np.cos(np.radians(2))
# Distance within which they are at one place, over the pitch [-].
_AT_ONE_PLACE = 1e-3
# Largest number of triangles that are tested: their neighbours are lists of numbers.
_TESTED = 5_000

_POOR = 0.9
"""Conductance along a narrow part over the right one, below which it is told [-]."""


def curvature(grid: SheetGrid) -> Float[np.ndarray, " n"]:
    """Mean of the sum of the principal curvatures around each cell [1/m]."""
    return found((grid,), "sheet_curvature", lambda: _curvature(grid))


def _curvature(grid: SheetGrid) -> Float[np.ndarray, " n"]:
    cells = grid.cells
    normal = unit_vectors(triangle_normals(cells.vertices[cells.faces]))
    edges = edges_of(cells.faces)
    paired = edges.pairs
    faces = paired // 3
    # Faces of opposite winding may meet.
    cosine = np.abs(row_dot(normal[faces[:, 0]], normal[faces[:, 1]]))
    bend = np.arccos(np.clip(cosine, 0, 1))
    bend[bend > _SHARPEST_BEND] = 0
    start = cells.vertices[edges.start[paired[:, 0]]]
    length = np.linalg.norm(cells.vertices[edges.end[paired[:, 0]]] - start, axis=1)
    # Half of what an edge bends is each of its two faces'.
    half = np.repeat(bend * length / 2, 2)
    bending = np.bincount(faces.ravel(), half, len(cells.faces))
    count = cells.node_count
    node = cells.vertex_node[cells.faces].ravel()
    total = np.bincount(node, np.repeat(bending / 3, 3), count)
    area = cells.area.sum(axis=1)
    # A cell has few of the edges that a mesh bends at: with those around it.
    links = cells.links
    for _ in range(2):
        total = total + _of_neighbours(total, links)
        area = area + _of_neighbours(area, links)
    return total / area


def _of_neighbours(
    values: Float[np.ndarray, "n *m"], links: SheetLinks
) -> Float[np.ndarray, "n *m"]:
    """Sum of the values of the neighbours of each node."""
    count = len(values)
    return _summed(links.src, values[links.dst], count) + _summed(
        links.dst, values[links.src], count
    )


class DoubleArea(NamedTuple):
    """Part of a surface that lies on another part of it."""

    area: float
    """Area that is there twice or more [m^2]."""
    position: Float[np.ndarray, "3"]
    """A point of it [m]."""


def double_area(grid: SheetGrid) -> DoubleArea | None:
    """Area of a surface that lies on another part of it; None if there is none."""
    return found((grid,), "sheet_double_area", lambda: _double_area(grid))


def _double_area(grid: SheetGrid) -> DoubleArea | None:
    cells = grid.cells
    corners = cells.vertices[cells.faces]
    area_vector = triangle_normals(corners)
    normal = unit_vectors(area_vector)
    centre = corners.mean(axis=1)
    step = -(-len(centre) // _TESTED)
    tested = np.arange(0, len(centre), step)
    sides = row_length(corners - np.roll(corners, 1, axis=1))
    tree = KDTree(centre)
    near = tree.query_ball_point(centre[tested], sides.max(axis=1)[tested])
    sizes = np.array([len(numbers) for numbers in near])
    face = np.repeat(tested, sizes)
    candidate = np.concatenate([np.asarray(numbers, np.int64) for numbers in near])
    distance = np.abs(row_dot(centre[face] - centre[candidate], normal[candidate]))
    parallel = np.abs(row_dot(normal[face], normal[candidate])) > _PARALLEL
    close = (face != candidate) & parallel & (distance < _AT_ONE_PLACE * grid.pitch)
    face = face[close]
    candidate = candidate[close]
    # Inside by a margin: neighbours touch, and slivers round.
    limit = 1e-3 * row_length(area_vector)
    for corner in range(3):
        start = corners[candidate, corner]
        along = corners[candidate, (corner + 1) % 3] - start
        across = np.cross(along, centre[face] - start)
        is_inside = row_dot(across, normal[candidate]) > limit[candidate]
        face = face[is_inside]
        candidate = candidate[is_inside]
    double = np.unique(face)
    if not len(double):
        return None
    area = float(cells.face_area[double].sum()) * step
    return DoubleArea(area=area, position=centre[double[0]])


class PoorConduction(NamedTuple):
    """Part of a surface that conducts too little along itself."""

    ratio: float
    """Conductance over the right one where it is smallest [-]."""
    area_fraction: float
    """Fraction of the surface that conducts too little [-]."""
    position: Float[np.ndarray, "3"]
    """A node of the smallest ratio [m]."""


def poor_conduction(grid: SheetGrid) -> PoorConduction | None:
    """Narrow tubes and bars that conduct too little along themselves; None for none.

    In a field of temperature that rises by 1 K/m along a unit vector e links dissipate
    e M e / 2 and the surface e N e / 2 for a unit of conductivity times thickness,

        M = sum G d d^T / 2,    N = sum A (I - n n^T),

    over the nodes around a node: d the distances of linked nodes, n the normals. The
    field of a bar is nearly linear along it. By Dirichlet's principle a linear field
    dissipates no less than the true one: a bar conducts less than M says.
    """
    return found((grid,), "sheet_poor_conduction", lambda: _poor_conduction(grid))


def _poor_conduction(grid: SheetGrid) -> PoorConduction | None:
    cells = grid.cells
    count = cells.node_count
    links = cells.links
    along = cells.position[links.dst] - cells.position[links.src]
    square = along[:, :, None] * along[:, None, :]
    half = 0.5 * links.weight[:, None, None] * square
    by_links = _summed(links.src, half, count) + _summed(links.dst, half, count)
    normal = unit_vectors(triangle_normals(cells.vertices[cells.faces]))
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    third = cells.face_area / 3
    by_surface = np.zeros((count, 3, 3))
    total_normal = np.zeros((count, 3))
    for node in cells.vertex_node[cells.faces].T:
        by_surface += _summed(node, third[:, None, None] * across, count)
        total_normal += _summed(node, third[:, None] * normal, count)
    area = cells.area.sum(axis=1)
    sums = [by_links, by_surface, total_normal, area]
    for _ in range(2):
        sums = [values + _of_neighbours(values, links) for values in sums]
    by_links, by_surface, total_normal, total_area = sums
    is_closed = np.linalg.norm(total_normal, axis=1) < CLOSED * total_area
    # A small closed piece is a node or two, and no bar.
    degree = np.bincount(np.append(links.src, links.dst), minlength=count)
    narrow = np.flatnonzero(is_closed & (degree > 1))
    strength, direction = np.linalg.eigh(by_links[narrow])
    axis = direction[:, :, 2]
    right = np.einsum("ni,nij,nj->n", axis, by_surface[narrow], axis)
    ratio = strength[:, 2] / right
    is_poor = ratio < _POOR
    if not is_poor.any():
        return None
    return PoorConduction(
        ratio=float(ratio.min()),
        area_fraction=float(area[narrow[is_poor]].sum() / area.sum()),
        position=cells.position[narrow[ratio.argmin()]],
    )


def _summed(
    node: Int[np.ndarray, " k"], values: Float[np.ndarray, "k *m"], count: int
) -> Float[np.ndarray, "n *m"]:
    rest = values.shape[1:]
    flat = values.reshape(len(values), math.prod(rest))
    sums = [np.bincount(node, column, count) for column in flat.T]
    # Counts of nothing are whole numbers.
    return np.stack(sums, axis=1).reshape(count, *rest).astype(float)
