"""The depth buffer shows the first of all depth layers, whichever numbers it uses."""

import numpy as np
import pytest
from peeling import BODIES, in_view, peel_checked

from jaxthermo.errors import InputError
from jaxthermo.raster import fragments as module
from jaxthermo.raster.depth_buffer import nearest_hits


SIDE = 24


@pytest.fixture(params=["float64", "int64"], autouse=True)
def number_type(request, monkeypatch):
    """Both kinds of numbers, of which large coordinates need the second."""
    if request.param == "int64":
        monkeypatch.setattr(module, "_MAX_EXACT", -1)


def hits(triangles, size=SIDE):
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    points = triangles.reshape(-1, 3)
    return nearest_hits(points, faces=corners, width=size, height=size)


def assert_front(nearest, layers):
    front = layers.layer == 0
    np.testing.assert_array_equal(nearest.pixel, layers.pixel[front])
    np.testing.assert_allclose(nearest.depth, layers.depth[front], rtol=1e-12)
    # Layers are sorted by a depth of fewer digits.
    differs = nearest.triangle != layers.triangle[front]
    assert differs.sum() <= 2
    return differs


@pytest.mark.parametrize("name", sorted(BODIES))
@pytest.mark.parametrize("pixels", [24.0, 60.0])
def test_the_first_layer_of_bodies_within_and_beyond_the_image(name, pixels):
    rng = np.random.default_rng(7)
    for _ in range(3):
        triangles = in_view(BODIES[name](rng), rng, pixels)
        triangles[..., :2] -= (pixels - SIDE) / 2
        nearest = hits(triangles)
        assert len(nearest.pixel) > 100
        assert_front(nearest, peel_checked(triangles, SIDE, SIDE))


def test_chunks_are_drawn_into_one_image(monkeypatch):
    rng = np.random.default_rng(2)
    triangles = in_view(BODIES["rough ball"](rng), rng)
    at_once = hits(triangles)
    monkeypatch.setattr(module, "_CHUNK", 7)
    for expected, chunked in zip(at_once, hits(triangles), strict=True):
        np.testing.assert_array_equal(expected, chunked)


def test_corners_and_edges_on_centres_belong_to_one_triangle():
    # Two squares of half a pixel's multiples, cut in two: every centre once.
    low, high = np.meshgrid(np.arange(0, 12, 0.5), np.arange(0, 12, 1.5))
    corner = np.stack([low, high], axis=-1).reshape(-1, 2)
    square = np.array([[0, 0], [0.5, 0], [0.5, 1.5], [0, 1.5]])
    four = corner[:, None] + square
    flat = np.concatenate([four[:, [0, 1, 2]], four[:, [0, 2, 3]]])
    triangles = np.concatenate([flat, np.ones((len(flat), 3, 1))], axis=2)
    nearest = hits(triangles, 12)
    np.testing.assert_array_equal(nearest.pixel, np.arange(144))
    assert not assert_front(nearest, peel_checked(triangles, 12, 12)).any()


def test_the_first_of_several_at_one_depth_is_seen():
    triangle = np.array([[1.0, 1.0, 5.0], [20.0, 2.0, 5.0], [3.0, 20.0, 5.0]])
    behind = triangle + [0.0, 0.0, 1.0]
    nearest = hits(np.stack([behind, triangle, triangle]))
    assert (nearest.triangle == 1).all() and (nearest.depth == 5.0).all()


def test_nothing_to_see():
    outside = np.array([[[30.0, 1.0, 5.0], [40.0, 2.0, 5.0], [33.0, 20.0, 5.0]]])
    between = np.array([[[3.6, 3.6, 5.0], [4.4, 3.6, 5.0], [4.0, 4.4, 5.0]]])
    level = np.array([[[1.0, 3.5, 5.0], [9.0, 3.5, 5.0], [5.0, 3.5, 5.0]]])
    for triangles in (outside, between, level, outside[:0]):
        assert all(len(column) == 0 for column in hits(triangles))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 2.0**21])
def test_corners_too_far_away_are_refused(wrong):
    triangle = np.array([[[1.0, 1.0, 5.0], [wrong, 2.0, 5.0], [3.0, 20.0, 5.0]]])
    with pytest.raises(InputError, match="million pixels"):
        hits(triangle)
