"""Triangles beside an image are left out, and no other ones."""

import numpy as np

from jaxthermo.raster.bounding_spheres import BoundingSpheres
from jaxthermo.raster.views import orthographic_view


def test_what_is_left_out_covers_no_pixel():
    rng = np.random.default_rng(3)
    centres = rng.uniform(-1, 1, (400, 1, 3))
    triangles = centres + rng.normal(0, 0.05, (400, 3, 3))
    view = orthographic_view(triangles, (0.3, -0.4, 1.0), pitch=0.01)
    low = np.array([60, 80])
    high = np.array([110, 140])
    is_over = BoundingSpheres.of(triangles).are_over(view, low=low, high=high)
    assert 5 < is_over.sum() < 60
    projected = view.project(triangles)[:, :, :2]
    is_beside = (projected < low).all(axis=1) | (projected > high).all(axis=1)
    assert not is_over[is_beside.any(axis=-1)].all()
    np.testing.assert_array_equal(is_over | is_beside.any(axis=-1), True)
