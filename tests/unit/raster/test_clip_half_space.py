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
    normal, least = random.normal(size=3), random.normal() * 0.5
    ahead, _ = clip_half_space(triangles, normal, least)
    behind, _ = clip_half_space(triangles, -normal, -least)
    assert (ahead @ normal >= least - 1e-12).all()
    assert (behind @ normal <= least + 1e-12).all()
    whole = area_vectors(triangles)
    parts = np.concatenate([area_vectors(ahead), area_vectors(behind)])
    # The vectors tell the winding, their lengths the area.
    np.testing.assert_allclose(parts.sum(0), whole.sum(0), atol=1e-12)
    size = lambda vectors: np.linalg.norm(vectors, axis=1).sum()
    np.testing.assert_allclose(size(parts), size(whole), rtol=1e-12)


def test_none_left_and_all_left():
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    up = np.array([0.0, 0.0, 1.0])
    assert len(clip_half_space(triangle, up, 0.1)[0]) == 0
    np.testing.assert_array_equal(clip_half_space(triangle, up, 0.0)[0], triangle)
