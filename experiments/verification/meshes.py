"""Closed meshes that the shapes have not: of blocks, and hemispheres with a hollow."""

import numpy as np
from jaxtyping import Bool, Float

from jaxthermo.geometry.mesh import Mesh


_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
"""Of a face across the last axis, counter-clockwise seen from its positive side."""


def of_blocks(
    solid: Bool[np.ndarray, "a b c"],
    x: Float[np.ndarray, " i"],
    y: Float[np.ndarray, " j"],
    z: Float[np.ndarray, " k"],
) -> Mesh:
    """The surface of the blocks between planes that are solid.

    Args:
        solid: which are; no two may touch along an edge only.
        x: of the planes across x, one more than blocks [m].
        y: likewise.
        z: likewise.
    """
    padded, faces = np.pad(solid, 1), []
    for axis in range(3):
        for sign in (-1, 1):
            open_ = ~np.roll(padded, -sign, axis)[1:-1, 1:-1, 1:-1]
            cells = np.argwhere(solid & open_)
            corners = np.roll(_CORNERS, axis + 1, axis=1)[::sign].copy()
            corners[:, axis] = (sign + 1) // 2
            quad = cells[:, None] + corners
            faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    places = np.concatenate(faces).reshape(-1, 3)
    vertices, number = np.unique(places, axis=0, return_inverse=True)
    planes = [p[vertices[:, axis]] for axis, p in enumerate((x, y, z))]
    return Mesh(np.stack(planes, axis=1), number.reshape(-1, 3), "blocks")


def hollow_hemisphere(inner: float, outer: float, steps: int = 32) -> Mesh:
    """The upper half of a spherical shell around the origin, closed by a flat ring.

    Both spheres are widened such that each of them holds its true volume.

    Args:
        inner: radius of the hollow [m].
        outer: radius [m].
        steps: from the pole to the ring; four times as many around.
    """
    rings = 4 * steps
    turn = 2 * np.pi * np.arange(rings) / rings
    angle = np.pi / 2 * np.arange(1, steps + 1) / steps
    unit = np.stack(
        [
            np.outer(np.sin(angle), np.cos(turn)),
            np.outer(np.sin(angle), np.sin(turn)),
            np.outer(np.cos(angle), np.ones(rings)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    unit[-rings:, 2] = 0.0
    unit = np.concatenate([unit, [[0.0, 0.0, 1.0]]])
    cap = _cap(steps, rings)
    corners = unit[cap]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    wide = float((2 * np.pi / 3 / (volume / 6)) ** (1 / 3))
    count, this = len(unit), np.arange(rings)
    after = np.roll(this, -1)
    last = (steps - 1) * rings
    rim, hole = last + np.stack([this, after]), count + last + np.stack([this, after])
    ring = [
        np.stack([rim[0], hole[0], rim[1]], axis=1),
        np.stack([rim[1], hole[0], hole[1]], axis=1),
    ]
    vertices = np.concatenate([outer * wide * unit, inner * wide * unit])
    return Mesh(vertices, np.concatenate([cap, cap[:, ::-1] + count, *ring]), "shell")


def _cap(steps: int, rings: int) -> np.ndarray:
    """Triangles of a hemisphere, outward; the pole is the last vertex."""
    this = np.arange(rings)
    after, pole = np.roll(this, -1), np.full(rings, steps * rings)
    faces = [np.stack([pole, this, after], axis=1)]
    for step in range(steps - 1):
        up, low = step * rings, (step + 1) * rings
        faces += [
            np.stack([up + this, low + this, up + after], axis=1),
            np.stack([up + after, low + this, low + after], axis=1),
        ]
    return np.concatenate(faces)
