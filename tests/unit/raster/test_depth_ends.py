"""First and last depth without sorting, against the layers of the peeling."""

import jax
import numpy as np
import pytest
from peeling import BODIES, in_view, peel_checked

from jaxthermo.raster.depth_buffer import depth_range, nearest_depth


SIDE = 24


@pytest.mark.parametrize("body", sorted(BODIES))
def test_ends_of_the_layers(body):
    random = np.random.default_rng(3)
    triangles = in_view(BODIES[body](random), random)
    layers = peel_checked(triangles, SIDE, SIDE)
    nearest, farthest = depth_range(triangles, SIDE, SIDE)
    first = layers.image(0, layers.depth, np.inf)
    np.testing.assert_array_equal(nearest, first)
    np.testing.assert_array_equal(nearest_depth(triangles, SIDE, SIDE), first)
    last = np.full(SIDE * SIDE, -np.inf)
    last[layers.pixel] = layers.depth  # in order of depth: the last one stays
    np.testing.assert_allclose(farthest.reshape(-1), last, rtol=1e-12)
    assert np.isfinite(nearest).any() and np.isinf(nearest).any()


def test_while_something_else_is_traced():
    triangles = np.array([[[0.0, 0, 5], [9, 0, 5], [0, 9, 5]]])

    @jax.jit
    def traced(x):
        return x + depth_range(triangles, 4, 4)[0].min()

    assert float(traced(1.0)) == 6.0
