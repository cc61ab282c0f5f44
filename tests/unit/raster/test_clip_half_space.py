"""What is left of triangles beyond a plane: the right area, wound as before."""

import numpy as np
from hypothesis import given, settings, strategies as st

from jaxthermo.raster.views import clip_half_space


def area_vectors(triangles):
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a) / 2


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_both_sides_make_up_the_whole(seed):
    random = np.random.default_rng(seed)
    triangles = random.normal(size=(40, 3, 3))
    normal = random.normal(size=3)
    offset = random.normal() * 0.5
    ahead, _ = clip_half_space(triangles, normal, offset)
    behind, _ = clip_half_space(triangles, -normal, -offset)
    assert (ahead @ normal >= offset - 1e-12).all()
    assert (behind @ normal <= offset + 1e-12).all()
    expected = area_vectors(triangles)
    clipped = np.concatenate([area_vectors(ahead), area_vectors(behind)])
    # The vectors tell the winding, their lengths the area.
    np.testing.assert_allclose(clipped.sum(0), expected.sum(0), atol=1e-12)
    area = np.linalg.norm(clipped, axis=1).sum()
    expected_area = np.linalg.norm(expected, axis=1).sum()
    np.testing.assert_allclose(area, expected_area, rtol=1e-12)


def test_none_left_and_all_left():
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    up = np.array([0.0, 0.0, 1.0])
    assert len(clip_half_space(triangle, up, 0.1)[0]) == 0
    np.testing.assert_array_equal(clip_half_space(triangle, up, 0.0)[0], triangle)
