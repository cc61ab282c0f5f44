"""Occlusion from an image's depths, beside closed forms and the one from rays."""

from typing import NamedTuple

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.image.surface.camera import Camera, OrthographicCamera
from jaxthermo.image.surface.occlusion import screen_space_occlusion
from jaxthermo.physics.radiation.visibility import sky_view
from jaxthermo.raster.fragments import peel


FLOOR = box((8.0, 8.0, 0.2)).triangles - np.array([0.0, 0.0, 0.1])
BALL = sphere(1.0, 3).triangles + np.array([0.0, 0.0, 1.0])
ABOVE = Camera(
    (0.0, -0.1, 12.0), (0.0, 0.0, 0.0), field_of_view=0.6, width=160, height=120
)
ASLANT = Camera(
    (0.0, -6.0, 5.0), (0.0, 0.0, 0.5), field_of_view=0.7, width=160, height=120
)
PLAN = OrthographicCamera(
    (0.0, 0.0, 10.0), (0.0, 0.0, 0.0), 8.0, up=(0.0, 1.0, 0.0), width=128, height=128
)


class Seen(NamedTuple):
    """Depth and normal images, and the pixels that show a surface."""

    depth: np.ndarray
    normal: np.ndarray
    pixel: np.ndarray
    point: np.ndarray
    """Surface point of each pixel."""
    facing: np.ndarray
    """Normal at each pixel."""


def seen(camera, triangles) -> Seen:
    corners, parent = camera.to_raster(triangles)
    width, height = camera.size
    layers = peel(corners, width, height)
    front = layers.layer == 0
    pixel = layers.pixel[front]
    point, depth = camera.points(pixel, layers.depth[front])
    a, b, c = np.moveaxis(triangles[parent[layers.triangle[front]]], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    depths = np.full(width * height, np.inf)
    normals = np.zeros((width * height, 3))
    depths[pixel] = depth
    normals[pixel] = normal
    return Seen(
        depth=depths.reshape(height, width),
        normal=normals.reshape(height, width, 3),
        pixel=pixel,
        point=point,
        facing=normal,
    )


@pytest.mark.parametrize(
    "camera", [ABOVE, ASLANT, PLAN], ids=["above", "aslant", "plan"]
)
def test_a_plane_is_open_and_so_is_the_background(camera):
    depth, normal, *_ = seen(camera, FLOOR)
    fraction = screen_space_occlusion(depth, normal=normal, camera=camera, radius=3.0)
    assert fraction.shape == depth.shape
    np.testing.assert_allclose(fraction, 1.0, atol=2e-6)


@pytest.mark.parametrize(
    ("camera", "close"), [(ABOVE, 0.03), (PLAN, 0.03), (ASLANT, 0.06)]
)
def test_ball_on_a_plane_against_rays_and_closed_form(camera, close):
    triangles = np.concatenate([BALL, FLOOR])
    depth, normal, pixel, point, facing = seen(camera, triangles)
    fraction = screen_space_occlusion(
        depth, normal=normal, camera=camera, radius=4.0
    ).reshape(-1)[pixel]
    view = sky_view(triangles, point, facing, 0.1, 128)

    def rms(values):
        return float(np.sqrt(np.mean(values**2)))

    difference = fraction - view.sky - view.ground
    print("screen less rays: mean", difference.mean(), "rms", rms(difference))
    assert rms(difference) < close
    on_floor = (facing[:, 2] > 0.99) & (np.abs(point[:, 2]) < 1e-3)
    away = np.hypot(point[on_floor, 0], point[on_floor, 1])
    exact = 1 - (1 + away**2) ** -1.5
    assert rms(fraction[on_floor] - exact) < close
    # Farther away than the radius nothing counts.
    near = screen_space_occlusion(
        depth, normal=normal, camera=camera, radius=0.3
    ).reshape(-1)[pixel]
    assert near[on_floor][away > 1.5].min() == pytest.approx(1.0, abs=1e-5)
    assert near.mean() > fraction.mean()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1)])
def test_small_and_empty_images(shape):
    height, width = shape
    camera = Camera((0.0, -2.0, 0.0), (0.0, 0.0, 0.0), width=width, height=height)
    nothing = screen_space_occlusion(
        np.full(shape, np.inf), np.zeros((*shape, 3)), camera, 1.0
    )
    np.testing.assert_array_equal(nothing, 1.0)
    wall = np.zeros((*shape, 3)) + np.array([0.0, -1.0, 0.0])
    flat = screen_space_occlusion(np.full(shape, 2.0), wall, camera, 1.0)
    np.testing.assert_allclose(flat, 1.0, atol=1e-6)


def test_bad_input_is_told_in_a_line():
    depth = np.ones((4, 4))
    normal = np.zeros((4, 4, 3))
    with pytest.raises(InputError, match="4 x 4 pixels and the camera's"):
        screen_space_occlusion(depth, normal=normal, camera=ABOVE, radius=1.0)
    square = Camera((0.0, -2.0, 0.0), (0.0, 0.0, 0.0), width=4, height=4)
    with pytest.raises(InputError, match="radius=0.0"):
        screen_space_occlusion(depth, normal=normal, camera=square, radius=0.0)
