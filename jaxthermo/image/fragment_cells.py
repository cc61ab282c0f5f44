"""Fragments near points of a surface, and their weights in values at the points.

The value at a point is a weighted mean of the fragments within a radius R, with
weights (1 - r^2/R^2)^2 times the fragment's area and the squared cosine between the
normals, so that nothing leaks through a thin sheet or around an edge.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ..findings import found
from ..scene.scene import BodyGeometry


# Points per chunk. Temporaries that stay in the cache, and that the allocator keeps
# instead of returning them, take a third of the time of larger ones.
CHUNK = 2048

# Sizes of the arrays of the program for more points, the same for all views: points of
# a call, and pairs of a call.
_POINTS, _PAIRS = 2**13, 2**18
# Fragments are padded to a multiple of this, so that few programs occur.
_FRAGMENTS = 2**17

# Cells in a row for one radius: the flatter, the fewer fragments that are too far away.
_FLAT = 4
# Largest number of cells for a table.
_MAX_CELLS = 2**22


class Neighbours(NamedTuple):
    """Pairs of a point and a fragment near it with a weight above 0."""

    owner: Int[np.ndarray, " w"]
    """Index of the point, ascending."""
    fragment: Int[np.ndarray, " w"]
    weight: Float[np.ndarray, " w"]
    """Before it is normalized [m^2]."""


class FragmentCells:
    """Fragments sorted into cells of the weights' radius, flat ones."""

    def __init__(self, geometry: BodyGeometry, radius: float):
        position = geometry.fragment_position
        self.radius = radius
        self.edge = radius / np.array([1, 1, _FLAT])
        # Empty cells on all sides, so that every point has cells around it.
        border = np.array([3, 3, 2 * _FLAT + 1])
        self.low = position.min(0) - (border + 0.5) * self.edge
        cell = np.floor((position - self.low) / self.edge).astype(np.int64)
        self.size = cell.max(0) + border + 1
        key = self._key(*cell.T)
        self.order = np.argsort(key, kind="stable").astype(np.int32)
        self.keys = key[self.order]
        # Columns in the order of the cells, so that neighbours are close in memory.
        self.position = np.ascontiguousarray(position[self.order].T)
        self.normal = np.ascontiguousarray(geometry.fragment_normal[self.order].T)
        self.area = geometry.fragment_area[self.order]
        # First fragment of each cell, unless most of the box around the body is empty.
        self.first = None
        if self.size.prod() <= _MAX_CELLS:
            number = np.bincount(key, minlength=int(self.size.prod()))
            self.first = np.append(0, np.cumsum(number)).astype(np.int32)

    def _key(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return (x * self.size[1] + y) * self.size[2] + z

    def _start(self, key: np.ndarray) -> np.ndarray:
        """First fragment in a cell or behind it."""
        if self.first is None:
            return np.searchsorted(self.keys, key)
        return self.first[key]

    def _ranges(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First fragment and number of fragments [p, 9] in nine rows of cells."""
        around = np.array([1, 1, _FLAT])
        cell = (
            np.clip(np.floor((x - low) / edge), n, size - 1 - n).astype(np.int64)
            for x, low, edge, size, n in zip(
                points.T, self.low, self.edge, self.size, around, strict=True
            )
        )
        # Cells of a row along z have keys in succession.
        x, y = np.indices((3, 3)).reshape(2, -1) - 1
        row = self._key(*cell)[:, None] + self._key(x, y, np.full(9, -_FLAT))
        first = self._start(row)
        return first, self._start(row + 2 * _FLAT + 1) - first

    def pairs(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, fragments and their places here, in the same or adjacent cells."""
        first, count = self._ranges(points)
        number = count.sum(axis=1)
        flat = count.ravel()
        place = np.repeat(first.ravel() - np.cumsum(flat) + flat, flat)
        place += np.arange(len(place))
        return np.repeat(np.arange(len(points)), number), self.order[place], place

    def weighted(
        self, points: Float[np.ndarray, "p 3"], normals: Float[np.ndarray, "p 3"]
    ) -> Neighbours:
        """Fragments with a weight at each point: few points, or the reference."""
        owner, _, place = self.pairs(points)
        squared = np.zeros(len(owner))
        for along, other in zip(points.T, self.position, strict=True):
            away = along[owner] - other[place]
            squared += away * away
        # Two thirds of the pairs are too far apart.
        near = np.flatnonzero(squared < self.radius * self.radius)
        owner, place = owner[near], place[near]
        cosine = np.zeros(len(owner))
        for along, other in zip(normals.T, self.normal, strict=True):
            cosine += along[owner] * other[place]
        fade = 1 - squared[near] / (self.radius * self.radius)
        weight = (fade * np.maximum(cosine, 0)) ** 2 * self.area[place]
        kept = np.flatnonzero(weight > 0)
        place = place[kept]
        return Neighbours(owner[kept], self.order[place], weight[kept])

    def means(
        self,
        points: Float[np.ndarray, "p 3"],
        normals: Float[np.ndarray, "p 3"],
        chosen: Callable[[Neighbours], np.ndarray] | None = None,
        otherwise: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> csr_array:
        """Weights [p, s] that add up to 1 at every point with a fragment near it.

        Args:
            points: in the frame of the body [m].
            normals: unit vectors there.
            chosen: of pairs, those to count, all if None.
            otherwise: a fragment for each of the points that have none near them, by
                their numbers; no weights there if None.
        """
        first, count = self._ranges(points)
        ends = np.cumsum(count.sum(axis=1))
        # Memory that is not written to is not taken: most pairs are too far apart.
        # Room for one fragment that is not near besides, at every point.
        weights = np.empty(ends[-1] + len(ends) if len(ends) else 0)
        columns, rows = (
            np.empty(len(weights), np.int32),
            np.zeros(len(points), np.int32),
        )
        filled = 0
        for start, stop, near in self._parts(points, normals, first, count, ends):
            owner, fragment, weight = near
            if chosen is not None:
                kept = chosen(Neighbours(owner + start, fragment, weight))
                owner, fragment, weight = owner[kept], fragment[kept], weight[kept]
            number = np.bincount(owner, minlength=stop - start)
            alone = np.flatnonzero(number == 0)
            if otherwise is not None and len(alone):
                at = np.searchsorted(owner, alone)
                fragment = np.insert(fragment, at, otherwise(alone + start))
                owner, weight = np.insert(owner, at, alone), np.insert(weight, at, 1.0)
                number[alone] = 1
            total = np.bincount(owner, weight, stop - start)
            rows[start:stop] = number
            part = slice(filled, filled + len(weight))
            np.divide(weight, total[owner], out=weights[part])
            columns[part] = fragment
            filled = part.stop
        # In place: scipy would copy parts of far larger arrays.
        weights.resize(filled, refcheck=False)
        columns.resize(filled, refcheck=False)
        starts = np.append(0, np.cumsum(rows)).astype(np.int32)
        size = len(points), len(self.area)
        return csr_array((weights, columns, starts), size)

    def _parts(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        first: np.ndarray,
        count: np.ndarray,
        ends: np.ndarray,
    ) -> Iterator[tuple[int, int, Neighbours]]:
        """First and last points of a part, and the fragments with a weight there."""
        if len(points) <= CHUNK:
            yield 0, len(points), self.weighted(points, normals)
            return
        # One is computed while what is in the one before it is read.
        running, start = None, 0
        while start < len(points):
            # As many points as have room, with all their pairs.
            before = ends[start - 1] if start else 0
            stop = int(np.searchsorted(ends, before + _PAIRS, side="right"))
            stop = max(min(stop, start + _POINTS), start + 1)
            part = slice(start, stop)
            given = *points[part].T, *normals[part].T
            call = self._call(given, first[part].ravel(), count[part].ravel())
            if running is not None:
                yield *running[:2], self._read(*running[2:])
            running, start = (start, stop, *call), stop
        assert running is not None
        yield *running[:2], self._read(*running[2:])

    def _call(
        self, columns: tuple[np.ndarray, ...], first: np.ndarray, count: np.ndarray
    ) -> tuple[np.ndarray, Array, Array]:
        """Start the program: the run of each pair, and its places and weights."""
        run = np.repeat(np.arange(len(count), dtype=np.int32), count)
        padded = np.zeros(max(_PAIRS, len(run)), np.int32)
        padded[: len(run)] = run
        base = np.zeros(9 * _POINTS, np.int32)
        base[: len(count)] = first - np.cumsum(count) + count
        points = np.zeros((6, _POINTS))
        points[:, : len(columns[0])] = columns
        with jax.enable_x64(True):
            fragments = self._on_device()
            return run, *_pair_weights(padded, base, points, fragments, self.radius)

    def _on_device(self) -> Float[Array, "7 s"]:
        """Positions, normals and areas, padded so that few programs occur."""

        def moved() -> Float[Array, "7 s"]:
            spare = -len(self.area) % _FRAGMENTS
            columns = np.stack([*self.position, *self.normal, self.area])
            return jnp.asarray(np.pad(columns, ((0, 0), (0, spare))))

        return found((self,), "columns", moved)

    def _read(self, run: np.ndarray, place: Array, weight: Array) -> Neighbours:
        """The pairs with a weight."""
        host = np.asarray(weight)[: len(run)]
        kept = np.flatnonzero(host > 0)
        return Neighbours(
            run[kept] // 9, self.order[np.asarray(place)[kept]], host[kept]
        )


@jax.jit
def _pair_weights(
    run: Int[Array, " n"],
    base: Int[Array, " r"],
    points: Float[Array, "6 p"],
    fragments: Float[Array, "7 s"],
    radius: Float[Array, ""] | float,
) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """Places of the fragments of pairs, and their weights: `FragmentCells.weighted`.

    Columns are positions, normals and, of fragments, areas. A pair belongs to a run of
    places in succession, of which a point has nine; `base` plus the number of the pair
    is its place.
    """
    place = base[run] + jnp.arange(run.size, dtype=np.int32)
    # A division of signed integers would take as long as all else.
    owner = (run.astype(np.uint32) // np.uint32(9)).astype(np.int32)
    squared, cosine = jnp.zeros(()), jnp.zeros(())
    for axis in range(3):
        away = points[axis][owner] - fragments[axis][place]
        squared += away * away
        cosine += points[3 + axis][owner] * fragments[3 + axis][place]
    fade = jnp.maximum(1 - squared / (radius * radius), 0)
    return place, (fade * jnp.maximum(cosine, 0)) ** 2 * fragments[6][place]


def cells_of(geometry: BodyGeometry, radius: float) -> FragmentCells:
    """Cells of a body's fragments, the same for all views and poses of it."""
    of = geometry.fragment_position, geometry.fragment_normal, geometry.fragment_area
    by = "fragment_cells", radius
    return found(of, by, lambda: FragmentCells(geometry, radius))


def block_matrix(parts: list[csr_array]) -> csr_array:
    """Matrices one below the other, each with columns of its own."""
    if len(parts) == 1:
        return parts[0]
    sizes: Any = [part.shape for part in parts]
    before = np.cumsum([0, *(width for _, width in sizes)])
    columns = [part.indices + n for part, n in zip(parts, before[:-1], strict=True)]
    # Entries of each row, counted up.
    counts = np.concatenate([np.diff(part.indptr) for part in parts])
    starts = np.concatenate([[0], np.cumsum(counts)])
    data = np.concatenate([part.data for part in parts])
    size = len(counts), int(before[-1])
    return csr_array((data, np.concatenate(columns), starts), size)
