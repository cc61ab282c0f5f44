"""Bodies and one padded size, such that all tests here share a compiled program."""

from unittest import mock

import numpy as np

from jaxthermo.geometry import shapes
from jaxthermo.raster import fragments as raster
from jaxthermo.raster.fragments import peel


FACES = 1600
SIZES = (16384, 16384)
SPHERE = shapes.sphere(1.0, subdivisions=2)


def peel_padded(triangles, width, height):
    """Depth layers by the program; triangles without area fill up to a fixed number.

    Those of the host must be the same.
    """
    assert len(triangles) <= FACES
    filler = np.zeros((FACES - len(triangles), 3, 3))
    given = np.concatenate([triangles, filler]), width, height, SIZES
    with mock.patch.object(raster, "_on_host", lambda: False):
        layers = peel(*given)
    with mock.patch.object(raster, "_on_host", lambda: True):
        _assert_alike(peel(*given), layers)
    return layers


def _assert_alike(host, layers):
    for name in ("pixel", "depth", "triangle", "entering", "layer"):
        assert getattr(host, name).dtype == getattr(layers, name).dtype
    np.testing.assert_array_equal(host.pixel, layers.pixel)
    np.testing.assert_array_equal(host.layer, layers.layer)
    # XLA may round a product and a sum at once, which exchanges equal depths.
    np.testing.assert_allclose(host.depth, layers.depth, rtol=1e-13, atol=1e-13)
    order = lambda found: np.lexsort((found.triangle, found.pixel))
    ours, theirs = order(host), order(layers)
    np.testing.assert_array_equal(host.triangle[ours], layers.triangle[theirs])
    np.testing.assert_array_equal(host.entering[ours], layers.entering[theirs])


def ball(rng, roughness=0.0):
    """An icosphere, its corners moved in and out: closed, not convex."""
    radius = 1.0 + roughness * rng.uniform(-1.0, 1.0, (len(SPHERE.vertices), 1))
    return (SPHERE.vertices * radius)[SPHERE.faces]


def cuboid(rng):
    x, y, z = rng.uniform(0.5, 2.0, 3).tolist()
    return shapes.box((x, y, z)).triangles


def union(rng):
    """Overlapping closed parts, not joined."""
    parts = [ball(rng, 0.3), *(cuboid(rng) for _ in range(3))]
    return np.concatenate([p + rng.uniform(-1, 1, 3) for p in parts])


BODIES = {
    "ball": ball,
    "rough ball": lambda rng: ball(rng, 0.5),
    "box": cuboid,
    "union": union,
}


def rotation(rng):
    """A random rotation; handedness kept."""
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return matrix * np.linalg.det(matrix)


def in_view(triangles, rng, pixels=24.0, turn=None):
    """Turned at random and set into an image of `pixels` squared."""
    turned = triangles @ (rotation(rng) if turn is None else turn).T
    low, high = turned.min((0, 1)), turned.max((0, 1))
    scale = 0.9 * pixels / (high - low).max()
    return (turned - (low + high) / 2) * scale + pixels / 2


def ray_balance(layers):
    """Enterings less leavings of each ray."""
    step = np.where(layers.entering, 1, -1)
    return np.bincount(layers.pixel, step, minlength=layers.width * layers.height)
