"""Cameras: pixels and points agree, clipping keeps what is in front."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.image.surface.camera import Camera, OrthographicCamera, frame_all
from jaxthermo.raster.views import clip_half_space


FORWARD = np.array([0.0, 0.0, 1.0])
PINHOLE = Camera((2.0, -1.0, 0.7), (0.0, 0.1, 0.2), width=64, height=48)
PARALLEL = OrthographicCamera(
    (2.0, -1.0, 0.7), (0.0, 0.1, 0.2), view_height=1.5, width=64, height=48
)


@pytest.mark.parametrize("camera", [PINHOLE, PARALLEL])
@settings(max_examples=40, deadline=None)
@given(column=st.integers(0, 63), row=st.integers(0, 47), depth=st.floats(0.5, 9.0))
def test_a_point_seen_at_a_pixel_projects_back_to_its_centre(
    camera, column, row, depth
):
    key = -1 / depth if isinstance(camera, Camera) else depth
    pixel = np.array([row * 64 + column])
    point, along = camera.points(pixel, np.array([key]))
    corners, parent = camera.to_raster(np.repeat(point[None], 3, axis=1))
    np.testing.assert_allclose(corners[0, 0], [column + 0.5, row + 0.5, key], atol=1e-9)
    np.testing.assert_allclose(along, depth)
    assert parent.tolist() == [0]


def test_image_axes_are_right_and_down():
    camera = Camera((0.0, -3.0, 0.0), (0.0, 0.0, 0.0), width=100, height=100)
    points = np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, 0.0]])
    corners, _ = camera.to_raster(points[None])
    right, up, middle = corners[0]
    assert right[0] > middle[0] and right[1] == pytest.approx(middle[1])
    assert up[1] < middle[1] and up[0] == pytest.approx(middle[0])


def test_field_of_view_spans_the_height():
    camera = Camera((0.0, -1.0, 0.0), (0.0, 0.0, 0.0), field_of_view=0.8, height=200)
    top = np.array([[[0.0, 0.0, np.tan(0.4)]] * 3])
    assert camera.to_raster(top)[0][0, 0, 1] == pytest.approx(0.0, abs=1e-9)


def test_finer_keeps_the_view():
    for camera in (PINHOLE, PARALLEL):
        fine = camera.finer(3)
        assert fine.size == (192, 144)
        point = np.array([[[0.1, 0.2, 0.3]] * 3])
        coarse = camera.to_raster(point)[0]
        precise = fine.to_raster(point)[0]
        np.testing.assert_allclose(precise[..., :2], 3 * coarse[..., :2])
        np.testing.assert_allclose(precise[..., 2], coarse[..., 2])


@settings(max_examples=60, deadline=None)
@given(
    heights=st.lists(st.floats(-2, 2), min_size=3, max_size=3).filter(
        lambda z: min(abs(v - 0.5) for v in z) > 1e-3
    )
)
def test_clipping_cuts_exactly_at_the_plane(heights):
    flat = np.array([[0.0, 0.0], [1.0, 0.2], [0.3, 1.1]])
    triangle = np.column_stack([flat, heights])[None]
    pieces, parent = clip_half_space(triangle, FORWARD, 0.5)
    assert (pieces[..., 2] >= 0.5 - 1e-12).all()
    assert (parent == 0).all()
    clipped_area = np.abs(
        np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    ).sum(0)
    # The share in front, from a fine sampling of the triangle.
    u, v = np.meshgrid(np.linspace(0, 1, 801), np.linspace(0, 1, 801))
    inside = u + v < 1
    z = heights[0] + u * (heights[1] - heights[0]) + v * (heights[2] - heights[0])
    share = (z[inside] >= 0.5).mean()
    area = np.abs(
        np.cross(triangle[0, 1] - triangle[0, 0], triangle[0, 2] - triangle[0, 0])
    )
    np.testing.assert_allclose(clipped_area, share * area, atol=0.02 * area.max())


def test_clipped_pieces_keep_the_winding():
    triangle = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, -1.0]]])
    for turn in range(3):
        pieces, _ = clip_half_space(np.roll(triangle, turn, axis=1), FORWARD, 0.0)
        normals = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
        normal = np.cross(
            triangle[0, 1] - triangle[0, 0], triangle[0, 2] - triangle[0, 0]
        )
        assert (normals @ normal > 0).all()


@pytest.mark.parametrize("size", [(640, 480), (300, 900)])
def test_frame_all_holds_everything_and_fills_the_image(size):
    mesh = box((0.2, 0.1, 0.5))
    camera = frame_all(mesh.triangles, *size)
    corners, _ = camera.to_raster(mesh.triangles)
    low = corners[..., :2].min((0, 1))
    high = corners[..., :2].max((0, 1))
    assert (low > 0).all() and (high < size).all()
    assert ((high - low) / size).max() > 0.85


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Camera((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "look_at"),
        (lambda: Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), "up"),
        (lambda: Camera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), field_of_view=4.0), "field"),
        (lambda: Camera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), width=0), "width"),
        (
            lambda: OrthographicCamera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0),
            "view_height",
        ),
    ],
)
def test_impossible_cameras_are_refused(make, word):
    with pytest.raises(InputError, match=word):
        make()


def test_sphere_is_as_large_as_it_should_be():
    ball = sphere(0.5, subdivisions=4)
    camera = OrthographicCamera(
        (3.0, 0.0, 0.0), (0.0, 0.0, 0.0), view_height=1.2, width=240, height=240
    )
    corners, _ = camera.to_raster(ball.triangles)
    radius = np.hypot(corners[..., 0] - 120, corners[..., 1] - 120).max()
    assert radius == pytest.approx(100, rel=0.01)


@pytest.mark.parametrize("camera", [PINHOLE, PARALLEL])
def test_a_mesh_on_the_image_is_its_triangles(camera):
    """Also where faces reach behind the camera, in front of it or across."""
    mesh = sphere(2.2, subdivisions=1)
    for at in ((0.0, 0.0, 0.0), (1.0, -0.5, 0.3), (9.0, -6.0, 2.0)):
        vertices = mesh.vertices + at
        points, faces, parent = camera.mesh_to_raster(vertices, mesh.faces)
        expected, whose = camera.to_raster(vertices[mesh.faces])
        assert np.isfinite(points).all()
        np.testing.assert_array_equal(np.sort(parent), np.sort(whose))
        for face in np.unique(whose):
            actual = points[faces[parent == face]]
            exact = expected[whose == face]
            np.testing.assert_allclose(
                np.sort(actual, 0), np.sort(exact, 0), rtol=1e-12
            )


@pytest.mark.parametrize("camera", [PINHOLE, PARALLEL])
def test_all_rays_towards_a_direction_are_among_its_pixels(camera):
    numbers = np.random.default_rng(4)
    angle = 0.05
    _, step = camera.rays()
    ray = step / np.linalg.norm(step, axis=1, keepdims=True)
    towards = numbers.normal(size=(200, 3))
    # Half of them are in or near the image.
    towards[::2] = camera.frame[2] + 0.3 * towards[::2]
    counts = []
    for direction in (*towards, camera.frame[2]):
        unit = direction / np.linalg.norm(direction)
        pixels = camera.pixels_towards(unit, angle)
        inside = np.flatnonzero(np.linalg.norm(ray - unit, axis=1) < angle)
        assert np.isin(inside, pixels).all()
        counts.append((len(inside), len(pixels)))
    inside, pixels = np.array(counts).T
    assert (inside > 0).any() and (pixels == 0).any()
    if isinstance(camera, Camera):
        assert pixels[inside > 40].max() < 3 * inside.max()


@pytest.mark.parametrize("camera", [PINHOLE, PARALLEL])
def test_rays_of_some_pixels_are_those_of_all(camera):
    pixels = np.array([5, 700, 64 * 48 - 1])
    for some, all_rays in zip(camera.rays(pixels), camera.rays(), strict=True):
        np.testing.assert_array_equal(some, all_rays[pixels])


@pytest.mark.parametrize("number_type", [np.float64, np.float32])
def test_vectors_of_numpy_are_plain_numbers(number_type):
    position = tuple(number_type(x) for x in (1.5, -2.0, 0.5))
    camera = Camera(position=position, look_at=(0.0, 0.0, number_type(0.25)))
    assert camera.position == (1.5, -2.0, 0.5)
    assert {type(x) for x in (*camera.position, *camera.look_at)} == {float}
    assert hash(camera.position) == hash(position)
