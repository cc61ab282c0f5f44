"""Fragments: the pixels whose centres a triangle covers, whatever its shape."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from peeling import peel_checked, rotation

from jaxthermo.errors import InputError
from jaxthermo.raster.fragments import _MAX_COORDINATE, expected_fragments, peel


SIZE = 24
seeds = st.integers(0, 2**32 - 1)


def fan(rng, rim=12):
    """Triangles around a point that tile a polygon: every inner edge is shared."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, rim))
    radius = rng.uniform(3, 11, rim)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(rim)], 1) * radius[:, None]
    middle = np.zeros((rim, 3))
    return np.stack([middle, ring, np.roll(ring, -1, 0)], axis=1)


@settings(deadline=None, max_examples=12)
@given(seed=seeds)
def test_triangles_that_tile_the_image_own_each_pixel_once(seed):
    rng = np.random.default_rng(seed)
    # Cuts of the square at random points, some of them pixel centres.
    x = np.concatenate([[0], np.sort(rng.integers(1, 2 * SIZE, 5)) / 2, [SIZE]])
    y = np.concatenate([[0], np.sort(rng.uniform(0, SIZE, 5)), [SIZE]])
    quads = [
        np.array([[a, c, 0], [b, c, 0], [b, d, 0], [a, d, 0]])
        for a, b in zip(x[:-1], x[1:], strict=True)
        for c, d in zip(y[:-1], y[1:], strict=True)
    ]
    flip = rng.integers(0, 2, len(quads))
    turned = [np.roll(q, f, axis=0) for q, f in zip(quads, flip, strict=True)]
    triangles = np.concatenate([[q[[0, 1, 2]], q[[0, 2, 3]]] for q in turned])
    layers = peel_checked(triangles, SIZE, SIZE)
    assert sorted(layers.pixel) == list(range(SIZE * SIZE))


@settings(deadline=None, max_examples=12)
@given(seed=seeds)
def test_a_fan_is_covered_without_hole_or_double(seed):
    rng = np.random.default_rng(seed)
    triangles = fan(rng) + np.array([12.0, 12.0, 5.0]) + rng.uniform(-1, 1, 3)
    tiled = peel_checked(triangles, SIZE, SIZE)
    signed = np.bincount(tiled.pixel, np.where(tiled.entering, -1, 1), SIZE * SIZE)
    # The fan's own edge, drawn from a far point, encloses the same pixels.
    far = np.array([[[-400.0, -300.0, 5.0]]])
    rim = triangles[:, 1:]
    apart = np.concatenate([np.repeat(far, len(rim), axis=0), rim], axis=1)
    around = peel_checked(apart, SIZE, SIZE)
    expected = np.bincount(around.pixel, np.where(around.entering, -1, 1), SIZE * SIZE)
    assert (signed == expected).all()


@settings(deadline=None, max_examples=12)
@given(seed=seeds)
def test_depth_is_the_planes(seed):
    rng = np.random.default_rng(seed)
    frame = rotation(rng)
    if abs(frame[2, 2]) < 0.2:
        return
    corners = rng.uniform(-14, 14, (5, 3, 2))
    plane = -(corners @ frame[2, :2]) / frame[2, 2]
    triangles = np.concatenate([corners, plane[..., None]], axis=-1) + 12.0
    layers = peel_checked(triangles, SIZE, SIZE)
    row, column = np.divmod(layers.pixel, SIZE)
    at = np.stack([column + 0.5, row + 0.5], 1) - 12.0
    expected = 12.0 - at @ frame[2, :2] / frame[2, 2]
    # Snapping moves a corner by up to 1/2048 of a pixel, thin triangles tilt by it.
    close = np.abs(layers.depth - expected) < 0.05
    assert close.mean() > 0.98 if len(close) > 50 else True
    low = triangles[..., 2].min(1)
    high = triangles[..., 2].max(1)
    assert (layers.depth >= low[layers.triangle]).all()
    assert (layers.depth <= high[layers.triangle]).all()


def test_pixels_on_the_border_are_half_open():
    square = np.array([[0.5, 0.5], [3.5, 0.5], [3.5, 2.5], [0.5, 2.5]])
    corners = np.column_stack([square, np.zeros(4)])
    layers = peel_checked(corners[[[0, 1, 2], [0, 2, 3]]], 6, 6)
    row, column = np.divmod(layers.pixel, 6)
    assert set(zip(row.tolist(), column.tolist(), strict=True)) == {
        (r, c) for r in (0, 1) for c in (0, 1, 2)
    }


@pytest.mark.parametrize("turn", range(3))
@pytest.mark.parametrize("mirror", [False, True])
def test_winding_tells_entering(turn, mirror):
    corners = np.roll(np.array([[1, 1, 0], [1, 7, 0], [7, 1, 0]], float), turn, 0)
    layers = peel_checked((corners[::-1] if mirror else corners)[None], 8, 8)
    assert len(layers.entering) > 0
    assert (layers.entering == (not mirror)).all()


@pytest.mark.parametrize(
    "corners",
    [
        [[3, 3, 0], [3, 3, 1], [3, 3, 2]],
        [[0, 0, 0], [4, 4, 1], [8, 8, 2]],
        [[0, 2.5, 0], [4, 2.5, 1], [8, 2.5, 2]],
        [[2.5, 0, 0], [2.5, 4, 1], [2.5, 8, 2]],
        [[1, 1, 0], [1, 1, 5], [7, 6, 2]],
    ],
)
def test_triangles_seen_on_edge_give_nothing(corners):
    assert peel_checked(np.array([corners], float), 8, 8).count == 0


def test_everything_outside_the_image_is_clipped():
    big = np.array([[[-900, -900, 1], [900, -900, 1], [0, 900, 1]]], float)
    assert sorted(peel_checked(big, 7, 5).pixel) == list(range(35))
    for shift in ([40, 0, 0], [-40, 0, 0], [0, 40, 0], [0, -40, 0]):
        small = np.array([[[1, 1, 1], [6, 1, 1], [1, 6, 1]]], float) + shift
        assert peel_checked(small, 7, 5).count == 0


def test_half_a_square_has_the_pixels_below_its_diagonal():
    half = np.array([[[0, 0, 1], [40, 0, 1], [0, 40, 1]]], float)
    assert len(peel_checked(half, 40, 40).pixel) == 40 * 39 // 2


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_the_number_of_fragments_is_that_of_the_areas(scale):
    rng = np.random.default_rng(3)
    triangles = rng.uniform(0, 60, (500, 1, 3)) + rng.normal(size=(500, 3, 3)) * scale
    expected = expected_fragments(triangles, 60, 60)
    # Beyond the image only the bounding box is cut off, not the area.
    spread = 8 * np.sqrt(expected) + 256
    assert len(peel_checked(triangles, 60, 60).pixel) <= 1.05 * expected + spread


@pytest.mark.parametrize(
    "bad", [np.nan, np.inf, -np.inf, 1.5 * _MAX_COORDINATE, -1e300]
)
def test_coordinates_beyond_integers_are_refused(bad):
    triangles = np.ones((2, 3, 3))
    triangles[1, 2, 0] = bad
    with pytest.raises(InputError, match="pitch|clip"):
        peel(triangles, 8, 8)


def test_the_largest_coordinates_do_not_overflow():
    end = float(_MAX_COORDINATE)
    corners = np.array([[[-end, -end, 1], [end, -end, 1], [-end, end, 5]]])
    # Its long edge passes through the corner of the image, at 45 degrees.
    assert peel_checked(corners, 4, 4).count == 0
    far = corners.copy()
    far[0, 1, 1] = end
    layers = peel_checked(far, 4, 4)
    # Now it is the image's own diagonal, which is half open.
    assert sorted(layers.pixel) == [4, 8, 9, 12, 13, 14]
    assert layers.depth == pytest.approx(np.ones(6), abs=1e-4)
    assert not layers.entering.any()
