"""Perspective views hold their points, and see what a ray would meet."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.raster.views import perspective_views


seeds = st.integers(0, 2**32 - 1)


@settings(deadline=None, max_examples=30)
@given(seed=seeds, spread=st.sampled_from([0.1, 1.0, 10.0]))
def test_every_point_is_in_one_view_with_a_pixel_to_spare(seed, spread):
    random = np.random.default_rng(seed)
    eye = random.normal(size=3)
    points = eye + np.array([0.0, 0.0, 2.0]) + spread * random.normal(size=(200, 3))
    views = perspective_views(eye, points, 0.1)
    numbers = np.sort(np.concatenate([in_view for _, in_view in views]))
    np.testing.assert_array_equal(numbers, np.arange(200))
    for view, in_view in views:
        at = view.project(points[in_view])
        assert (at[:, :2] > 1).all()
        assert (at[:, :2] < np.array([view.width, view.height]) - 1).all()
        assert (view.pixel * at[:, 2] <= 0.1 * (1 + 1e-9)).all()


@pytest.mark.parametrize("eye", [(0.0, 0.0, 3.0), (0.9, 0.2, 0.3), (5.0, -4.0, 2.0)])
def test_depths_are_those_of_the_nearest_wall(eye):
    """From outside a ball, and from within a room around it: the ball comes first."""
    ball = sphere(0.5, 3).triangles
    room = box((12.0, 12.0, 12.0)).triangles
    eye_point = np.array(eye)
    random = np.random.default_rng(1)
    way = random.normal(size=(300, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    views = perspective_views(eye_point, eye_point + way, 0.01)
    assert len(views) == 6
    for view, in_view in views:
        at = view.project(eye_point + way[in_view])
        column = at[:, 0].astype(int)
        row = at[:, 1].astype(int)
        # Along the ray of the pixel's middle.
        middle = np.stack([column + 0.5, row + 0.5], axis=1) * view.pixel + view.corner
        ray = np.column_stack([middle, np.ones(len(middle))]) @ view.frame
        toward = np.where(ray == 0, 1e-300, ray)
        wall = np.max(
            [(6 - eye_point) / toward, (-6 - eye_point) / toward], axis=0
        ).min(axis=1)
        half = ray @ eye_point
        square = np.einsum("ij,ij->i", ray, ray)
        inside = half**2 - square * (eye_point @ eye_point - 0.25)
        meets = (inside > 0) & (half < 0)
        sphere_depth = (-half - np.sqrt(np.maximum(inside, 0))) / square
        expected = np.where(meets, sphere_depth, wall)
        depth = view.nearest(np.concatenate([ball, room]), row, column)
        # The ball is made of facets: near its rim a ray may pass it, or not.
        rim = np.abs(inside) < 0.02 * square
        np.testing.assert_allclose(depth[~rim], expected[~rim], atol=0.02)


def test_nothing_in_sight_is_infinitely_far():
    eye = np.zeros(3)
    points = np.array([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]])
    ((view, _),) = perspective_views(eye, points, 0.05)
    behind = box(1.0).triangles - np.array([0.0, 0.0, 5.0])
    row, column = np.indices((view.height, view.width)).reshape(2, -1)
    assert np.isinf(view.nearest(behind, row, column)).all()
