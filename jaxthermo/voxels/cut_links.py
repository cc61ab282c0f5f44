"""Links between voxels that the surface cuts: open areas, and slivers beside the steps.

A link over a face has an open area: 1 and, for each sheet of surface along it, the mean
of (theta - 1/2) of both ends (see `cut_geometry`). What a linear temperature along the
surface conducts between the steps of the voxels and the surface is missing there. It
passes every concave edge of the steps, between the voxels 1 = E - a and 2 = E - b
beside an empty voxel E, over the sliver from that edge to the surface,

    w = (theta_1 - 1/2) |n_a| + |n_b| / 2 = (theta_2 - 1/2) |n_b| + |n_a| / 2   [voxels]

wide, along the normal n. Its dissipation k h w (|n_a| + |n_b|) (v . T)^2 has only the
gradient along the surface, found from the two voxels and voxel 3 = E - a - b between
them: v = (-|n_a|, |n_b|, |n_a| - |n_b|) / sqrt(n_a^2 + n_b^2). That is a link over the
edge, and a change of both links of voxel 3. Rods at any slant then conduct what they
should, and a gradient along the normal conducts no more than before.
"""

from collections.abc import Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import sorted_with_order
from .voxel_bits import VoxelBits, VoxelIndex


# Smallest open area [voxel faces]: a link through a sliver of nothing still conducts.
_MIN_OPEN = 0.05

# Differences below this are those of rounding [voxel faces].
WHOLE = 1e-12

# Smallest cosine between the normals of two cells of one smooth surface [-].
_SMOOTH = 0.5


class CutLinks(NamedTuple):
    """Links that are not those of whole voxels, in lattice order."""

    voxel: Int[np.ndarray, "e 3"]
    """First voxel of each link in lattice order."""
    step: Int[np.ndarray, "e 3"]
    """From there to the other one: along one axis, or over an edge."""
    extra: Float[np.ndarray, " e"]
    """Conductance over k h, less that of a whole face if there is one [-]."""

    @property
    def over_edge(self) -> Bool[np.ndarray, " e"]:
        """True for links between voxels that share no face."""
        # Column by column: numpy is slow along an axis of length three.
        x, y, z = (self.step != 0).T
        return (x & y) | (y & z) | (z & x)

    def chosen(self, which: np.ndarray | slice) -> "CutLinks":
        """Some of them."""
        return CutLinks(*(column[which] for column in self))

    def within(self, planes: slice) -> "CutLinks":
        """Those between voxels in a range of planes along x, counted from its first."""
        first = self.voxel[:, 0]
        own = (first >= planes.start) & (first + self.step[:, 0] < planes.stop)
        found = self.chosen(np.flatnonzero(own))
        return found._replace(voxel=found.voxel - np.array([planes.start, 0, 0]))

    def open_across(
        self, flat: Int[np.ndarray, " m"], shape: tuple[int, ...], axis: int
    ) -> Float[np.ndarray, " m"]:
        """Open area of the link of some voxels to the next along an axis.

        Their indices in a lattice of that shape ascend.
        """
        own = np.flatnonzero((self.step[:, axis] == 1) & ~self.over_edge)
        cut = np.asarray(np.ravel_multi_index(tuple(self.voxel[own].T), shape))
        at = np.asarray(np.searchsorted(flat, cut))
        there = np.flatnonzero(np.append(flat, -1)[at] == cut)
        found = np.ones(len(flat))
        found[at[there]] += self.extra[own[there]]
        return found


class Sides(NamedTuple):
    """Cells on the six sides of voxels."""

    cell: Int[np.ndarray, "3 2 m"]
    """Number of the cell, [axis, below or above, voxel]; -1 for none."""
    excess: Float[np.ndarray, " s"]
    """theta - 1/2 of each cell."""
    normal: Float[np.ndarray, "s 3"]


def cut_links(
    number: Int[np.ndarray, " m"],
    section: Float[np.ndarray, "m 3"],
    sides: Sides,
    solid: Bool[np.ndarray, "x y z"],
) -> CutLinks:
    """Links of cut voxels, in lattice order, from their sections across each axis.

    `number` is that of each voxel, as of `VoxelBits`, ascending.
    """
    index = VoxelIndex(VoxelBits.listed(solid.shape, number))
    voxels = _Voxels(number, index, VoxelBits.of(solid))
    slivers = list(_slivers(sides, voxels))
    # One integer for each link, of its first voxel and its kind: many times faster to
    # sort than pairs of voxels, and half as large.
    reach = voxels.reach
    largest = len(reach) * 64 * voxels.solid.word.size
    small = np.int32 if largest < 2**31 else np.int64
    keys, extras = [], []
    for low, apart, extra in _links(section, slivers, voxels):
        kept = np.flatnonzero(np.abs(extra) > WHOLE)
        key = low[kept] * len(reach) + np.searchsorted(reach, apart)
        keys.append(key.astype(small))
        extras.append(extra[kept])
    # The largest arrays follow.
    del slivers, low, extra, kept
    key, order = sorted_with_order(_joined(keys))
    extra = _joined(extras)[order]
    del order
    low = key // len(reach)
    key -= low * len(reach)
    kind = key.astype(np.int8)
    del key
    step = np.array([_step(apart, voxels) for apart in reach.tolist()], np.int8)
    return CutLinks(voxels.solid.voxels(low), step[kind], extra)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """All arrays of a list, which is emptied: they would be in memory twice."""
    found = np.concatenate(parts)
    parts.clear()
    return found


class _Voxels(NamedTuple):
    """Cut voxels among the solid ones."""

    number: Int[np.ndarray, " m"]
    index: VoxelIndex
    solid: VoxelBits

    @property
    def jumps(self) -> tuple[int, int, int]:
        """From a voxel to the next along x, y, z."""
        return self.solid.jumps

    @property
    def reach(self) -> Int[np.ndarray, " k"]:
        """Jumps over faces and edges, increasing."""
        pairs = combinations(self.jumps, 2)
        over_edges = (each for a, b in pairs for each in (a + b, a - b))
        return np.unique([*self.jumps, *over_edges])


def _step(apart: int, voxels: _Voxels) -> tuple[int, ...]:
    """Cells along x, y and z of a jump over a face or an edge."""
    steps = product((-1, 0, 1), repeat=3)
    return next(s for s in steps if np.dot(s, voxels.jumps) == apart)


_Edge = tuple[tuple[int, int], tuple[int, int]]
_EDGES: tuple[_Edge, ...] = tuple(
    product(combinations(range(3), 2), product((0, 1), (0, 1)))
)
"""Two axes, and the side of the body across each: below or above."""


_Part = tuple[Int[np.ndarray, " e"], int, Float[np.ndarray, " e"]]
"""First voxels of links, the jump from there to the others, and what is extra."""


def _links(
    section: Float[np.ndarray, "m 3"], slivers: list["_Slivers"], voxels: _Voxels
) -> Iterator[_Part]:
    """Links of all directions, each once."""
    for axis in range(3):
        # What slivers add to the links of each cut voxel, to below and above; none to
        # those of the last, which stands for voxels that are not cut.
        beside = np.zeros((2, len(section) + 1))
        for ((a, b), (i, j)), found in zip(_EDGES, slivers, strict=True):
            if b == axis:
                beside[1 - j, found.one] += found.from_one
            if a == axis:
                beside[1 - i, found.two] += found.from_two
        # Voxels that are not cut have whole sections.
        yield from _open_areas(
            np.append(section[:, axis], 1.0), beside=beside, voxels=voxels, axis=axis
        )
    for ((a, b), (i, j)), found in zip(_EDGES, slivers, strict=True):
        # An edge has one sliver: of the voxels around it one is empty, the third solid.
        apart = voxels.jumps[a] * (2 * i - 1) - voxels.jumps[b] * (2 * j - 1)
        low = voxels.number[found.one if apart > 0 else found.two]
        yield low, abs(apart), found.over


def _open_areas(
    section: Float[np.ndarray, " j"],
    beside: Float[np.ndarray, "2 j"],
    voxels: _Voxels,
    axis: int,
) -> Iterator[_Part]:
    """Links over faces across one axis: the mean of the sections of both ends."""
    number, jump, (to_below, to_above) = voxels.number, voxels.jumps[axis], beside
    limited = lambda extra: np.maximum(1 + extra, _MIN_OPEN) - 1
    # Those to the voxel above.
    own = np.flatnonzero(voxels.solid.has(number, jump))
    above, is_cut = voxels.index.at(number[own] + jump)
    above[~is_cut] = len(number)
    upper = (section[own] + section[above]) / 2 - 1
    upper += to_above[own] + to_below[above]
    yield number[own], jump, limited(upper)
    # Those to a voxel below that is not cut.
    is_below = voxels.solid.has(number, -jump)
    is_below[above[is_cut]] = False
    rest = np.flatnonzero(is_below)
    lower = (1 + section[rest]) / 2 - 1 + to_below[rest]
    yield number[rest] - jump, jump, limited(lower)


class _Slivers(NamedTuple):
    """Slivers over concave edges of one kind."""

    one: Int[np.ndarray, " k"]
    """Index of voxel 1 among the cut voxels."""
    two: Int[np.ndarray, " k"]
    over: Float[np.ndarray, " k"]
    """Conductance from voxel 1 to 2 over k h [-]."""
    from_one: Float[np.ndarray, " k"]
    """The same from voxel 1 to 3."""
    from_two: Float[np.ndarray, " k"]


def _slivers(sides: Sides, voxels: _Voxels) -> Iterator[_Slivers]:
    """Slivers of all kinds of edges."""
    sided = [[np.flatnonzero(cell >= 0) for cell in cells] for cells in sides.cell]
    for (a, b), (i, j) in _EDGES:
        to_a = voxels.jumps[a] * (2 * i - 1)
        to_b = voxels.jumps[b] * (2 * j - 1)
        one = sided[a][i]
        # Few have an edge: those are searched.
        second = voxels.number[one] + (to_a - to_b)
        kept = np.flatnonzero(voxels.solid.has(second))
        one, second = one[kept], second[kept]
        kept = np.flatnonzero(voxels.solid.has(second, -to_a))
        one, second = one[kept], second[kept]
        two, is_cut = voxels.index.at(second)
        kept = np.flatnonzero(is_cut)
        kept = kept[sides.cell[b, j, two[kept]] >= 0]
        one, two = one[kept].astype(np.int32), two[kept].astype(np.int32)
        cells = sides.cell[a, i, one], sides.cell[b, j, two]
        yield _slivers_between(sides, axes=(a, b), voxels=(one, two), cells=cells)


def _slivers_between(
    sides: Sides,
    axes: tuple[int, int],
    voxels: tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]],
    cells: tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]],
) -> _Slivers:
    """Slivers between voxels 1 and 2, from the cells of these across two axes."""
    one, two = (sides.normal.take(cell, axis=0) for cell in cells)
    smooth = np.einsum("ki,ki->k", one, two) > _SMOOTH
    mean = one + two
    length = np.maximum(np.sqrt(np.einsum("ki,ki->k", mean, mean)), WHOLE)
    n_a, n_b = (np.abs(mean[:, axis]) / length for axis in axes)
    width = sides.excess[cells[0]] * n_a + sides.excess[cells[1]] * n_b
    width = np.maximum(width / 2 + (n_a + n_b) / 4, 0)
    squared = np.maximum(n_a**2 + n_b**2, WHOLE)
    scale = np.where(smooth, width * (n_a + n_b) / squared, 0)
    beside = scale * n_a * (n_a - n_b), scale * n_b * (n_b - n_a)
    return _Slivers(*voxels, scale * n_a * n_b, *beside)
