"""Triangles beside an image are left out, and no other ones."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.raster.bounding_spheres import BoundingSpheres
from jaxthermo.raster.depth_buffer import nearest_depth
from jaxthermo.raster.views import (
    clip_half_space,
    orthographic_view,
    perspective_views,
)


def _scattered(count: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    centres = rng.uniform(-1, 1, (count, 1, 3))
    return centres + rng.normal(0, 0.05, (count, 3, 3))


def test_what_is_left_out_covers_no_pixel():
    triangles = _scattered(400)
    view = orthographic_view(triangles, (0.3, -0.4, 1.0), pitch=0.01)
    low = np.array([60, 80])
    high = np.array([110, 140])
    over = BoundingSpheres.of(triangles).reaching_into(view.half_spaces(low, high))
    assert 5 < len(over) < 60
    assert (np.diff(over) > 0).all()
    projected = view.project(triangles)[:, :, :2]
    is_left = (projected < low).all(axis=1) | (projected > high).all(axis=1)
    beside = np.flatnonzero(is_left.any(axis=-1))
    left_out = np.setdiff1d(np.arange(len(triangles)), over)
    assert len(np.intersect1d(beside, over)) < len(over)
    assert np.isin(left_out, beside).all()


def test_a_run_of_triangles_has_the_sphere_of_all_of_them():
    """Spheres of runs leave out nothing that those of the triangles keep."""
    triangles = np.concatenate([_scattered(150), sphere(0.3, 3).triangles])
    view = orthographic_view(triangles, (1.0, 0.2, 0.4), pitch=0.02)
    spheres = BoundingSpheres.of(triangles)
    for low in np.random.default_rng(5).integers(0, 80, (20, 2)):
        spaces = view.half_spaces(low, low + 15)
        kept = np.flatnonzero(spheres.triangles.reach_into(spaces))
        np.testing.assert_array_equal(spheres.reaching_into(spaces), kept)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 3.0), (0.9, 0.2, 0.3)])
def test_a_perspective_view_is_that_of_all_triangles(eye):
    """Bit for bit: what is left out was clipped away."""
    triangles = np.concatenate(
        [_scattered(300), sphere(0.5, 3).triangles, box((8.0, 8.0, 8.0)).triangles]
    )
    points = sphere(0.6, 2).vertices
    for view, _ in perspective_views(np.array(eye), points, size=0.02):
        clipped = triangles
        for normal, offset in zip(*view.half_spaces, strict=True):
            clipped = clip_half_space(clipped, normal=normal, offset=offset).pieces
        corners = view.project(clipped)
        corners[..., 2] = -1 / corners[..., 2]
        row, column = np.indices((view.height, view.width)).reshape(2, -1)
        key = nearest_depth(corners, row, column, view.width, view.height)
        assert np.isfinite(key).any()
        np.testing.assert_array_equal(
            view.nearest(triangles, row, column),
            np.where(np.isfinite(key), -1 / key, np.inf),
        )


def test_no_triangles_have_no_spheres():
    view = orthographic_view(_scattered(5), (0.0, 0.0, 1.0), pitch=0.1)
    spheres = BoundingSpheres.of(np.zeros((0, 3, 3)))
    over = spheres.reaching_into(view.half_spaces(np.array([0, 0]), np.array([4, 4])))
    assert over.shape == (0,)


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 10**6), distance=st.floats(0.0, 6.0))
def test_lines_that_pass_near_triangles_are_flagged(seed, distance):
    """By the closest approach of the lines through all points to all corners."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(5, 3))
    triangles = random.normal(size=(4, 3, 3)) + [distance, 0.0, 0.0]
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    way = triangles.reshape(-1, 3) - points[:, None]
    aside = np.cross(directions[:, None, None], way)
    nearest = np.linalg.norm(aside, axis=-1).min(axis=(1, 2))
    flags = BoundingSpheres.of(triangles).meet(points, directions, 0.1)
    assert flags[nearest <= 0.1].all()


@pytest.mark.parametrize("margin", [1.9, 2.1])
def test_lines_beside_triangles_are_not_flagged(margin):
    points = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    spheres = BoundingSpheres.of(points[None, [0, 1, 1]] + [0.0, 3.0, 0.0])
    is_near = margin > 2
    flags = spheres.meet(points, np.eye(3), margin)
    assert flags.tolist() == [is_near, True, is_near]


def test_nothing_is_met_where_nothing_is():
    points = np.zeros((1, 3))
    none = np.zeros((0, 3, 3))
    degenerate = np.zeros((1, 3, 3))
    for triangles, origins in ((none, points), (degenerate, points[:0])):
        flags = BoundingSpheres.of(triangles).meet(origins, np.eye(3), 1.0)
        assert flags.tolist() == [False] * 3
