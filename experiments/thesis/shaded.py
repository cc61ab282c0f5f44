"""Shaded pictures of coloured meshes, and of the boxes around them."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw

import jaxthermo as jt
from jaxthermo.geometry.vectors import unit_vector
from jaxthermo.image.colour.canvas import averaged
from jaxthermo.image.surface.camera import OrthographicCamera
from jaxthermo.image.surface.visible import visible_points
from jaxthermo.physics.contact.rays import PlacedGrid


Colour = tuple[int, int, int]
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


def shaded(
    coloured: Sequence[tuple[jt.Mesh, Colour]], camera: OrthographicCamera
) -> tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """Meshes in their colours with a light at the camera, and where there are any."""
    fine = camera.finer(_SAMPLES)
    meshes = [mesh for mesh, _ in coloured]
    seen = visible_points(tuple((m.vertices, m.faces) for m in meshes), fine)
    colours = np.empty((fine.width * fine.height, 3), np.uint8)
    colours[:] = PAPER
    for number, (mesh, colour) in enumerate(coloured):
        samples = np.flatnonzero(seen.body == number)
        vectors = mesh.area_vectors[seen.face[samples]]
        facing = np.abs(vectors @ fine.frame[2]) / np.linalg.norm(vectors, axis=1)
        light = _DARKEST + (1 - _DARKEST) * facing
        colours[seen.pixel[samples]] = np.rint(light[:, None] * np.array(colour))
    is_body = np.zeros(fine.height * fine.width, bool)
    is_body[seen.pixel] = True
    # A pixel is of the body if any of its samples is.
    blocks = is_body.reshape(camera.height, _SAMPLES, camera.width, _SAMPLES)
    samples_of_rows = colours.reshape(fine.height, fine.width, 3)
    picture = averaged(samples_of_rows, _SAMPLES)
    return picture, np.asarray(blocks.any(axis=(1, 3)))


def blended(
    over: UInt8[np.ndarray, "h w 3"],
    under: UInt8[np.ndarray, "h w 3"],
    opacity: float,
) -> UInt8[np.ndarray, "h w 3"]:
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


def with_box(
    pixels: UInt8[np.ndarray, "h w 3"],
    camera: OrthographicCamera,
    box: Float[np.ndarray, "2 3"],
) -> UInt8[np.ndarray, "h w 3"]:
    """A picture with the twelve edges of a box in the world [m]."""
    corners, _, _ = camera.mesh_to_raster(box_corners(box), np.zeros((0, 3), int))
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    for a, b in combinations(range(8), 2):
        if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1:
            ends = corners[[a, b], :2]
            draw.line(ends.ravel().tolist(), fill=BOX, width=1)
    return np.asarray(image)
