"""Insides of closed sheets: the parts of space that a surface encloses.

A connected piece of the surface is closed where every edge has an even number of faces,
whatever their winding. A point is inside a closed piece if a ray from it crosses the
piece an odd number of times.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from ..geometry.mesh import edges_of, part_labels
from ..geometry.vectors import part_bounds
from ..voxels.cavities import AbstractCavities


_PAIRS = 2**20
"""Pairs of a ray and a triangle that are computed at once."""

_FRAMES = np.asarray(np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3, 3))).Q)
"""Frames whose last axes are the directions of the rays of a point.

The odd one out of three has met an edge within rounding.
"""


@dataclass(frozen=True, eq=False)
class SheetInsides(AbstractCavities):
    """The insides of the closed pieces of a surface, numbered from 1.

    An inside within another one has the higher number.
    """

    triangles: Float[np.ndarray, "t 3 3"]
    """Triangles of the closed pieces in the body's frame [m]."""
    number: Int[np.ndarray, " t"]
    """Number of the inside that each of them bounds."""

    @property
    @override
    def count(self) -> int:
        return int(self.number.max())

    @override
    def at(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Number of the innermost inside around each point [m]; 0 outside of all."""
        votes = np.zeros((len(points), self.count + 1), int)
        for view in self._views:
            crossings = np.zeros(votes.size, int)
            for point, number in view.crossings(points):
                entry = point * votes.shape[1] + number
                crossings += np.bincount(entry, minlength=votes.size)
            votes += crossings.reshape(votes.shape) % 2
        return np.asarray((votes >= 2) * np.arange(self.count + 1)).max(axis=1)

    @cached_property
    def _views(self) -> tuple["_View", ...]:
        return tuple(_view(self.triangles, self.number, frame) for frame in _FRAMES)


class _View(NamedTuple):
    """Triangles as rays along one direction meet them, by squares of a grid."""

    frame: Float[np.ndarray, "3 3"]
    """Axes of the view, the last one along the rays."""
    corners: Float[np.ndarray, "t 3 3"]
    number: Int[np.ndarray, " t"]
    lower: Float[np.ndarray, "2"]
    square: Float[np.ndarray, "2"]
    """Edges of a square [m]."""
    squares: int
    """Number of squares along each axis."""
    first: Int[np.ndarray, " q"]
    """First entry of each square in `triangle`, and one past the last of all."""
    triangle: Int[np.ndarray, " e"]
    """Triangles whose box reaches into each square."""

    def crossings(
        self, points: Float[np.ndarray, "n 3"]
    ) -> Iterator[tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]]:
        """Points and numbers of the triangles that their rays cross, in chunks."""
        seen = points @ self.frame.T
        cell = np.floor((seen[:, :2] - self.lower) / self.square).astype(int)
        within = np.flatnonzero(((cell >= 0) & (cell < self.squares)).all(axis=1))
        flat = cell[within, 0] * self.squares + cell[within, 1]
        count = self.first[flat + 1] - self.first[flat]
        chunk = np.cumsum(count) // _PAIRS
        for number in range(int(chunk[-1]) + 1 if len(chunk) else 0):
            rows = chunk == number
            ray = np.repeat(np.flatnonzero(rows), count[rows])
            nth = np.arange(len(ray)) - np.searchsorted(ray, ray)
            triangle = self.triangle[self.first[flat[ray]] + nth]
            point = within[ray]
            crosses = _is_crossed(seen[point], self.corners[triangle])
            yield point[crosses], self.number[triangle[crosses]]


def _view(
    triangles: Float[np.ndarray, "t 3 3"],
    number: Int[np.ndarray, " t"],
    frame: Float[np.ndarray, "3 3"],
) -> _View:
    corners = triangles @ frame.T
    flat = corners[:, :, :2]
    lower = flat.min(axis=(0, 1))
    squares = int(np.sqrt(len(triangles))) + 1
    # Wider than the surface by a rounding error: its last point is in a square.
    square = (1 + 1e-9) * np.ptp(flat.reshape(-1, 2), axis=0) / squares
    low = np.floor((flat.min(axis=1) - lower) / square).astype(int)
    high = np.floor((flat.max(axis=1) - lower) / square).astype(int)
    wide = high - low + 1
    count = wide.prod(axis=1)
    triangle = np.repeat(np.arange(len(triangles)), count)
    nth = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    row, column = np.divmod(nth, wide[triangle, 1])
    cell = (low[triangle, 0] + row) * squares + low[triangle, 1] + column
    order = np.argsort(cell, kind="stable")
    return _View(
        frame=frame,
        corners=corners,
        number=number,
        lower=lower,
        square=square,
        squares=squares,
        first=np.searchsorted(cell[order], np.arange(squares**2 + 1)),
        triangle=triangle[order],
    )


def _is_crossed(
    start: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "k 3 3"]
) -> Bool[np.ndarray, " k"]:
    """Flag triangles that the rays upward from points cross, pair by pair."""
    offset = corners - start[:, None]
    x = offset[:, :, 0]
    y = offset[:, :, 1]
    z = offset[:, :, 2]
    # Twice the areas between the ray and each edge, of one sign around the ray.
    edge = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    around = (edge >= 0).all(axis=1) | (edge < 0).all(axis=1)
    total = edge.sum(axis=1)
    # Each corner's weight is the area opposite to it.
    height = (np.roll(edge, -1, axis=1) * z).sum(axis=1) * np.sign(total)
    return around & (total != 0) & (height > 0)


def find_insides(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]
) -> SheetInsides | None:
    """The insides of the closed pieces of a surface; None if it has none.

    Args:
        vertices: positions in the body's frame [m].
        faces: vertices of the triangles, which are joined along their edges.
    """
    label = part_labels(faces)
    count = int(label.max(initial=-1)) + 1
    edges = edges_of(faces)
    # Faces that welding has collapsed have edges of one vertex.
    is_border = (edges.uses[edges.edge] % 2 == 1) & (edges.start != edges.end)
    has_border = np.bincount(np.repeat(label, 3)[is_border], minlength=count) > 0
    corners = vertices[faces]
    lower, upper = part_bounds(corners, label, count)
    # Of a piece within another one the box is smaller.
    diagonal = np.linalg.norm(upper - lower, axis=1)
    closed = np.flatnonzero(~has_border)
    closed = closed[np.argsort(-diagonal[closed], kind="stable")]
    number = np.zeros(count, int)
    number[closed] = np.arange(1, len(closed) + 1)
    bounds = number[label] > 0
    if not bounds.any():
        return None
    return SheetInsides(corners[bounds], number[label][bounds])
