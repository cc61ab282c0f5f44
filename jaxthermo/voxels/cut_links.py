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

from ..arrays import sorted_union


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
    """Cells on the six sides of voxels, [voxel, axis, below or above]."""

    there: Bool[np.ndarray, "m 3 2"]
    """True where there is a cell."""
    excess: Float[np.ndarray, "m 3 2"]
    """theta - 1/2; 0 without a cell."""
    normal: Float[np.ndarray, "m 3 2 3"]


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
    # One integer for each link, of its first voxel and its kind: many times faster to
    # sort than pairs of voxels, and half as large.
    keys, extras, reach = [], [], lattice.reach
    for found in (_open_areas(flat, section, lattice), _slivers(flat, sides, lattice)):
        for first, second, extra in found:
            low, apart = np.minimum(first, second), np.abs(second - first)
            keys.append(low * len(reach) + np.searchsorted(reach, apart))
            extras.append(extra)
    key, link = np.unique(np.concatenate(keys), return_inverse=True)
    extra = np.bincount(link.reshape(-1), np.concatenate(extras), len(key))
    del keys, extras, link
    low, kind = np.divmod(key, len(reach))
    is_face = np.isin(reach, lattice.jumps)[kind]
    whole = np.where(is_face, 1, 0)
    extra = np.maximum(whole + extra, whole * _MIN_OPEN) - whole
    kept = np.flatnonzero(np.abs(extra) > WHOLE)
    low, apart = low[kept], reach[kind[kept]]
    cells = _cells(low, padded.shape)
    step = (_cells(low + apart, padded.shape) - cells).astype(np.int8)
    return CutLinks(cells - np.int32(1), step, extra[kept])


def _cells(flat: Int[np.ndarray, " e"], shape: tuple[int, ...]) -> np.ndarray:
    """Cells of a lattice by their places in a row, in 32 bits."""
    along = np.unravel_index(flat, shape)
    return np.stack([index.astype(np.int32) for index in along], axis=1)


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


_Found = Iterator[
    tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"], Float[np.ndarray, " e"]]
]


def _open_areas(
    flat: Int[np.ndarray, " m"], section: Float[np.ndarray, "m 3"], lattice: _Lattice
) -> _Found:
    """Links over faces: the mean of the sections of both ends."""
    for axis, jump in enumerate(lattice.jumps):
        low = sorted_union(flat, flat - jump)
        low = low[lattice.solid[low] & lattice.solid[low + jump]]
        ends = [_of_cut(flat, section[:, axis], end, 1.0) for end in (low, low + jump)]
        yield low, low + jump, (ends[0] + ends[1]) / 2 - 1


def _of_cut(
    flat: Int[np.ndarray, " m"],
    values: Float[np.ndarray, " m"],
    cell: Int[np.ndarray, " k"],
    otherwise: float,
) -> Float[np.ndarray, " k"]:
    """Values of cells among the cut voxels, another one for all others."""
    index = np.searchsorted(flat, cell)
    is_cut = np.append(flat, -1)[index] == cell
    return np.where(is_cut, np.append(values, otherwise)[index], otherwise)


def _slivers(flat: Int[np.ndarray, " m"], sides: Sides, lattice: _Lattice) -> _Found:
    """Links over concave edges, and the changes of the links beside them."""
    signs = product((0, 1), (0, 1))
    for (a, b), (i, j) in product(combinations(range(3), 2), list(signs)):
        to_a = lattice.jumps[a] * (2 * i - 1)
        to_b = lattice.jumps[b] * (2 * j - 1)
        one = np.flatnonzero(sides.there[:, a, i])
        third, second = flat[one] - to_b, flat[one] + to_a - to_b
        two = np.searchsorted(flat, second)
        kept = np.append(flat, -1)[two] == second
        kept &= lattice.solid[third]
        kept[kept] = sides.there[two[kept], b, j]
        one, two, third = one[kept], two[kept], third[kept]
        normals = sides.normal[one, a, i], sides.normal[two, b, j]
        smooth = (normals[0] * normals[1]).sum(axis=1) > _SMOOTH
        mean = normals[0] + normals[1]
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), WHOLE)
        n_a, n_b = np.abs(mean[:, a]), np.abs(mean[:, b])
        width = sides.excess[one, a, i] * n_a + sides.excess[two, b, j] * n_b
        width = np.maximum(width / 2 + (n_a + n_b) / 4, 0)
        squared = np.maximum(n_a**2 + n_b**2, WHOLE)
        scale = np.where(smooth, width * (n_a + n_b) / squared, 0)
        first, second = flat[one], flat[two]
        yield first, second, scale * n_a * n_b
        yield first, third, scale * n_a * (n_a - n_b)
        yield second, third, scale * n_b * (n_b - n_a)
