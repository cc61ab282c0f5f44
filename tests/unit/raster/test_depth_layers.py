"""Depth layers: in order, complete, and on closed bodies as many ways in as out."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from peeling import (
    BODIES,
    SPHERE,
    ball,
    cuboid,
    in_view,
    peel_checked,
    ray_balance,
    union,
)

from jaxthermo.raster.fragments import peel, peel_mesh


SIZE = 24
seeds = st.integers(0, 2**32 - 1)
few = settings(deadline=None, max_examples=12)


def random_triangles(rng, count=60, spread=30.0):
    """Anywhere in and around the image, of any shape."""
    middle = rng.uniform(-3.0, SIZE + 3.0, (count, 1, 3))
    return middle + rng.normal(size=(count, 3, 3)) * rng.uniform(0, spread)


@few
@given(seed=seeds)
def test_layers_are_ordered_and_without_gap(seed):
    layers = peel_checked(random_triangles(np.random.default_rng(seed)), SIZE, SIZE)
    same = layers.pixel[1:] == layers.pixel[:-1]
    assert (np.diff(layers.pixel) >= 0).all()
    # The key tells depths apart to 2^-52 of their range here.
    assert (np.diff(layers.depth)[same] >= -1e-10).all()
    assert (np.diff(layers.layer)[same] == 1).all()
    assert (layers.layer[1:][~same] == 0).all()
    assert layers.count == (layers.layer.max() + 1 if len(layers.layer) else 0)


@few
@given(seed=seeds, name=st.sampled_from(sorted(BODIES)))
def test_closed_bodies_are_left_as_often_as_entered(seed, name):
    rng = np.random.default_rng(seed)
    layers = peel_checked(in_view(BODIES[name](rng), rng), SIZE, SIZE)
    assert not ray_balance(layers).any()
    assert len(layers.pixel) > 0


@pytest.mark.parametrize("body", [ball, cuboid, union])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_corners_and_edges_on_pixel_centres(body, axis):
    """The worst place for shared edges: everything snapped to a coarse lattice."""
    rng = np.random.default_rng(axis)
    triangles = np.roll(in_view(body(rng), rng), axis, axis=-1)
    for step in (0.5, 1.0, 2.0):
        layers = peel_checked(np.round(triangles / step) * step, SIZE, SIZE)
        assert not ray_balance(layers).any()


@few
@given(seed=seeds)
def test_convex_bodies_have_one_way_in_and_one_out(seed):
    rng = np.random.default_rng(seed)
    layers = peel_checked(in_view(cuboid(rng), rng), SIZE, SIZE)
    assert (layers.layer < 2).all()
    # A view has columns to the right, rows down and depth forwards.
    assert (layers.entering == (layers.layer == 0)).all()


@few
@given(
    seed=seeds, right=st.integers(-9, 9), down=st.integers(-9, 9), back=st.floats(-9, 9)
)
def test_whole_pixels_of_shift_change_nothing(seed, right, down, back):
    rng = np.random.default_rng(seed)
    # Corners on the snapping grid, where adding whole pixels is exact.
    triangles = np.round(in_view(union(rng), rng, pixels=16.0) * 1024) / 1024 + 10
    still = peel_checked(triangles, 36, 36)
    moved = peel_checked(triangles + np.array([right, down, back]), 36, 36)
    shift = down * 36 + right
    still_order = np.lexsort([still.triangle, still.pixel])
    moved_order = np.lexsort([moved.triangle, moved.pixel])
    assert (still.pixel[still_order] + shift == moved.pixel[moved_order]).all()
    assert (still.triangle[still_order] == moved.triangle[moved_order]).all()
    assert still.depth[still_order] + back == pytest.approx(
        moved.depth[moved_order], abs=1e-9
    )
    assert still.layer[still_order] == pytest.approx(moved.layer[moved_order])


def test_depths_closer_than_float32_are_told_apart():
    plate = np.array([[[0, 0, 0], [8, 0, 0], [0, 8, 0]]], float)
    offsets = 1000.0 + np.arange(20)[::-1] * 1e-9
    layers = peel_checked(plate + offsets[:, None, None] * [0, 0, 1], 8, 8)
    assert layers.count == 20
    assert (layers.triangle == 19 - layers.layer).all()


def test_equal_depths_are_ranked_by_triangle():
    plate = np.array([[[0, 0, 3], [8, 0, 3], [0, 8, 3]]], float)
    layers = peel_checked(np.repeat(plate, 5, axis=0), 8, 8)
    assert layers.count == 5
    assert (layers.triangle == layers.layer).all()


@pytest.mark.parametrize(
    ("axis", "size"), [(0, (22, 19)), (1, (24, 20)), (2, (18, 23))]
)
def test_meshes_along_axes_are_peeled_as_their_triangles(axis, size):
    mesh = SPHERE.moved((1.2, 1.4, 1.1))
    points = 8.0 * mesh.vertices[:, [axis, (axis + 1) % 3, (axis + 2) % 3]]
    layers = peel_mesh(points, mesh.faces, *size)
    expected = peel_checked(points[mesh.faces], *size)
    np.testing.assert_array_equal(layers.pixel, expected.pixel)
    np.testing.assert_array_equal(layers.layer, expected.layer)
    assert layers.depth == pytest.approx(expected.depth, abs=1e-12)


def test_no_triangles():
    layers = peel(np.zeros((0, 3, 3)), 5, 4)
    assert layers.count == 0
    assert len(layers.pixel) == len(layers.entering) == 0
    assert (layers.image(0, layers.depth, background=7.0) == 7.0).all()


def test_no_fragments():
    layers = peel_checked(np.full((1, 3, 3), 3.0), 5, 4)
    assert layers.count == 0


def test_image_of_a_layer():
    near = np.array([[0, 0, 1], [4, 0, 1], [0, 4, 1]], float)
    far = np.array([[0, 0, 2], [4, 0, 2], [4, 4, 2], [0, 0, 2], [4, 4, 2], [0, 4, 2]])
    layers = peel_checked(np.concatenate([near[None], far.reshape(2, 3, 3)]), 4, 3)
    first = layers.image(0, layers.depth)
    second = layers.image(1, layers.depth, background=-1.0)
    assert first.shape == (3, 4)
    # The image is one row short of the triangles; rows count downwards.
    assert first.tolist() == [[1, 1, 1, 2], [1, 1, 2, 2], [1, 2, 2, 2]]
    assert second.tolist() == [[2, 2, 2, -1], [2, 2, -1, -1], [2, -1, -1, -1]]
    colours = np.repeat(layers.depth[:, None], 3, axis=1)
    assert layers.image(0, colours).shape == (3, 4, 3)
