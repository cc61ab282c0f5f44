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
    peel_padded,
    ray_balance,
    union,
)

from jaxthermo.raster import fragments as raster
from jaxthermo.raster.fragments import _sort_fragments, peel, peel_views


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
    layers = peel_padded(random_triangles(np.random.default_rng(seed)), SIZE, SIZE)
    same = layers.pixel[1:] == layers.pixel[:-1]
    assert (np.diff(layers.pixel) >= 0).all()
    # The key tells depths apart to 2^-52 of their range here.
    assert (np.diff(layers.depth)[same] >= -1e-10).all()
    assert (np.diff(layers.layer)[same] == 1).all()
    assert (layers.layer[1:][~same] == 0).all()
    assert layers.count == (layers.layer.max() + 1 if len(layers.layer) else 0)


@few
@given(seed=seeds, kind=st.sampled_from(sorted(BODIES)))
def test_closed_bodies_are_left_as_often_as_entered(seed, kind):
    rng = np.random.default_rng(seed)
    layers = peel_padded(in_view(BODIES[kind](rng), rng), SIZE, SIZE)
    assert not ray_balance(layers).any()
    assert len(layers.pixel) > 0


@pytest.mark.parametrize("body", [ball, cuboid, union])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_corners_and_edges_on_pixel_centres(body, axis):
    """The worst place for shared edges: everything snapped to a coarse lattice."""
    rng = np.random.default_rng(axis)
    triangles = np.roll(in_view(body(rng), rng), axis, axis=-1)
    for step in (0.5, 1.0, 2.0):
        layers = peel_padded(np.round(triangles / step) * step, SIZE, SIZE)
        assert not ray_balance(layers).any()


@few
@given(seed=seeds)
def test_convex_bodies_have_one_way_in_and_one_out(seed):
    rng = np.random.default_rng(seed)
    layers = peel_padded(in_view(cuboid(rng), rng), SIZE, SIZE)
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
    still = peel_padded(triangles, 36, 36)
    moved = peel_padded(triangles + np.array([right, down, back]), 36, 36)
    shift = down * 36 + right
    order = np.lexsort([still.triangle, still.pixel])
    other = np.lexsort([moved.triangle, moved.pixel])
    assert (still.pixel[order] + shift == moved.pixel[other]).all()
    assert (still.triangle[order] == moved.triangle[other]).all()
    assert still.depth[order] + back == pytest.approx(moved.depth[other], abs=1e-9)
    assert still.layer[order] == pytest.approx(moved.layer[other])


def test_depths_closer_than_float32_are_told_apart():
    plate = np.array([[[0, 0, 0], [8, 0, 0], [0, 8, 0]]], float)
    offsets = 1000.0 + np.arange(20)[::-1] * 1e-9
    layers = peel_padded(plate + offsets[:, None, None] * [0, 0, 1], 8, 8)
    assert layers.count == 20
    assert (layers.triangle == 19 - layers.layer).all()


def test_equal_depths_are_ranked_by_triangle():
    plate = np.array([[[0, 0, 3], [8, 0, 3], [0, 8, 3]]], float)
    layers = peel_padded(np.repeat(plate, 5, axis=0), 8, 8)
    assert layers.count == 5
    assert (layers.triangle == layers.layer).all()


@pytest.mark.parametrize("on_host", [True, False])
def test_views_along_axes_are_those_of_their_triangles(monkeypatch, on_host):
    mesh = SPHERE.moved((1.2, 1.4, 1.1))
    points, sizes = 8.0 * mesh.vertices, ((22, 19), (24, 20), (18, 23))
    views = [((a, (a + 1) % 3, (a + 2) % 3), *size) for a, size in enumerate(sizes)]
    monkeypatch.setattr(raster, "_on_host", lambda: on_host)
    found = peel_views(points, mesh.faces, views)
    for own, (axes, *size) in zip(found, views, strict=True):
        expected = peel_padded(points[:, axes][mesh.faces], *size)
        np.testing.assert_array_equal(own.pixel, expected.pixel)
        np.testing.assert_array_equal(own.layer, expected.layer)
        assert own.depth == pytest.approx(expected.depth, abs=1e-12)


def test_no_triangles():
    layers = peel(np.zeros((0, 3, 3)), 5, 4)
    assert layers.count == 0
    assert len(layers.pixel) == len(layers.entering) == 0
    assert (layers.image(0, layers.depth, background=7.0) == 7.0).all()


def test_no_fragments():
    layers = peel_padded(np.full((1, 3, 3), 3.0), 5, 4)
    assert layers.count == 0


def test_image_of_a_layer():
    near = np.array([[0, 0, 1], [4, 0, 1], [0, 4, 1]], float)
    far = np.array([[0, 0, 2], [4, 0, 2], [4, 4, 2], [0, 0, 2], [4, 4, 2], [0, 4, 2]])
    layers = peel_padded(np.concatenate([near[None], far.reshape(2, 3, 3)]), 4, 3)
    first = layers.image(0, layers.depth)
    second = layers.image(1, layers.depth, background=-1.0)
    assert first.shape == (3, 4)
    # The image is one row short of the triangles; rows count downwards.
    assert first.tolist() == [[1, 1, 1, 2], [1, 1, 2, 2], [1, 2, 2, 2]]
    assert second.tolist() == [[2, 2, 2, -1], [2, 2, -1, -1], [2, -1, -1, -1]]
    colours = np.repeat(layers.depth[:, None], 3, axis=1)
    assert layers.image(0, colours).shape == (3, 4, 3)


def test_one_program_for_one_size():
    peel_padded(
        in_view(ball(np.random.default_rng(0)), np.random.default_rng(0)), 24, 24
    )
    programs = getattr(_sort_fragments, "_cache_size")  # noqa: B009
    before = programs()
    for width, height in ((3, 5), (24, 60), (1, 1)):
        peel_padded(np.ones((2, 3, 3)), width, height)
    assert programs() == before
