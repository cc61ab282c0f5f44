"""Faces of any number of corners to triangles, each in its own plane.

The normal of a polygon is the sum of the area vectors of a fan of triangles, for any
fan (Newell). A fan that turns the same way about it everywhere covers the polygon; if
none does, ears are cut off.
"""

from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Bool, Float, Int

from .file_mesh import FileFault, require_package, require_vertices


_earcut: Any = lazy_loader.load("mapbox_earcut")

_ROUNDING = 1e-6
"""Area that a triangle may have the wrong way about, over the squared extent of its
polygon [-]."""

_MAX_EXCESS = 1e-3
"""Difference of the area of the triangles from that of their polygon [-]."""


class Polygons(NamedTuple):
    """Faces of any number of corners."""

    corners: Int[np.ndarray, " n"]
    """Vertices of all polygons, one polygon after the other."""
    counts: Int[np.ndarray, " p"]
    """Number of corners of each polygon."""


class _Triangles(NamedTuple):
    """Triangles of polygons, in the order of the polygons."""

    faces: Int[np.ndarray, "t 3"]
    polygon: Int[np.ndarray, " t"]
    """Number of the polygon of each triangle."""


def triangulated(vertices: Float[np.ndarray, "v 3"], polygons: Polygons) -> _Triangles:
    """Split polygons into triangles of the same winding.

    Raises:
        FileFault: for a vertex that does not exist, or a polygon that has fewer than
            three corners or crosses itself.
    """
    corners, counts = polygons
    if (counts < 3).any():
        number = int(np.argmax(counts < 3)) + 1
        raise FileFault(f"face {number} has fewer than three corners")
    require_vertices(corners, len(vertices))
    first_corner = np.cumsum(counts) - counts
    faces = [np.zeros((0, 3), np.int64)]
    polygon = [np.zeros(0, np.int64)]
    for count in np.unique(counts):
        numbers = np.flatnonzero(counts == count)
        table = corners[first_corner[numbers, None] + np.arange(count)]
        triangles = _fans(vertices, table)
        is_covered = _is_covered(vertices, triangles)
        if count == 4 and not is_covered.all():
            # With its other diagonal.
            turned = np.roll(table, -1, axis=1)
            triangles[~is_covered] = _fans(vertices, turned[~is_covered])
            is_covered[~is_covered] = _is_covered(vertices, triangles[~is_covered])
        faces.append(triangles[is_covered].reshape(-1, 3))
        polygon.append(np.repeat(numbers[is_covered], count - 2))
        for row in np.flatnonzero(~is_covered):
            ears = table[row][_ears(vertices[table[row]], number=int(numbers[row]) + 1)]
            faces.append(ears)
            polygon.append(np.full(len(ears), numbers[row]))
    of_triangle = np.concatenate(polygon)
    order = np.argsort(of_triangle, kind="stable")
    return _Triangles(np.concatenate(faces)[order], of_triangle[order])


def _fans(
    vertices: Float[np.ndarray, "v 3"], table: Int[np.ndarray, "p c"]
) -> Int[np.ndarray, "p t 3"]:
    """Triangles between the first corner of each polygon and its other sides."""
    first = np.broadcast_to(table[:, :1], table[:, 2:].shape)
    return np.stack([first, table[:, 1:-1], table[:, 2:]], axis=2)


def _is_covered(
    vertices: Float[np.ndarray, "v 3"], fans: Int[np.ndarray, "p t 3"]
) -> Bool[np.ndarray, " p"]:
    """Flag the polygons that their fan covers once."""
    if fans.shape[1] == 1:
        return np.ones(len(fans), bool)
    apex = vertices[fans[:, :, 0]]
    one_side = vertices[fans[:, :, 1]] - apex
    other_side = vertices[fans[:, :, 2]] - apex
    area_vectors = np.cross(one_side, other_side)
    total = area_vectors.sum(axis=1)
    length = np.linalg.norm(total, axis=1)
    normal = total / np.where(length > 0.0, length, 1.0)[:, None]
    signed_area = np.einsum("ptk,pk->pt", area_vectors, normal)
    extent = np.abs(np.concatenate([one_side, other_side], axis=1)).max(axis=(1, 2))
    rounding = _ROUNDING * extent**2
    angle = np.arctan2(signed_area, (one_side * other_side).sum(axis=2)).sum(axis=1)
    # Without a normal, as where it crosses itself, all of its triangles have no sign.
    is_flat = np.linalg.norm(area_vectors, axis=2).sum(axis=1) <= rounding
    turns_one_way = (signed_area >= -rounding[:, None]).all(axis=1) & (length > 0.0)
    return is_flat | (turns_one_way & (angle < 2.0 * np.pi + _ROUNDING))


def _ears(polygon: Float[np.ndarray, "c 3"], number: int) -> Int[np.ndarray, "t 3"]:
    """Triangles of one polygon, as indices of its corners."""
    require_package("mapbox_earcut", f"concave faces, such as face {number},")
    sides = polygon - polygon[0]
    area_vector = np.cross(sides[1:-1], sides[2:]).sum(axis=0) / 2.0
    area = float(np.linalg.norm(area_vector))
    crossing = FileFault(
        f"face {number}, of {len(polygon)} corners, crosses itself",
        remedy="split it, or triangulate the mesh, in the program that made it",
    )
    if area <= _ROUNDING * float(np.abs(sides).max()) ** 2:
        raise crossing
    normal = area_vector / area
    # Any two directions across the normal, right-handed with it.
    one_axis = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    one_axis /= np.linalg.norm(one_axis)
    plane = np.stack([one_axis, np.cross(normal, one_axis)], axis=1)
    flat = np.ascontiguousarray(sides @ plane)
    ring_end = np.array([len(flat)], np.uint32)
    corners = _earcut.triangulate_float64(flat, ring_end).astype(np.int64)
    if not len(corners):
        raise crossing
    triangles = _along_sides(corners.reshape(-1, 3), len(polygon))
    a, b, c = np.moveaxis(flat[triangles], 1, 0)
    one_side = b - a
    other_side = c - a
    doubled = one_side[:, 0] * other_side[:, 1] - one_side[:, 1] * other_side[:, 0]
    triangles = np.where((doubled < 0.0)[:, None], triangles[:, ::-1], triangles)
    if abs(float(np.abs(doubled).sum()) / 2.0 - area) > _MAX_EXCESS * area:
        raise crossing
    return triangles


def _along_sides(
    triangles: Int[np.ndarray, "t 3"], count: int
) -> Int[np.ndarray, "s 3"]:
    """Triangles that meet every corner of a polygon of `count` corners.

    Cutting ears leaves out corners on a straight side, where the neighbour of the
    polygon has a vertex: the surface would be open there.
    """
    used = np.unique(triangles)
    faces = triangles.tolist()
    for start, end in zip(used, np.append(used[1:], used[0] + count), strict=True):
        between = np.arange(start, end + 1) % count
        if len(between) == 2:
            continue
        ends = {int(start), int(end) % count}
        for face in faces:
            if ends <= set(face):
                (apex,) = set(face) - ends
                faces.remove(face)
                faces += [
                    [int(tail), int(head), apex]
                    for tail, head in zip(between[:-1], between[1:], strict=True)
                ]
                break
    return np.array(faces, np.int64).reshape(-1, 3)
