"""Points of surfaces that a camera sees."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...geometry.mesh import joined, winding_number
from ...geometry.vectors import row_dot, triangle_normals, unit_vectors
from ...memo.found import found
from ...raster.depth_buffer import nearest_hits
from ...raster.fragments import within_raster
from ...scene.scene import SolvedSurface
from .abstract_camera import AbstractCamera


class VisiblePoints(NamedTuple):
    """The nearest point of a surface on the ray of each pixel that shows a body."""

    pixel: Int[np.ndarray, " p"]
    """Index of each pixel, rows first."""
    body: Int[np.ndarray, " p"]
    """Number of the body."""
    face: Int[np.ndarray, " p"]
    """Number of the triangle in its body, see `BodyGeometry.surface_faces`."""
    position: Float[np.ndarray, "p 3"]
    """World [m]."""
    depth: Float[np.ndarray, " p"]
    """Depth along the optical axis [m]."""


class WorldMesh(NamedTuple):
    """Mesh of a body in the world."""

    vertices: Float[np.ndarray, "_ 3"]
    """In the world [m]."""
    faces: Int[np.ndarray, "_ 3"]
    is_two_sided: bool = False
    """True for a thin wall, which is seen from both sides."""


def world_meshes(surfaces: tuple[SolvedSurface, ...]) -> tuple[WorldMesh, ...]:
    """Meshes of bodies at their poses."""
    geometries = tuple(surface.geometry for surface in surfaces)
    # Bodies that do not move are the same objects in all views.
    vertices = found(
        geometries,
        by="vertices in the world",
        find=lambda: [g.placed.to_world(g.vertices) for g in geometries],
    )
    return tuple(
        WorldMesh(positions, geometry.faces, geometry.is_two_sided)
        for positions, geometry in zip(vertices, geometries, strict=True)
    )


def visible_points(
    bodies: tuple[WorldMesh, ...], camera: AbstractCamera
) -> VisiblePoints:
    """Find what the camera sees of bodies.

    Raises:
        InputError: if the camera is inside a solid body or sees none.
    """
    for index, body in enumerate(bodies):
        # A wall around the camera is a room, which it sees from within.
        if not body.is_two_sided and _is_inside(camera.position, body):
            raise InputError(
                f"camera: position {camera.position} is inside body {index}; "
                "move it out, or omit the camera for an automatic view"
            )
    vertices, mesh_faces = joined([(body.vertices, body.faces) for body in bodies])
    points, faces, parent = camera.mesh_to_raster(vertices, mesh_faces)
    if not within_raster(points):
        # Triangles outside of the image may be at any distance from it.
        overlapping = np.flatnonzero(_overlaps(points[faces], camera))
        points = points[faces[overlapping]].reshape(-1, 3)
        parent = parent[overlapping]
        faces = np.arange(len(points)).reshape(-1, 3)
    pixel, key, triangle = nearest_hits(points, faces, *camera.size)
    if not len(pixel):
        raise InputError(
            f"camera: at {camera.position} it sees no body; "
            "turn it, or omit the camera for an automatic view"
        )
    hit = parent[triangle]
    count = np.array([len(body.faces) for body in bodies])
    first = np.append(0, np.cumsum(count))
    number = np.searchsorted(first, hit, side="right") - 1
    face = hit - first[number]
    two_sided = np.array([body.is_two_sided for body in bodies])[number]
    corners = vertices[mesh_faces[hit]] if two_sided.any() or camera.bends else None
    if two_sided.any():
        assert corners is not None
        _, step = camera.rays(pixel)
        leaves = row_dot(triangle_normals(corners), step) > 0
        face = np.where(two_sided & leaves, face + count[number], face)
    position, depth = camera.points(pixel, key)
    visible = VisiblePoints(
        pixel=pixel, body=number, face=face, position=position, depth=depth
    )
    if not camera.bends:
        return visible
    assert corners is not None
    normal = unit_vectors(triangle_normals(corners))
    return on_planes(camera, visible=visible, corner=corners[:, 0], normal=normal)


def on_planes(
    camera: AbstractCamera,
    visible: VisiblePoints,
    corner: Float[np.ndarray, "p 3"],
    normal: Float[np.ndarray, "p 3"],
) -> VisiblePoints:
    """Points where the rays meet the planes of triangles, by a corner and a normal.

    The raster snaps corners to 1/1024 pixel, and edges that a lens bends are straight
    there: what it finds moves in steps.
    """
    origin, step = camera.rays(visible.pixel)
    ahead = row_dot(normal, step)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = row_dot(normal, corner - origin) / ahead
        # Seen edge-on a plane has its points anywhere.
        sane = np.abs(depth - visible.depth) < 0.1 * np.abs(visible.depth)
    depth = np.where(sane, depth, visible.depth)
    position = origin + depth[:, None] * step
    return visible._replace(position=position, depth=depth)


def _is_inside(position: Sequence[float | int], body: WorldMesh) -> bool:
    # Outside of the box around a body no search is needed; one axis often decides.
    for coordinate, column in zip(position, body.vertices.T, strict=True):
        if not column.min() <= coordinate <= column.max():
            return False
    point = np.asarray(position, float)
    return abs(winding_number(body.vertices[body.faces], point)) > 0.5


def _overlaps(corners: np.ndarray, camera: AbstractCamera) -> Bool[np.ndarray, " k"]:
    """Triangles whose bounding box overlaps the image."""
    inside = np.ones(len(corners), bool)
    for axis, size in enumerate(camera.size):
        low = corners[..., axis].min(axis=1)
        high = corners[..., axis].max(axis=1)
        inside &= (high > 0) & (low < size)
    return inside
