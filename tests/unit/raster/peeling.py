"""Bodies for the rasterizer's tests, and its slow twin, triangle by triangle."""

import numpy as np

from experiments.thesis.slicing import draw
from jaxthermo.geometry import shapes
from jaxthermo.raster.fragments import SNAP, DepthLayers, peel


SPHERE = shapes.sphere(1.0, subdivisions=2)


def peel_checked(triangles, width, height):
    """Depth layers, after a comparison with those of the slow twin."""
    layers = peel(triangles, width, height)
    expected = peel_one_by_one(triangles, width, height)
    np.testing.assert_array_equal(layers.pixel, expected.pixel)
    np.testing.assert_array_equal(layers.layer, expected.layer)
    # The twin solves for weights of the corners; rounding exchanges equal depths.
    tolerance = 1e-9 * max(np.abs(triangles[..., 2]).max(initial=0.0), 1.0)
    np.testing.assert_allclose(layers.depth, expected.depth, rtol=0, atol=tolerance)
    order = np.lexsort((layers.triangle, layers.pixel))
    expected_order = np.lexsort((expected.triangle, expected.pixel))
    for name in ("triangle", "entering"):
        np.testing.assert_array_equal(
            getattr(layers, name)[order], getattr(expected, name)[expected_order]
        )
    types = {name: getattr(layers, name).dtype for name in ("pixel", "layer", "depth")}
    assert types == {"pixel": np.int64, "layer": np.int64, "depth": np.float64}
    return layers


def peel_one_by_one(triangles, width, height) -> DepthLayers:
    """Depth layers: each triangle is drawn alone, and each pixel is sorted alone."""
    in_pixel = {}
    for number, triangle in enumerate(triangles):
        x, y = np.round(triangle[:, :2] * SNAP).astype(np.int64).T
        turn = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        drawn = draw(triangle, width, height)
        pixels = (drawn.row * width + drawn.column).tolist()
        for pixel, depth in zip(pixels, drawn.depth.tolist(), strict=True):
            in_pixel.setdefault(pixel, []).append((depth, number, bool(turn < 0)))
    rows = [
        (pixel, *fragment, layer)
        for pixel in sorted(in_pixel)
        for layer, fragment in enumerate(sorted(in_pixel[pixel]))
    ]
    pixel, depth, triangle, entering, layer = np.array(rows, float).reshape(-1, 5).T
    return DepthLayers(
        pixel=pixel.astype(int),
        depth=depth,
        triangle=triangle.astype(int),
        entering=entering.astype(bool),
        layer=layer.astype(int),
        width=width,
        height=height,
    )


def ball(rng, roughness=0.0):
    """An icosphere, its corners moved in and out: closed, not convex."""
    radius = 1.0 + roughness * rng.uniform(-1.0, 1.0, (len(SPHERE.vertices), 1))
    return (SPHERE.vertices * radius)[SPHERE.faces]


def cuboid(rng):
    x, y, z = rng.uniform(0.5, 2.0, 3).tolist()
    return shapes.box((x, y, z)).triangles


def union(rng):
    """Overlapping closed parts, not joined."""
    bodies = [ball(rng, 0.3), *(cuboid(rng) for _ in range(3))]
    return np.concatenate([body + rng.uniform(-1, 1, 3) for body in bodies])


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
    low = turned.min((0, 1))
    high = turned.max((0, 1))
    scale = 0.9 * pixels / (high - low).max()
    return (turned - (low + high) / 2) * scale + pixels / 2


def ray_balance(layers):
    """Enterings less leavings of each ray."""
    step = np.where(layers.entering, 1, -1)
    return np.bincount(layers.pixel, step, minlength=layers.width * layers.height)
