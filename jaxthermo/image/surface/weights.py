"""Fragments near points of a surface, and their weights in values at the points.

The value at a point is a weighted mean of the fragments within a radius R, with
weights (1 - r^2/R^2)^2 times the fragment's area and the squared cosine between the
normals, so that nothing leaks through a thin sheet or around an edge.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from ...arrays import device_array
from ...geometry.vectors import row_dot
from ...memo.found import found
from .linear_weights import linear_weights
from .shapes import ShapePoints, Shapes


SMOOTHING_RADIUS = 2.0
"""Radius of the weights [voxels]; from 1.4 it includes a fragment of any surface."""

MAX_HEIGHT = 0.5
"""Distance from the plane of a point beyond which fragments of a thin wall have no
weight [cells]."""

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


class Neighbours(NamedTuple):
    """Pairs of a point and a fragment near it with a weight above 0."""

    owner: Int[np.ndarray, " w"]
    """Index of the point, ascending."""
    fragment: Int[np.ndarray, " w"]
    weight: Float[np.ndarray, " w"]
    """Weight before normalization [m^2]."""


class _CellPairs(NamedTuple):
    """Pairs of a point and a fragment in the same or in adjacent cells."""

    owner: Int[np.ndarray, " w"]
    """Index of the point, ascending."""
    fragment: Int[np.ndarray, " w"]
    slot: Int[np.ndarray, " w"]
    """Position of the fragment in the order of the cells."""


class _PointRange(NamedTuple):
    """Successive points with the fragments that have a weight there."""

    start: int
    stop: int
    near: Neighbours


class _RunningCall(NamedTuple):
    """A call of the program for successive points, of which results are awaited."""

    start: int
    stop: int
    run: Int[np.ndarray, " n"]
    """Run of each pair."""
    slot: Int[Array, " n"]
    weight: Float[Array, " n"]


class _FragmentCells:
    """Fragments sorted into flat cells, whose width is the radius of the weights.

    Each shape has cells of its own.
    """

    def __init__(self, shapes: Shapes, radius: float):
        position = shapes.fragment_position
        shape = shapes.of_fragment
        first = shapes.first_fragment
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
        self.order = np.argsort(key, kind="stable").astype(np.int32)
        self.keys = key[self.order]
        # Columns in the order of the cells, so that neighbours are close in memory.
        self.position = np.ascontiguousarray(position[self.order].T)
        self.normal = np.ascontiguousarray(shapes.fragment_normal[self.order].T)
        self.area = shapes.fragment_area[self.order]
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
        return _CellPairs(owner=owner, fragment=self.order[slot], slot=slot)

    def weighted(self, points: ShapePoints) -> Neighbours:
        """Fragments with a weight at each point: few points, or the reference."""
        owner, _, slot = self.pairs(points)
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
        cosine = np.zeros(len(owner))
        for along, fragment_column in zip(points.normal.T, self.normal, strict=True):
            cosine += along[owner] * fragment_column[slot]
        fade = 1 - squared[near] / square[owner]
        weight = (fade * np.maximum(cosine, 0)) ** 2 * self.area[slot]
        positive = np.flatnonzero(weight > 0)
        slot = slot[positive]
        return Neighbours(owner[positive], self.order[slot], weight[positive])

    def _square(self, points: ShapePoints) -> Float[np.ndarray, " p"]:
        """Square of the radius at each point [m^2]."""
        return (self.radius * self.radius)[points.shape]

    def means(
        self,
        points: ShapePoints,
        select: Callable[[Neighbours], np.ndarray] | None = None,
        otherwise: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> csr_array:
        """Weights [p, s] that add up to 1 at every point with a fragment near it.

        Args:
            points: with their normals.
            select: numbers of the pairs that count; all of them if None.
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
        ranges = self._ranges_of_points(points, first=first, count=count, ends=ends)
        for start, stop, near in ranges:
            owner, fragment, weight = near
            if select is not None:
                selected = select(Neighbours(owner + start, fragment, weight))
                owner = owner[selected]
                fragment = fragment[selected]
                weight = weight[selected]
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
        size = len(count), len(self.area)
        return csr_array((weights, columns, starts), size)

    def _ranges_of_points(
        self,
        points: ShapePoints,
        first: np.ndarray,
        count: np.ndarray,
        ends: np.ndarray,
    ) -> Iterator[_PointRange]:
        """Ranges that cover all points, with the fragments near them."""
        total = len(count)
        if total <= CHUNK:
            yield _PointRange(0, total, self.weighted(points))
            return
        columns = np.concatenate(
            [points.position.T, points.normal.T, self._square(points)[None]]
        )
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
        self, columns: np.ndarray, first: np.ndarray, count: np.ndarray, start: int
    ) -> _RunningCall:
        """Start the program for the points of columns [7, p], from number `start`."""
        run = np.repeat(np.arange(len(count), dtype=np.int32), count)
        padded = np.zeros(max(_PAIRS, len(run)), np.int32)
        padded[: len(run)] = run
        base = np.zeros(9 * _POINTS, np.int32)
        base[: len(count)] = first - np.cumsum(count) + count
        points = np.ones((7, _POINTS))
        size = columns.shape[1]
        points[:, :size] = columns
        with jax.enable_x64(True):
            slot, weight = _pair_weights(
                padded,
                base=base,
                points=points,
                fragments=self._on_device(),
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
        positive = np.flatnonzero(weight > 0)
        near = Neighbours(
            owner=call.run[positive] // 9,
            fragment=self.order[np.asarray(call.slot)[positive]],
            weight=weight[positive],
        )
        return _PointRange(call.start, call.stop, near)


@jax.jit
def _pair_weights(
    run: Int[Array, " n"],
    base: Int[Array, " r"],
    points: Float[Array, "7 p"],
    fragments: Float[Array, "7 s"],
) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """Slots of the fragments of pairs, and their weights: `_FragmentCells.weighted`.

    Columns are positions, normals, and squares of the radius or areas. A pair belongs
    to one of the nine runs of successive slots of its point; `base` plus the number of
    the pair is its slot.
    """
    slot = base[run] + jnp.arange(run.size, dtype=np.int32)
    # Unsigned, since a division of signed integers dominates the program.
    owner = (run.astype(np.uint32) // np.uint32(9)).astype(np.int32)
    squared = jnp.zeros(())
    cosine = jnp.zeros(())
    for axis in range(3):
        away = points[axis][owner] - fragments[axis][slot]
        squared += away * away
        cosine += points[3 + axis][owner] * fragments[3 + axis][slot]
    fade = jnp.maximum(1 - squared / points[6][owner], 0)
    return slot, (fade * jnp.maximum(cosine, 0)) ** 2 * fragments[6][slot]


def cells_of(shapes: Shapes, radius: float) -> _FragmentCells:
    """Cells of fragments for a radius [voxels], the same for all views of shapes."""
    key = "fragment_cells", radius
    return found((shapes,), key, lambda: _FragmentCells(shapes, radius))


def _nearest_fragments(points: ShapePoints, shapes: Shapes) -> Int[np.ndarray, " p"]:
    # Of a solid with any normal, of a thin wall on the side of the point. Only points
    # without a fragment in range search twice as far.
    nearest = np.full(len(points.shape), -1, np.int64)
    is_wall = shapes.is_two_sided[points.shape]
    radius = 1.0
    while (missing := np.flatnonzero(nearest < 0)).size:
        radius *= 2
        cells = cells_of(shapes, radius)
        for chunk in np.array_split(missing, len(missing) // CHUNK + 1):
            owner, fragment, _ = cells.pairs(points.some(chunk))
            point = chunk[owner]
            if is_wall.any():
                normal = points.normal[point]
                # A triangle without area has no normal.
                fits = ~is_wall[point] | ~normal.any(axis=1)
                fits |= row_dot(normal, shapes.fragment_normal[fragment]) > 0
                point = point[fits]
                fragment = fragment[fits]
            offset = points.position[point] - shapes.fragment_position[fragment]
            distance = row_dot(offset, offset)
            order = np.lexsort([distance, point])
            first_of, first = np.unique(point[order], return_index=True)
            nearest[first_of] = fragment[order][first]
    return nearest


def smooth_weights(points: ShapePoints, shapes: Shapes) -> csr_array:
    """Weights [p, s] of the fragments of shapes at each point."""
    cells = cells_of(shapes, SMOOTHING_RADIUS)
    is_wall = shapes.is_two_sided[points.shape]

    # Parts too thin to have fragments show the nearest ones.
    def nearest(alone: np.ndarray) -> Int[np.ndarray, " n"]:
        return _nearest_fragments(points.some(alone), shapes)

    if not is_wall.any():
        return cells.means(points, otherwise=nearest)
    reach = np.where(is_wall, MAX_HEIGHT * shapes.pitch[points.shape], np.inf)
    normals = np.ascontiguousarray(points.normal.T)
    positions = np.ascontiguousarray(shapes.fragment_position.T)
    plane = row_dot(points.position, points.normal)

    # Another leaf of a wall may be near, with the same normal.
    def level(pairs: Neighbours) -> Int[np.ndarray, " n"]:
        height = -plane[pairs.owner]
        # Column by column: numbers that are read together are close in memory.
        for normal, position in zip(normals, positions, strict=True):
            height += normal[pairs.owner] * position[pairs.fragment]
        return np.flatnonzero(np.abs(height) < reach[pairs.owner])

    return linear_weights(
        cells.means(points, select=level, otherwise=nearest),
        rows=np.flatnonzero(is_wall),
        points=points.position,
        normals=points.normal,
        position=shapes.fragment_position,
        radius=cells.radius[points.shape],
    )


def nearest_weights(points: ShapePoints, shapes: Shapes) -> csr_array:
    """Weights [p, s] of the nearest fragment alone, which show the voxels."""
    nearest = _nearest_fragments(points, shapes)
    starts = np.arange(len(nearest) + 1)
    size = len(nearest), len(shapes.fragment_area)
    return csr_array((np.ones(len(nearest)), nearest, starts), size)


class MovingWeights(eqx.Module):
    """Weights of the fragments at p points, linear in how far each point moves.

        w(u) = w + u_1 dw/du_1 + u_2 dw/du_2,

    with the distances u along two directions of the surface [m].
    """

    row: Int[Array, " n"]
    """Index of the point of each weight, ascending."""
    fragment: Int[Array, " n"]
    weight: Float[Array, " n"]
    slope: Float[Array, "2 n"]
    """Change of the weight along both directions [1/m]."""
    shift: Float[Array, "p 2"]
    """Distances u that the points have moved [m]."""

    @property
    def moved_weight(self) -> Float[Array, " n"]:
        """Weights w(u) where the points are."""
        return self.weight + (self.shift[self.row] * self.slope.T).sum(axis=1)


def weighted_means(
    weights: csr_array | MovingWeights, values: Array | np.ndarray
) -> Array | np.ndarray:
    """Weighted means of the fragments of each row, [s, ...] to [p, ...]."""
    if isinstance(weights, MovingWeights):
        row = weights.row
        fragment = weights.fragment
        weight = weights.moved_weight
        count = len(weights.shift)
        values = jnp.asarray(values)
    elif isinstance(values, np.ndarray):
        return (weights @ values).astype(values.dtype, copy=False)
    else:
        count = len(weights.indptr) - 1
        row = np.repeat(np.arange(count), np.diff(weights.indptr))
        fragment = weights.indices
        weight = jnp.asarray(weights.data, values.dtype)
    weight = weight.reshape(-1, *(1,) * (values.ndim - 1))
    # The rows of the weights are sorted, which lets XLA sum without scattering.
    return jax.ops.segment_sum(
        weight * values[fragment], row, count, indices_are_sorted=True
    )
