"""Bodies and one padded size, such that all tests here share a compiled program."""

import numpy as np

from jaxthermo.geometry import shapes
from jaxthermo.raster.fragments import peel


FACES = 1600
SIZES = (16384, 16384)
SPHERE = shapes.sphere(1.0, subdivisions=2)


def peel_padded(triangles, width, height):
    """Depth layers; triangles without area fill up to a fixed number of faces."""
    assert len(triangles) <= FACES
    filler = np.zeros((FACES - len(triangles), 3, 3))
    return peel(np.concatenate([triangles, filler]), width, height, SIZES)


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
