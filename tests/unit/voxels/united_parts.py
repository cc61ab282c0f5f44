"""Seeded bodies of two or three parts that overlap, are flush, nested or touch.

Gaps and overlaps are 0 or above one cell of a lattice of 40 cells along the body.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from voxel_bodies import joined

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh


RELATIONS = ("overlapping", "flush", "nested", "touching")

# More than a cell of the longest body: three parts of unit length in a row.
GAP = 0.09


class UnitedParts(NamedTuple):
    """Parts as one mesh without any cutting, with the exact sizes of their union."""

    mesh: Mesh
    area: float
    volume: float
    description: str


class _Part(NamedTuple):
    mesh: Mesh
    box: np.ndarray
    """Lowest and highest corner."""


def united_parts(seed: int) -> UnitedParts:
    """Random boxes and cylinders in a random turn; their union by manifold3d."""
    rng = np.random.default_rng(seed)
    parts = [_shape(rng, _random_box(rng))]
    relations = []
    for _ in range(rng.integers(1, 3)):
        relation = str(rng.choice(RELATIONS))
        relations.append(relation)
        neighbour = parts[rng.integers(len(parts))]
        parts.append(_RELATED[relation](rng, neighbour))
    meshes = [part.mesh for part in parts]
    union = shapes.union(*meshes)
    turn = Rotation.from_quat(rng.normal(size=4))
    body = joined(*meshes)
    vertices = turn.apply(body.vertices) + rng.uniform(-1, 1, 3)
    return UnitedParts(
        mesh=Mesh(vertices, body.faces, "parts"),
        area=union.area,
        volume=union.volume,
        description=f"{seed}: {', '.join(relations)}",
    )


def pitch_of(mesh: Mesh, cells: int = 40) -> float:
    """Pitch with so many cells along the longest side of a mesh."""
    return float(np.ptp(mesh.bounds, axis=0).max() / cells)


def _random_box(rng: np.random.Generator) -> np.ndarray:
    size = rng.uniform(0.4, 1.0, 3)
    return np.array([-size / 2, size / 2])


def _shape(rng: np.random.Generator, box: np.ndarray) -> _Part:
    """A box, or the cylinder within it along one of its axes."""
    size = np.ptp(box, axis=0)
    if rng.random() < 0.5:
        mesh = shapes.box(tuple(size))
    else:
        axis = int(rng.integers(3))
        across = np.delete(size, axis)
        cylinder = shapes.cylinder(across.min() / 2, size[axis])
        order = np.roll([0, 1, 2], axis + 1)
        # A cyclic change of axes keeps the faces' direction.
        vertices = np.empty_like(cylinder.vertices)
        vertices[:, order] = cylinder.vertices
        mesh = Mesh(vertices, cylinder.faces, "cylinder")
    placed = mesh.moved(box.mean(axis=0))
    return _Part(placed, placed.bounds)


def _overlapping(rng: np.random.Generator, neighbour: _Part) -> _Part:
    """A part in its own turn that reaches into another."""
    box = neighbour.box
    part = _shape(rng, _random_box(rng)).mesh
    turn = Rotation.from_quat(rng.normal(size=4))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    offset = box.mean(axis=0) + direction * np.ptp(box, axis=0).min() * 0.6
    mesh = Mesh(turn.apply(part.vertices) + offset, part.faces, "turned")
    return _Part(mesh, mesh.bounds)


def _flush(rng: np.random.Generator, neighbour: _Part) -> _Part:
    """A part that overlaps another, with some of its faces flush."""
    box = neighbour.box
    size = np.ptp(box, axis=0)
    shift = np.maximum(rng.uniform(0, size - GAP), GAP) * rng.choice([-1, 1], 3)
    if rng.random() < 0.5:
        # The same shape farther on: all sides of a cylinder are flush.
        shift[rng.permutation(3)[:2]] = 0
        mesh = neighbour.mesh.moved(shift)
        return _Part(mesh, mesh.bounds)
    shift[rng.permutation(3)[: rng.integers(1, 3)]] = 0
    return _shape(rng, box + shift)


def _nested(rng: np.random.Generator, neighbour: _Part) -> _Part:
    """A part within another, with some of its faces flush."""
    box = neighbour.box
    size = np.ptp(box, axis=0)
    margin = np.maximum(rng.uniform(0, size / 2 - GAP / 2, (2, 3)), GAP)
    margin[(rng.random((2, 3)) < 0.3) | (size < 3 * GAP)] = 0
    return _shape(rng, box + margin * [[1], [-1]])


def _touching(rng: np.random.Generator, neighbour: _Part) -> _Part:
    """A part on a face of another."""
    box = neighbour.box
    size = np.ptp(box, axis=0)
    other = _random_box(rng)
    other += box.mean(axis=0)
    axis = int(rng.integers(3))
    shift = np.zeros(3)
    shift[axis] = box[1, axis] - other[0, axis]
    side = (axis + 1) % 3
    if rng.random() < 0.5:
        shift[side] = box[0, side] - other[0, side]
    else:
        shift[side] = rng.uniform(-1, 1) * (size[side] / 2)
    return _shape(rng, other + shift)


_RELATED = {
    "overlapping": _overlapping,
    "flush": _flush,
    "nested": _nested,
    "touching": _touching,
}
