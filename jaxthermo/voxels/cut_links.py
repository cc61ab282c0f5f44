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

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import stable_order


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
        return np.abs(self.step).sum(axis=1) == 2

    def chosen(self, which: np.ndarray) -> "CutLinks":
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
    voxel: Int[np.ndarray, "m 3"],
    section: Float[np.ndarray, "m 3"],
    sides: Sides,
    solid: Bool[np.ndarray, "x y z"],
) -> CutLinks:
    """Links of cut voxels, in lattice order, from their sections across each axis."""
    padded = np.pad(solid, 1)
    lattice = _Lattice(padded.reshape(-1), padded.shape)
    flat = np.asarray(np.ravel_multi_index(tuple(voxel.T + 1), padded.shape))
    slivers = [_slivers(flat, sides, lattice, edge) for edge in _EDGES]
    # What they add to the links of each cut voxel, [axis, to below or above].
    beside = np.zeros((3, 2, len(flat)))
    for ((a, b), (i, j)), found in zip(_EDGES, slivers, strict=True):
        beside[b, 1 - j, found.one] += found.from_one
        beside[a, 1 - i, found.two] += found.from_two
    parts = []
    for axis in range(3):
        parts += _open_areas(flat, section, beside, lattice, axis)
    del beside
    parts += [
        _over_edges(flat, found, lattice, edge)
        for edge, found in zip(_EDGES, slivers, strict=True)
    ]
    del slivers
    reach = lattice.reach
    kept = [np.flatnonzero(np.abs(part.extra) > WHOLE) for part in parts]
    extra = np.concatenate([p.extra[k] for p, k in zip(parts, kept, strict=True)])
    # One integer for each link, of its first voxel and its kind: many times faster to
    # sort than pairs of voxels, and half as large.
    key = np.concatenate(
        [
            part.low[own] * len(reach) + np.searchsorted(reach, part.apart)
            for part, own in zip(parts, kept, strict=True)
        ]
    )
    del parts, kept
    order = stable_order(key)
    low, kind = np.divmod(key[order], len(reach))
    del key
    cells = np.empty((len(low), 3), np.int32)
    for axis, jump in enumerate(lattice.jumps):
        cells[:, axis], low = np.divmod(low, jump)
    cells -= np.int32(1)
    steps = np.array([_step(apart, lattice) for apart in reach.tolist()], np.int8)
    return CutLinks(cells, steps[kind], extra[order])


class _Lattice(NamedTuple):
    """Solid voxels with a rim, in one row."""

    solid: Bool[np.ndarray, " c"]
    shape: tuple[int, ...]

    @property
    def jumps(self) -> tuple[int, int, int]:
        """From a voxel to the next along x, y, z."""
        _, y, z = self.shape
        return y * z, z, 1

    @property
    def reach(self) -> Int[np.ndarray, " k"]:
        """Jumps over faces and edges, increasing."""
        pairs = combinations(self.jumps, 2)
        over_edges = (each for a, b in pairs for each in (a + b, a - b))
        return np.unique([*self.jumps, *over_edges])


def _step(apart: int, lattice: _Lattice) -> tuple[int, ...]:
    """Cells along x, y and z of a jump over a face or an edge."""
    steps = product((-1, 0, 1), repeat=3)
    return next(s for s in steps if np.dot(s, lattice.jumps) == apart)


_Edge = tuple[tuple[int, int], tuple[int, int]]
_EDGES: tuple[_Edge, ...] = tuple(
    product(combinations(range(3), 2), product((0, 1), (0, 1)))
)
"""Two axes, and the side of the body across each: below or above."""


class _Part(NamedTuple):
    """Links of one direction, each once."""

    low: Int[np.ndarray, " e"]
    """First voxel of each."""
    apart: int
    """From there to the other one."""
    extra: Float[np.ndarray, " e"]


def _open_areas(
    flat: Int[np.ndarray, " m"],
    section: Float[np.ndarray, "m 3"],
    beside: Float[np.ndarray, "3 2 m"],
    lattice: _Lattice,
    axis: int,
) -> tuple[_Part, _Part]:
    """Links over faces across one axis: the mean of the sections of both ends."""
    jump, own_section = lattice.jumps[axis], np.append(section[:, axis], 1.0)
    to_below, to_above = np.append(beside[axis], np.zeros((2, 1)), axis=1)
    # Those to the voxel above: solid voxels that are not cut have whole sections.
    own = np.flatnonzero(lattice.solid[flat + jump])
    above = np.searchsorted(flat, flat[own] + jump)
    is_cut = np.append(flat, -1)[above] == flat[own] + jump
    above[~is_cut] = len(flat)
    upper = (own_section[own] + own_section[above]) / 2 - 1
    upper += to_above[own] + to_below[above]
    # Those to a voxel below that is not cut.
    is_below = lattice.solid[flat - jump]
    is_below[above[is_cut]] = False
    rest = np.flatnonzero(is_below)
    lower = (1 + own_section[rest]) / 2 - 1 + to_below[rest]
    limited = lambda extra: np.maximum(1 + extra, _MIN_OPEN) - 1
    return (
        _Part(flat[own], jump, limited(upper)),
        _Part(flat[rest] - jump, jump, limited(lower)),
    )


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


def _slivers(
    flat: Int[np.ndarray, " m"], sides: Sides, lattice: _Lattice, edge: _Edge
) -> _Slivers:
    (a, b), (i, j) = edge
    to_a = lattice.jumps[a] * (2 * i - 1)
    to_b = lattice.jumps[b] * (2 * j - 1)
    one = np.flatnonzero(sides.cell[a, i] >= 0)
    third = flat[one] - to_b
    # Few have an edge: those are searched.
    one = one[lattice.solid[third] & lattice.solid[third + to_a]]
    second = flat[one] - to_b + to_a
    two = np.searchsorted(flat, second)
    kept = np.append(flat, -1)[two] == second
    kept[kept] = sides.cell[b, j, two[kept]] >= 0
    one, two = one[kept], two[kept]
    cells = sides.cell[a, i, one], sides.cell[b, j, two]
    normals = sides.normal[cells[0]], sides.normal[cells[1]]
    smooth = (normals[0] * normals[1]).sum(axis=1) > _SMOOTH
    mean = normals[0] + normals[1]
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), WHOLE)
    n_a, n_b = np.abs(mean[:, a]), np.abs(mean[:, b])
    width = sides.excess[cells[0]] * n_a + sides.excess[cells[1]] * n_b
    width = np.maximum(width / 2 + (n_a + n_b) / 4, 0)
    squared = np.maximum(n_a**2 + n_b**2, WHOLE)
    scale = np.where(smooth, width * (n_a + n_b) / squared, 0)
    beside = scale * n_a * (n_a - n_b), scale * n_b * (n_b - n_a)
    return _Slivers(one, two, scale * n_a * n_b, *beside)


def _over_edges(
    flat: Int[np.ndarray, " m"], found: _Slivers, lattice: _Lattice, edge: _Edge
) -> _Part:
    # An edge has one sliver: of the voxels around it one is empty, the third solid.
    (a, b), (i, j) = edge
    apart = lattice.jumps[a] * (2 * i - 1) - lattice.jumps[b] * (2 * j - 1)
    low = flat[found.one if apart > 0 else found.two]
    return _Part(low, abs(apart), found.over)
