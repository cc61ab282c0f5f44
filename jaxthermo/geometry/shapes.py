"""Procedural bodies: watertight, wound outward, centred at the origin.

Round shapes are widened slightly so that their volume, and with it their heat capacity,
is exact; their vertices lie just outside the given radius.
"""

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError, positive_length
from .figurine import figurine
from .mesh import Mesh


__all__ = ["box", "cylinder", "figurine", "slab", "sphere"]

_Size = float | int | tuple[float | int, float | int, float | int]

# Corner number 4 i + 2 j + k of the unit cube is at (i, j, k).
_BOX_QUADS = np.array([
    [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3],
])  # fmt: skip


def box(size: _Size) -> Mesh:
    """Box of 12 triangles with edges `size` along x, y, z [m]; one number: a cube."""
    edges = size if isinstance(size, tuple) else (size, size, size)
    lengths = np.array([positive_length("size", edge) for edge in edges])
    corners = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    faces = np.concatenate([_BOX_QUADS[:, [0, 1, 2]], _BOX_QUADS[:, [0, 2, 3]]])
    return Mesh(corners * lengths, faces, "box")


def slab(thickness: float | int, width: float | int, length: float | int) -> Mesh:
    """Box `thickness` thick along x, `width` along y, `length` along z [m]."""
    plate = box((thickness, width, length))
    return Mesh(plate.vertices, plate.faces, "slab")


def sphere(radius: float | int, subdivisions: int = 4) -> Mesh:
    """Sphere of `radius` [m]: an icosahedron with its faces repeatedly cut in four.

    Of 20 * 4^subdivisions faces. The volume is exact; the area is too large by 1e-3 of
    itself at 3 subdivisions, a quarter of that with each further one.
    """
    radius = positive_length("radius", radius)
    points, faces = _icosahedron()
    for _ in range(subdivisions):
        points, faces = _cut_in_four(points, faces)
    # Widened so that the volume is that of the sphere.
    unit = Mesh(points, faces, "sphere")
    widening = (4.0 / 3.0 * np.pi / unit.volume) ** (1.0 / 3.0)
    return Mesh(points * radius * widening, faces, "sphere")


def cylinder(radius: float | int, height: float | int, sections: int = 64) -> Mesh:
    """Cylinder along z of `radius` and `height` [m] with `sections` sides [-]."""
    radius = positive_length("radius", radius)
    height = positive_length("height", height)
    if sections < 3:
        raise InputError(f"sections={sections} make no cylinder: give 3 or more")
    angle = 2.0 * np.pi * np.arange(sections) / sections
    # Widened so that the polygon has the area of the circle.
    widening = np.sqrt(2.0 * np.pi / sections / np.sin(2.0 * np.pi / sections))
    rim = radius * widening * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([rim, np.full(sections, -0.5 * height)])
    high = np.column_stack([rim, np.full(sections, 0.5 * height)])
    centres = np.array([[0.0, 0.0, -0.5 * height], [0.0, 0.0, 0.5 * height]])
    index = np.arange(sections)
    after = np.roll(index, -1)
    bottom, top = np.full(sections, 2 * sections), np.full(sections, 2 * sections + 1)
    faces = np.concatenate(
        [
            np.stack([index, after, after + sections], axis=1),
            np.stack([index, after + sections, index + sections], axis=1),
            np.stack([bottom, after, index], axis=1),
            np.stack([top, index + sections, after + sections], axis=1),
        ]
    )
    return Mesh(np.concatenate([low, high, centres]), faces, "cylinder")


def _icosahedron() -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Icosahedron of radius 1: two poles and two rings of five at z = +-1/sqrt(5)."""
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    z = 1.0 / np.sqrt(5.0)
    upper = np.column_stack([2 * z * np.cos(angle), 2 * z * np.sin(angle)])
    lower = np.column_stack(
        [2 * z * np.cos(angle + np.pi / 5), 2 * z * np.sin(angle + np.pi / 5)]
    )
    points = np.zeros((12, 3))
    points[0, 2], points[11, 2] = 1.0, -1.0
    points[1:6, :2], points[1:6, 2] = upper, z
    points[6:11, :2], points[6:11, 2] = lower, -z
    u, n = np.arange(1, 6), np.roll(np.arange(1, 6), -1)
    faces = [
        np.stack([np.zeros(5, int), u, n], axis=1),
        np.stack([u, u + 5, n], axis=1),
        np.stack([n, u + 5, n + 5], axis=1),
        np.stack([np.full(5, 11), n + 5, u + 5], axis=1),
    ]
    return points, np.concatenate(faces)


def _cut_in_four(
    points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
    ends, number = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    middles = points[ends].mean(1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (number.reshape(-1, 3) + len(points)).T
    a, b, c = faces.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    cut = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return np.concatenate([points, middles]), cut
