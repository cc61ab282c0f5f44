"""Voxels that the surface cuts: their volumes and links.

Volumes so small that they would shorten explicit steps are raised, and what they gain
is taken from their neighbours: the total stays.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import sorted_union
from .cut_links import CutLinks


_MIN_STEP = 0.72
"""Stable step of any voxel without a load, relative to one with six neighbours [-]."""

MIN_OPEN = 0.05
"""Smallest volume of a voxel and area factor of a cell."""

# Rounds in which volume is taken from neighbours; two are enough but for thin parts.
_ROUNDS = 8

# Missing volume that is left so [voxels].
_ENOUGH = 1e-9


@dataclass(frozen=True, eq=False)
class CutVoxels:
    """Solid voxels that are not whole, in lattice order; all others are."""

    voxel: Int[np.ndarray, "m 3"]
    volume: Float[np.ndarray, " m"]
    """Volume [voxels]."""
    section: Float[np.ndarray, "m 3"]
    """Section of the body in the voxel across x, y, z [voxel faces]."""
    links: CutLinks

    @property
    def is_empty(self) -> bool:
        """True if every voxel and every link is whole."""
        return not len(self.voxel) and not len(self.links.extra)

    def spread(self, solid: Bool[np.ndarray, "x y z"]) -> Float[np.ndarray, " v"]:
        """Volumes of all solid voxels, in lattice order [voxels]."""
        flat = np.flatnonzero(solid)
        own = np.ravel_multi_index(tuple(self.voxel.T), solid.shape)
        found = np.ones(len(flat))
        found[np.searchsorted(flat, own)] = self.volume
        return found

    def within(self, planes: slice) -> "CutVoxels":
        """Those in a range of planes along x, counted from its first."""
        start, stop = np.searchsorted(self.voxel[:, 0], [planes.start, planes.stop])
        shifted = self.voxel[start:stop] - np.array([planes.start, 0, 0])
        own = slice(start, stop)
        own_section, links = self.section[own], self.links.within(planes)
        return CutVoxels(shifted, self.volume[own], own_section, links)

    def volumes_at(
        self, voxels: Int[np.ndarray, "k 3"], shape: tuple[int, ...]
    ) -> Float[np.ndarray, " k"]:
        """Volumes of some voxels [voxels]; 1 where not cut."""
        if not len(self.voxel):
            return np.ones(len(voxels))
        # Searched: an array of all voxels would be the largest of all.
        own, wanted = (
            np.asarray(np.ravel_multi_index(tuple(v.T), shape))
            for v in (self.voxel, voxels)
        )
        index = np.minimum(np.searchsorted(own, wanted), len(own) - 1)
        return np.where(own[index] == wanted, self.volume[index], 1.0)

    def volumes(self, shape: tuple[int, ...]) -> Float[np.ndarray, "x y z"]:
        """Volume of every voxel of the lattice [voxels]; 1 where not cut."""
        found = np.ones(shape)
        found[tuple(self.voxel.T)] = self.volume
        return found


def limited(cut: CutVoxels, solid: Bool[np.ndarray, "x y z"]) -> CutVoxels:
    """Raise small volumes at the cost of neighbours; the total stays."""
    if not len(cut.voxel):
        return cut
    near = _around(cut, np.pad(solid, 1))
    _, y, z = np.add(solid.shape, 2).tolist()
    volume, least = np.ones(len(near.cell)), near.least_volume()
    volume[near.own] = cut.volume
    total = volume.sum()
    for _ in range(_ROUNDS):
        missing = np.maximum(least - volume, 0)
        if missing.max(initial=0) < _ENOUGH:
            break
        asking = np.flatnonzero(missing)
        # Neighbours in the set; the last entry stands for none.
        giving = near.neighbours(asking)
        spare = np.append(np.maximum(volume - 1.2 * least, 0), 0)[giving]
        every = spare.sum(1)
        # No more than a fraction of it: others may ask the same neighbour.
        given = np.minimum(missing[asking], every / 4)
        share = spare * (given / np.where(every > 0, every, 1))[:, None]
        volume[asking] += given
        taken = np.bincount(giving.ravel(), share.ravel(), len(volume) + 1)
        volume -= taken[:-1]
    # Parts of a voxel or two have no neighbour that could give: all others do.
    if volume.min() < MIN_OPEN:
        above = np.maximum(volume - MIN_OPEN, 0)
        spare = max(total - MIN_OPEN * len(volume), 0.0)
        volume = MIN_OPEN + above * (spare / above.sum() if spare else 0.0)
    changed = np.flatnonzero((volume != 1) | near.is_cut)
    voxel, rest = np.empty((len(changed), 3), np.int32), near.cell[changed]
    for axis, jump in enumerate((y * z, z, 1)):
        voxel[:, axis], rest = np.divmod(rest, jump)
    voxel -= np.int32(1)
    section = np.ones((len(changed), 3))
    # Cut voxels are among those that changed.
    section[np.searchsorted(changed, near.own)] = cut.section
    return CutVoxels(voxel, volume[changed], section, cut.links)


class _Around(NamedTuple):
    """Cut voxels and their solid neighbours."""

    cell: Int[np.ndarray, " k"]
    """In lattice order, on a lattice with a rim."""
    own: Int[np.ndarray, " m"]
    """Index of each cut voxel among them."""
    is_cut: Bool[np.ndarray, " k"]
    steps: tuple[int, ...]
    """From a cell to its six neighbours."""
    conductance: Float[np.ndarray, " k"]
    """Sum over the links of each cell, over k h [-]."""

    def neighbours(self, which: Int[np.ndarray, " j"]) -> Int[np.ndarray, "j 6"]:
        """Index of the neighbours of some cells among all; their number for any other.

        Found for few: a table of the whole lattice would be larger than the voxels.
        """
        next_to = self.cell[which][:, None] + np.array(self.steps)
        index = np.searchsorted(self.cell, next_to)
        found = np.append(self.cell, -1)[index] == next_to
        return np.where(found, index, len(self.cell))

    def least_volume(self) -> Float[np.ndarray, " k"]:
        """Volume from which a voxel keeps the stable step [voxels]."""
        # Its step is V over that sum; that of a voxel inside 1 / 6.
        return np.maximum(_MIN_STEP / 6 * self.conductance, MIN_OPEN)


def _around(cut: CutVoxels, padded: Bool[np.ndarray, "x y z"]) -> _Around:
    solid = padded.reshape(-1)
    _, y, z = padded.shape
    steps = -y * z, y * z, -z, z, -1, 1
    flat = np.asarray(np.ravel_multi_index(tuple(cut.voxel.T + 1), padded.shape))
    cell = flat
    # One side at a time: all would be most of the memory.
    for step in steps:
        beside = flat + step
        cell = sorted_union(cell, beside[solid[beside]])
    own = np.searchsorted(cell, flat)
    is_cut = np.zeros(len(cell), bool)
    is_cut[own] = True
    conductance = np.zeros(len(cell))
    for step in steps:
        conductance += solid[cell + step]
    jumps = np.array([y * z, z, 1])
    low = sum(cut.links.voxel[:, a] * jumps[a] for a in range(3)) + jumps.sum()
    apart = sum(cut.links.step[:, a] * jumps[a] for a in range(3))
    for end in (low, low + apart):
        index = np.searchsorted(cell, end)
        conductance += np.bincount(index, cut.links.extra, len(cell))
    return _Around(cell, own, is_cut, steps, conductance)
