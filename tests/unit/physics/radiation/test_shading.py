"""Points that an occluder shades, from the triangles that may lie in front of them."""

import numpy as np

from jaxthermo.physics.radiation.window import Window
from jaxthermo.raster.depth_buffer import depth_range


SIDE = 32


def test_triangles_behind_all_points_are_left_out_without_an_effect():
    random = np.random.default_rng(5)
    centre = random.uniform(0.0, SIDE, (60, 1, 3))
    corners = centre + random.uniform(-6.0, 6.0, (60, 3, 3))
    row, column = random.integers(0, SIDE, (2, 500))
    depth = random.uniform(0.0, SIDE / 2, 500)
    window = Window(
        points=np.arange(500),
        row=row,
        column=column,
        corners=corners,
        width=SIDE,
        height=SIDE,
    )
    assert (corners[..., 2].min(axis=1) > depth.max()).any()
    nearest, _ = depth_range(corners, row, column, SIDE, SIDE)
    is_shaded = depth > nearest
    assert is_shaded.any() and not is_shaded.all()
    np.testing.assert_array_equal(window.shades(depth), is_shaded)
