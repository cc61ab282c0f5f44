"""Shaded pictures of coloured meshes, and of the boxes around them."""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

import jaxthermo as jt
from jaxthermo.geometry.vectors import unit_vector, unit_vectors
from jaxthermo.image.colour.canvas import averaged
from jaxthermo.image.surface.abstract_camera import AbstractCamera
from jaxthermo.image.surface.camera import OrthographicCamera
from jaxthermo.image.surface.visible import VisiblePoints, WorldMesh, visible_points
from jaxthermo.physics.contact.rays import PlacedGrid


Colour = tuple[int, int, int]
Pixels = UInt8[np.ndarray, "h w 3"]
PAPER = (246, 247, 249)
BODIES: tuple[Colour, Colour] = ((206, 200, 188), (150, 184, 208))
"""Colours of two bodies side by side."""
BOX = (90, 96, 108)
# Samples of a pixel along each axis.
_SAMPLES = 2
# Brightness of a surface seen along its edge; 1 where it is seen straight on.
_DARKEST = 0.35
_MARGIN = 1.08


def camera_on(
    points: Float[np.ndarray, "n 3"],
    direction: tuple[float, float, float],
    size: int,
) -> OrthographicCamera:
    """A square picture of points [m] seen along a direction, with z upwards."""
    ahead = unit_vector(direction)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    right = unit_vector(np.cross(ahead, (0.0, 0.0, 1.0)))
    across = np.stack([right, np.cross(right, ahead)])
    reach = float(np.abs((points - middle) @ across.T).max())
    return OrthographicCamera(
        position=tuple((middle - 2 * radius * ahead).tolist()),
        look_at=tuple(middle.tolist()),
        view_height=2 * _MARGIN * reach,
        width=size,
        height=size,
    )


def lit(
    meshes: Sequence[jt.Mesh],
    camera: OrthographicCamera,
    colours: Callable[[VisiblePoints], UInt8[np.ndarray, "p 3"]],
) -> Pixels:
    """Meshes with a light at the camera, on paper.

    Args:
        meshes: in the world.
        camera: that sees them.
        colours: of the points that it sees.
    """
    fine = camera.finer(_SAMPLES)
    seen = seen_points(meshes, fine)
    facing = np.abs(seen.normal @ fine.frame[2])
    light = _DARKEST + (1 - _DARKEST) * facing
    shade = np.rint(light[:, None] * colours(seen.points)).astype(np.uint8)
    return averaged(fine.frame_of(seen.points.pixel, shade, PAPER), _SAMPLES)


class _Seen(NamedTuple):
    """Points of meshes that a camera sees."""

    points: VisiblePoints
    normal: Float[np.ndarray, "p 3"]
    """Normal of the triangle of each."""


def seen_points(meshes: Sequence[jt.Mesh], camera: AbstractCamera) -> _Seen:
    """The points of meshes in the world that a camera sees."""
    world = tuple(WorldMesh(mesh.vertices, mesh.faces) for mesh in meshes)
    points = visible_points(world, camera)
    first_face = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
    vectors = np.concatenate([mesh.area_vectors for mesh in meshes])
    return _Seen(points, unit_vectors(vectors[first_face[points.body] + points.face]))


def shaded(
    coloured: Sequence[tuple[jt.Mesh, Colour]], camera: OrthographicCamera
) -> Pixels:
    """Meshes in a colour each, with a light at the camera, on paper."""
    meshes = [mesh for mesh, _ in coloured]
    colours = np.array([colour for _, colour in coloured], np.uint8)
    return lit(meshes, camera, lambda seen: colours[seen.body])


def blended(over: Pixels, under: Pixels, opacity: float) -> Pixels:
    """A picture seen through another one of this opacity [-]."""
    mixed = opacity * over.astype(float) + (1 - opacity) * under
    return np.rint(mixed).astype(np.uint8)


_CORNERS = np.indices((2, 2, 2)).reshape(3, -1).T


def box_corners(box: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "8 3"]:
    """The eight corners of a box from its lowest to its highest one [m]."""
    return np.where(_CORNERS, box[1], box[0])


def in_world(body: PlacedGrid) -> jt.Mesh:
    """Mesh of a placed body in the world."""
    mesh = body.grid.mesh
    return jt.Mesh(body.pose.to_world(mesh.vertices), mesh.faces, body.name)


def on_picture(
    points: Float[np.ndarray, "n 3"], camera: OrthographicCamera
) -> Float[np.ndarray, "n 2"]:
    """Points of the world [m] on the picture of a camera [px]."""
    no_faces = np.zeros((0, 3), int)
    return camera.mesh_to_raster(points, no_faces).points[:, :2]


def with_box(
    pixels: Pixels, camera: OrthographicCamera, box: Float[np.ndarray, "2 3"]
) -> Pixels:
    """A picture with the twelve edges of a box in the world [m]."""
    corners = on_picture(box_corners(box), camera)
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    for a, b in combinations(range(8), 2):
        if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1:
            draw.line(corners[[a, b]].ravel().tolist(), fill=BOX, width=1)
    return np.asarray(image)
