"""First and last depth without sorting, against the layers of the peeling."""

import jax
import numpy as np
import pytest
from peeling import BODIES, in_view, peel_checked

from jaxthermo.raster.depth_buffer import depth_range, nearest_depth


SIDE = 24


def _all_pixels(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    row, column = np.indices((height, width)).reshape(2, -1)
    return row, column


@pytest.mark.parametrize("body", sorted(BODIES))
def test_ends_of_the_layers(body):
    random = np.random.default_rng(3)
    triangles = in_view(BODIES[body](random), random)
    layers = peel_checked(triangles, SIDE, SIDE)
    row, column = _all_pixels(SIDE, SIDE)
    nearest, farthest = depth_range(triangles, row, column, SIDE, SIDE)
    first = layers.image(0, layers.depth, np.inf).reshape(-1)
    np.testing.assert_array_equal(nearest, first)
    alone = nearest_depth(triangles, row, column, SIDE, SIDE)
    np.testing.assert_array_equal(alone, first)
    last = np.full(SIDE * SIDE, -np.inf)
    last[layers.pixel] = layers.depth  # in order of depth: the last one stays
    np.testing.assert_allclose(farthest, last, rtol=1e-12)
    assert np.isfinite(nearest).any() and np.isinf(nearest).any()


@pytest.mark.parametrize("count", [0, 1, 40])
def test_some_pixels_have_the_depths_that_they_have_among_all(count):
    """In any order, some of them several times."""
    random = np.random.default_rng(4)
    width = SIDE
    height = SIDE // 2
    triangles = in_view(BODIES["rough ball"](random), random)
    nearest, farthest = depth_range(
        triangles, *_all_pixels(width, height), width, height
    )
    row = random.integers(0, height, count)
    column = random.integers(0, width, count)
    some_nearest, some_farthest = depth_range(triangles, row, column, width, height)
    np.testing.assert_array_equal(some_nearest, nearest[row * width + column])
    np.testing.assert_array_equal(some_farthest, farthest[row * width + column])


def test_while_something_else_is_traced():
    triangles = np.array([[[0.0, 0, 5], [9, 0, 5], [0, 9, 5]]])
    pixels = _all_pixels(4, 4)

    @jax.jit
    def traced(x):
        return x + depth_range(triangles, *pixels, 4, 4)[0].min()

    assert float(traced(1.0)) == 6.0
