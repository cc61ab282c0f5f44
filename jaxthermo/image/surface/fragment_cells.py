"""Fragments near points of a surface, and their weights in values at the points.

The value at a point is a weighted mean of the fragments within a radius R, with
weights (1 - r^2/R^2)^2 times the fragment's area and the squared cosine between the
normals, so that nothing leaks through a thin sheet or around an edge.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ...arrays import device_array
from ...memo.found import found
from .shapes import ShapePoints, Shapes


# Points per chunk: temporaries stay in the cache, and the allocator keeps them instead
# of returning them.
CHUNK = 2048

# Sizes of the arrays of the program for more points, the same for all views: points of
# a call, and pairs of a call.
_POINTS = 2**13
_PAIRS = 2**18
# Fragments are padded to a multiple of this, so that few programs occur.
_FRAGMENTS = 2**17

# Cells in a row for one radius: the flatter, the fewer fragments that are too far away.
_FLAT = 4
# Largest number of cells of all shapes for a table.
_MAX_CELLS = 2**23


class _Neighbours(NamedTuple):
    """Pairs of a point and a fragment near it with a weight above 0."""

    owner: Int[np.ndarray, " w"]
    """Index of the point, ascending."""
    fragment: Int[np.ndarray, " w"]
    weight: Float[np.ndarray, " w"]
    """Weight before normalization [m^2]."""


class Limits(NamedTuple):
    """Fragments that count at points."""

    height: Float[np.ndarray, "#p"]
    """Distance from the plane of each point that they are within [m]."""
    cosine: float = 0.0
    """Cosine between the normals that they are above, at least 0."""


_NO_LIMITS = Limits(np.array([np.inf]))


class _CellPairs(NamedTuple):
    """Pairs of a point and a fragment in the same or in adjacent cells."""

    owner: Int[np.ndarray, " w"]
    """Index of the point, ascending."""
    slot: Int[np.ndarray, " w"]
    """Position of the fragment in the order of the cells."""


class _PointRange(NamedTuple):
    """Successive points with the fragments that have a weight there."""

    start: int
    stop: int
    near: _Neighbours


class _RunningCall(NamedTuple):
    """A call of the program for successive points, of which results are awaited."""

    start: int
    stop: int
    run: Int[np.ndarray, " n"]
    """Run of each pair."""
    slot: Int[Array, " n"]
    weight: Float[Array, " n"]


class FragmentCells:
    """Fragments sorted into flat cells, whose width is the radius of the weights.

    Each shape has cells of its own. Those of a thin wall have the fragments of its
    front alone: the back has the same ones with opposite normals.
    """

    def __init__(self, shapes: Shapes, radius: float):
        self.fragment_count = len(shapes.fragment_area)
        self.is_wall = shapes.is_two_sided
        count = shapes.fragment_count // (1 + self.is_wall)
        first = np.cumsum(count) - count
        shape = np.repeat(np.arange(len(count)), count)
        front = np.arange(len(shape)) + (shapes.first_fragment - first)[shape]
        position = shapes.fragment_position[front]
        self.radius = radius * shapes.pitch
        self.edge = self.radius[:, None] / np.array([1, 1, _FLAT])
        # Empty cells on all sides, so that every point has cells around it.
        border = np.array([3, 3, 2 * _FLAT + 1])
        corner = np.minimum.reduceat(position, first)
        self.low = corner - (border + 0.5) * self.edge
        cell = np.floor((position - self.low[shape]) / self.edge[shape])
        cell = cell.astype(np.int64)
        self.size = np.maximum.reduceat(cell, first) + border + 1
        cells = self.size.prod(axis=1)
        self.first_key = np.cumsum(cells) - cells
        key = self._key(shape, *cell.T)
        order = np.argsort(key, kind="stable")
        self.keys = key[order]
        self.front = front[order].astype(np.int32)
        self.back = self.front + (self.is_wall * count)[shape[order]].astype(np.int32)
        # Columns in the order of the cells, so that neighbours are close in memory.
        self.position = np.ascontiguousarray(position[order].T)
        self.normal = np.ascontiguousarray(shapes.fragment_normal[self.front].T)
        self.area = shapes.fragment_area[self.front]
        # First fragment of each cell, unless most of the boxes around shapes is empty.
        self.first = None
        if cells.sum() <= _MAX_CELLS:
            number = np.bincount(key, minlength=int(cells.sum()))
            self.first = np.append(0, np.cumsum(number)).astype(np.int32)

    def _key(
        self, shape: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray
    ) -> np.ndarray:
        _, rows, columns = self.size[shape].T
        return self.first_key[shape] + (x * rows + y) * columns + z

    def _start(self, key: np.ndarray) -> np.ndarray:
        """First fragment in a cell or behind it."""
        if self.first is None:
            return np.searchsorted(self.keys, key)
        return self.first[key]

    def _ranges(self, points: ShapePoints) -> tuple[np.ndarray, np.ndarray]:
        """First fragment and number of fragments [p, 9] in nine rows of cells."""
        around = np.array([1, 1, _FLAT])
        shape = points.shape
        cell = (
            np.clip(np.floor((x - low) / edge), n, size - 1 - n).astype(np.int64)
            for x, low, edge, size, n in zip(
                points.position.T,
                self.low[shape].T,
                self.edge[shape].T,
                self.size[shape].T,
                around,
                strict=True,
            )
        )
        # Cells of a row along z have keys in succession.
        x, y = np.indices((3, 3)).reshape(2, -1) - 1
        _, rows, columns = self.size[shape].T[..., None]
        row = self._key(shape, *cell)[:, None] + (x * rows + y) * columns - _FLAT
        first = self._start(row)
        return first, self._start(row + 2 * _FLAT + 1) - first

    def pairs(self, points: ShapePoints) -> _CellPairs:
        """Pairs of points and fragments in the same or in adjacent cells."""
        first, count = self._ranges(points)
        number = count.sum(axis=1)
        flat = count.ravel()
        slot = np.repeat(first.ravel() - np.cumsum(flat) + flat, flat)
        slot += np.arange(len(slot))
        owner = np.repeat(np.arange(len(points.shape)), number)
        return _CellPairs(owner=owner, slot=slot)

    def facing(
        self, slot: Int[np.ndarray, " w"], cosine: Float[np.ndarray, " w"]
    ) -> Int[np.ndarray, " w"]:
        """Fragments in the order of the cells, those of walls on the side of a point.

        The sign of the cosine between the normals of both tells that side.
        """
        return np.where(cosine < 0, self.back[slot], self.front[slot])

    def weighted(
        self,
        points: ShapePoints,
        limits: Limits = _NO_LIMITS,
    ) -> _Neighbours:
        """Fragments with a weight at each point: few points, or the reference."""
        owner, slot = self.pairs(points)
        square = self._square(points)
        squared = np.zeros(len(owner))
        for along, fragment_column in zip(
            points.position.T, self.position, strict=True
        ):
            away = along[owner] - fragment_column[slot]
            squared += away * away
        # Most pairs are too far apart.
        near = np.flatnonzero(squared < square[owner])
        owner = owner[near]
        slot = slot[near]
        between = np.zeros(len(owner))
        away = np.zeros(len(owner))
        for along, place, across, fragment_column in zip(
            points.position.T, self.position, points.normal.T, self.normal, strict=True
        ):
            normal = across[owner]
            between += normal * fragment_column[slot]
            away += normal * (along[owner] - place[slot])
        fade = 1 - squared[near] / square[owner]
        facing = np.where(self.is_wall[points.shape][owner], abs(between), between)
        counts = facing > limits.cosine
        counts &= abs(away) < np.broadcast_to(limits.height, square.shape)[owner]
        weight = (fade * facing) ** 2 * self.area[slot]
        positive = np.flatnonzero(counts & (weight > 0))
        return _Neighbours(
            owner=owner[positive],
            fragment=self.facing(slot[positive], between[positive]),
            weight=weight[positive],
        )

    def _square(self, points: ShapePoints) -> Float[np.ndarray, " p"]:
        """Square of the radius at each point [m^2]."""
        return (self.radius * self.radius)[points.shape]

    def means(
        self,
        points: ShapePoints,
        limits: Limits = _NO_LIMITS,
        otherwise: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> csr_array:
        """Weights [p, s] that add up to 1 at every point with a fragment near it.

        Args:
            points: with their normals.
            limits: of the fragments that count.
            otherwise: fragments for the points, by their numbers, that have none near
                them; such points have no weights if None.
        """
        first, count = self._ranges(points)
        ends = np.cumsum(count.sum(axis=1))
        # Memory that is not written to is not taken: most pairs are too far apart.
        # Every point has room for one more fragment, that of `otherwise`.
        weights = np.empty(ends[-1] + len(ends) if len(ends) else 0)
        columns = np.empty(len(weights), np.int32)
        rows = np.zeros(len(count), np.int32)
        filled = 0
        ranges = self._ranges_of_points(
            points, limits=limits, first=first, count=count, ends=ends
        )
        for start, stop, near in ranges:
            owner, fragment, weight = near
            number = np.bincount(owner, minlength=stop - start)
            alone = np.flatnonzero(number == 0)
            if otherwise is not None and len(alone):
                at = np.searchsorted(owner, alone)
                fragment = np.insert(fragment, at, otherwise(alone + start))
                owner = np.insert(owner, at, alone)
                weight = np.insert(weight, at, 1.0)
                number[alone] = 1
            total = np.bincount(owner, weight, stop - start)
            rows[start:stop] = number
            entries = slice(filled, filled + len(weight))
            np.divide(weight, total[owner], out=weights[entries])
            columns[entries] = fragment
            filled = entries.stop
        # In place: scipy would copy parts of far larger arrays.
        weights.resize(filled, refcheck=False)
        columns.resize(filled, refcheck=False)
        starts = np.append(0, np.cumsum(rows)).astype(np.int32)
        size = len(count), self.fragment_count
        return csr_array((weights, columns, starts), size)

    def _ranges_of_points(
        self,
        points: ShapePoints,
        limits: Limits,
        first: np.ndarray,
        count: np.ndarray,
        ends: np.ndarray,
    ) -> Iterator[_PointRange]:
        """Ranges that cover all points, with the fragments near them."""
        total = len(count)
        if total <= CHUNK:
            yield _PointRange(0, total, self.weighted(points, limits))
            return
        further = [
            self._square(points),
            np.broadcast_to(limits.height, total),
            self.is_wall[points.shape],
        ]
        columns = np.concatenate([points.position.T, points.normal.T, further])
        # One range is computed while the results of the previous one are read.
        running: _RunningCall | None = None
        start = 0
        while start < total:
            # Points for which there is room, with all their pairs.
            previous_pairs = ends[start - 1] if start else 0
            stop = int(np.searchsorted(ends, previous_pairs + _PAIRS, side="right"))
            stop = max(min(stop, start + _POINTS), start + 1)
            chunk = slice(start, stop)
            call = self._call(
                columns[:, chunk],
                cosine=limits.cosine,
                first=first[chunk].ravel(),
                count=count[chunk].ravel(),
                start=start,
            )
            if running is not None:
                yield self._read(running)
            running = call
            start = stop
        assert running is not None
        yield self._read(running)

    def _call(
        self,
        columns: np.ndarray,
        cosine: float,
        first: np.ndarray,
        count: np.ndarray,
        start: int,
    ) -> _RunningCall:
        """Start the program for the points of columns [9, p], from number `start`."""
        run = np.repeat(np.arange(len(count), dtype=np.int32), count)
        padded = np.zeros(max(_PAIRS, len(run)), np.int32)
        padded[: len(run)] = run
        base = np.zeros(9 * _POINTS, np.int32)
        base[: len(count)] = first - np.cumsum(count) + count
        points = np.ones((len(columns), _POINTS))
        size = columns.shape[1]
        points[:, :size] = columns
        with jax.enable_x64(True):
            slot, weight = _pair_weights(
                padded,
                base=base,
                points=points,
                fragments=self._on_device(),
                least_cosine=np.asarray(cosine, float),
            )
        return _RunningCall(
            start=start, stop=start + size, run=run, slot=slot, weight=weight
        )

    def _on_device(self) -> Float[Array, "7 s"]:
        """Positions, normals and areas, padded so that few programs occur."""

        def moved() -> Float[Array, "7 s"]:
            spare = -len(self.area) % _FRAGMENTS
            columns = np.stack([*self.position, *self.normal, self.area])
            return device_array(np.pad(columns, ((0, 0), (0, spare))))

        return found((self,), "columns", moved)

    def _read(self, call: _RunningCall) -> _PointRange:
        """Wait for a call; its pairs with a weight."""
        weight = np.asarray(call.weight)[: len(call.run)]
        has_weight = np.flatnonzero(weight)
        weight = weight[has_weight]
        near = _Neighbours(
            owner=call.run[has_weight] // 9,
            fragment=self.facing(np.asarray(call.slot)[has_weight], weight),
            weight=np.abs(weight),
        )
        return _PointRange(call.start, call.stop, near)


@jax.jit
def _pair_weights(
    run: Int[Array, " n"],
    base: Int[Array, " r"],
    points: Float[Array, "9 p"],
    fragments: Float[Array, "7 s"],
    least_cosine: Float[Array, ""],
) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """Slots of the fragments of pairs, and their weights: `FragmentCells.weighted`.

    A weight of the back of a wall is negative. Columns are positions, normals, and
    areas; of points, squares of the radius, heights, and 1 on walls. A pair belongs to
    one of the nine runs of successive slots of its point; `base` plus the number of the
    pair is its slot.
    """
    slot = base[run] + jnp.arange(run.size, dtype=np.int32)
    # Unsigned, since a division of signed integers dominates the program.
    owner = (run.astype(np.uint32) // np.uint32(9)).astype(np.int32)
    squared = jnp.zeros(())
    between = jnp.zeros(())
    height = jnp.zeros(())
    for axis in range(3):
        away = points[axis][owner] - fragments[axis][slot]
        normal = points[3 + axis][owner]
        squared += away * away
        between += normal * fragments[3 + axis][slot]
        height += normal * away
    fade = jnp.maximum(1 - squared / points[6][owner], 0)
    cosine = jnp.where(points[8][owner] > 0, jnp.abs(between), between)
    counts = (cosine > least_cosine) & (jnp.abs(height) < points[7][owner])
    signed = (fade * cosine) ** 2 * fragments[6][slot] * jnp.sign(between)
    return slot, jnp.where(counts, signed, 0)


def cells_of(shapes: Shapes, radius: float) -> FragmentCells:
    """Cells of fragments for a radius [voxels], the same for all views of shapes."""
    key = "fragment_cells", radius
    return found((shapes,), key, lambda: FragmentCells(shapes, radius))
