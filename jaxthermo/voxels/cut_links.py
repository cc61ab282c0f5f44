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
from itertools import chain, combinations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import flat_index, sorted_with_order
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
    """Step from the first voxel to the second: along one axis, or over an edge."""
    extra: Float[np.ndarray, " e"]
    """Conductance over k h, less that of a whole face if there is one [-]."""

    @property
    def over_edge(self) -> Bool[np.ndarray, " e"]:
        """True for links between voxels that share no face."""
        # Column by column: numpy is slow along an axis of length three.
        x, y, z = (self.step != 0).T
        return (x & y) | (y & z) | (z & x)

    def selected(self, which: np.ndarray | slice) -> "CutLinks":
        """Select links by mask, slice or index."""
        return CutLinks(*(column[which] for column in self))

    def within(self, planes: slice) -> "CutLinks":
        """Links between voxels in a range of planes along x, counted from its first."""
        first = self.voxel[:, 0]
        inside = (first >= planes.start) & (first + self.step[:, 0] < planes.stop)
        links = self.selected(np.flatnonzero(inside))
        return links._replace(voxel=links.voxel - np.array([planes.start, 0, 0]))

    def open_across(
        self, flat: Int[np.ndarray, " m"], shape: tuple[int, ...], axis: int
    ) -> Float[np.ndarray, " m"]:
        """Open area of the links of voxels to their next neighbours along an axis.

        `flat` has the indices of the voxels in a lattice of that shape, ascending.
        """
        across = np.flatnonzero((self.step[:, axis] == 1) & ~self.over_edge)
        cut = flat_index(self.voxel[across], shape)
        index = np.asarray(np.searchsorted(flat, cut))
        is_listed = np.flatnonzero(np.append(flat, -1)[index] == cut)
        area = np.ones(len(flat))
        area[index[is_listed]] += self.extra[across[is_listed]]
        return area


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

    `number` has the numbers of the voxels in `VoxelBits`, ascending.
    """
    voxels = _Voxels(
        number=number,
        index=VoxelIndex(VoxelBits.listed(solid.shape, number)),
        solid=VoxelBits.of(solid),
    )
    slivers = list(_slivers(sides, voxels))
    # One integer for each link, from its first voxel and its step: it sorts faster
    # than a pair of voxels, and is half as large.
    reach = voxels.reach
    largest = len(reach) * 64 * voxels.solid.word.size
    small = np.int32 if largest < 2**31 else np.int64
    keys = []
    extras = []
    for low, apart, extra in _links(section, slivers, voxels):
        significant = np.flatnonzero(np.abs(extra) > WHOLE)
        key = low[significant] * len(reach) + np.searchsorted(reach, apart)
        keys.append(key.astype(small))
        extras.append(extra[significant])
    # The largest arrays follow.
    del slivers, low, extra, significant
    key, order = sorted_with_order(_joined(keys))
    extra = _joined(extras)[order]
    del order
    low = key // len(reach)
    key -= low * len(reach)
    step_index = key.astype(np.int8)
    del key
    step = np.array([_step(apart, voxels) for apart in reach.tolist()], np.int8)
    return CutLinks(voxel=voxels.solid.voxels(low), step=step[step_index], extra=extra)


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    """Concatenate a list of arrays and empty it, so that none is in memory twice."""
    joined = np.concatenate(arrays)
    arrays.clear()
    return joined


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
        over_edges = [(a + b, a - b) for a, b in pairs]
        return np.unique([*self.jumps, *chain.from_iterable(over_edges)])


def _step(apart: int, voxels: _Voxels) -> tuple[int, ...]:
    """Cells along x, y and z of a jump over a face or an edge."""
    steps = product((-1, 0, 1), repeat=3)
    return next(s for s in steps if np.dot(s, voxels.jumps) == apart)


_Edge = tuple[tuple[int, int], tuple[int, int]]
_EDGES: tuple[_Edge, ...] = tuple(
    product(combinations(range(3), 2), product((0, 1), (0, 1)))
)
"""Two axes, and the side of the body across each: below or above."""


class _LinksAlong(NamedTuple):
    """Links of one direction."""

    low: Int[np.ndarray, " e"]
    """Number of the first voxel of each link."""
    jump: int
    """Difference of numbers from the first voxel to the second."""
    extra: Float[np.ndarray, " e"]
    """Conductance over k h, less that of a whole face if there is one [-]."""


def _links(
    section: Float[np.ndarray, "m 3"], slivers: list["_Slivers"], voxels: _Voxels
) -> Iterator[_LinksAlong]:
    """Links of all directions, each once."""
    for axis in range(3):
        # What slivers add to the links of each cut voxel with the one below and above;
        # the last column, of voxels that are not cut, stays zero.
        sliver_extra = np.zeros((2, len(section) + 1))
        for ((a, b), (i, j)), sliver in zip(_EDGES, slivers, strict=True):
            if b == axis:
                sliver_extra[1 - j, sliver.voxel_1] += sliver.from_1
            if a == axis:
                sliver_extra[1 - i, sliver.voxel_2] += sliver.from_2
        # Voxels that are not cut have whole sections.
        yield from _open_areas(
            np.append(section[:, axis], 1.0),
            sliver_extra=sliver_extra,
            voxels=voxels,
            axis=axis,
        )
    for ((a, b), (i, j)), sliver in zip(_EDGES, slivers, strict=True):
        # An edge has one sliver: of the voxels around it one is empty, the third solid.
        apart = voxels.jumps[a] * (2 * i - 1) - voxels.jumps[b] * (2 * j - 1)
        low = voxels.number[sliver.voxel_1 if apart > 0 else sliver.voxel_2]
        yield _LinksAlong(low=low, jump=abs(apart), extra=sliver.over)


def _open_areas(
    section: Float[np.ndarray, " j"],
    sliver_extra: Float[np.ndarray, "2 j"],
    voxels: _Voxels,
    axis: int,
) -> Iterator[_LinksAlong]:
    """Links over faces across one axis: the mean of the sections of both ends."""
    number = voxels.number
    jump = voxels.jumps[axis]
    to_below, to_above = sliver_extra
    # Links to the voxel above.
    has_upper = np.flatnonzero(voxels.solid.has(number, jump))
    above, is_cut = voxels.index.at(number[has_upper] + jump)
    above[~is_cut] = len(number)
    upper = (section[has_upper] + section[above]) / 2 - 1
    upper += to_above[has_upper] + to_below[above]
    yield _LinksAlong(low=number[has_upper], jump=jump, extra=_limited(upper))
    # Links to a voxel below that is not cut.
    is_below = voxels.solid.has(number, -jump)
    is_below[above[is_cut]] = False
    has_lower = np.flatnonzero(is_below)
    lower = (1 + section[has_lower]) / 2 - 1 + to_below[has_lower]
    yield _LinksAlong(low=number[has_lower] - jump, jump=jump, extra=_limited(lower))


def _limited(extra: Float[np.ndarray, " e"]) -> Float[np.ndarray, " e"]:
    """Extra conductances of links whose open area is not below the smallest one."""
    return np.maximum(1 + extra, _MIN_OPEN) - 1


class _Slivers(NamedTuple):
    """Slivers over concave edges of one direction."""

    voxel_1: Int[np.ndarray, " k"]
    """Index of voxel 1 among the cut voxels."""
    voxel_2: Int[np.ndarray, " k"]
    """Index of voxel 2 among the cut voxels."""
    over: Float[np.ndarray, " k"]
    """Conductance from voxel 1 to 2 over k h [-]."""
    from_1: Float[np.ndarray, " k"]
    """Conductance from voxel 1 to 3 over k h [-]."""
    from_2: Float[np.ndarray, " k"]
    """Conductance from voxel 2 to 3 over k h [-]."""


def _slivers(sides: Sides, voxels: _Voxels) -> Iterator[_Slivers]:
    """Slivers over edges of all directions."""
    sided = [[np.flatnonzero(cell >= 0) for cell in cells] for cells in sides.cell]
    for (a, b), (i, j) in _EDGES:
        to_a = voxels.jumps[a] * (2 * i - 1)
        to_b = voxels.jumps[b] * (2 * j - 1)
        first = sided[a][i]
        # Few voxels have an edge: the search starts with those.
        second_number = voxels.number[first] + (to_a - to_b)
        valid = np.flatnonzero(voxels.solid.has(second_number))
        first = first[valid]
        second_number = second_number[valid]
        valid = np.flatnonzero(voxels.solid.has(second_number, -to_a))
        first = first[valid]
        second_number = second_number[valid]
        second, is_cut = voxels.index.at(second_number)
        valid = np.flatnonzero(is_cut)
        valid = valid[sides.cell[b, j, second[valid]] >= 0]
        first = first[valid].astype(np.int32)
        second = second[valid].astype(np.int32)
        yield _slivers_between(
            sides,
            axes=(a, b),
            voxels=(first, second),
            cells=(sides.cell[a, i, first], sides.cell[b, j, second]),
        )


def _slivers_between(
    sides: Sides,
    axes: tuple[int, int],
    voxels: tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]],
    cells: tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]],
) -> _Slivers:
    """Slivers between voxels 1 and 2, from the cells of these across two axes."""
    normal_1, normal_2 = (sides.normal.take(cell, axis=0) for cell in cells)
    smooth = np.einsum("ki,ki->k", normal_1, normal_2) > _SMOOTH
    mean = normal_1 + normal_2
    length = np.maximum(np.sqrt(np.einsum("ki,ki->k", mean, mean)), WHOLE)
    n_a, n_b = (np.abs(mean[:, axis]) / length for axis in axes)
    width = sides.excess[cells[0]] * n_a + sides.excess[cells[1]] * n_b
    width = np.maximum(width / 2 + (n_a + n_b) / 4, 0)
    squared = np.maximum(n_a**2 + n_b**2, WHOLE)
    scale = np.where(smooth, width * (n_a + n_b) / squared, 0)
    voxel_1, voxel_2 = voxels
    return _Slivers(
        voxel_1=voxel_1,
        voxel_2=voxel_2,
        over=scale * n_a * n_b,
        from_1=scale * n_a * (n_a - n_b),
        from_2=scale * n_b * (n_b - n_a),
    )
