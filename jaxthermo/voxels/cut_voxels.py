"""Voxels that the surface cuts: their volumes and links.

Volumes so small that they would shorten explicit steps are raised, and what they gain
is taken from their neighbours: the total stays.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import flat_index, sorted_union
from .cut_links import CutLinks
from .voxel_bits import VoxelBits, VoxelIndex


_MIN_STEP = 0.72
"""Stable step of any voxel without a load, relative to one with six neighbours [-]."""

MIN_OPEN = 0.05
"""Smallest volume of a voxel and area factor of a cell."""

# Rounds in which volume is taken from neighbours; two are enough but for thin parts.
_ROUNDS = 8

# Missing volume that is negligible [voxels].
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
        cut_index = flat_index(self.voxel, solid.shape)
        volume = np.ones(len(flat))
        volume[np.searchsorted(flat, cut_index)] = self.volume
        return volume

    def within(self, planes: slice) -> "CutVoxels":
        """Cut voxels in a range of planes along x, counted from its first."""
        start, stop = np.searchsorted(self.voxel[:, 0], [planes.start, planes.stop])
        shifted = self.voxel[start:stop] - np.array([planes.start, 0, 0])
        rows = slice(start, stop)
        return CutVoxels(
            voxel=shifted,
            volume=self.volume[rows],
            section=self.section[rows],
            links=self.links.within(planes),
        )

    def volumes_at(
        self, voxels: Int[np.ndarray, "k 3"], shape: tuple[int, ...]
    ) -> Float[np.ndarray, " k"]:
        """Volumes of `voxels` [voxels]; 1 where not cut."""
        if not len(self.voxel):
            return np.ones(len(voxels))
        # Searched: an array of all voxels would be the largest of all.
        cut_index = flat_index(self.voxel, shape)
        index = flat_index(voxels, shape)
        slot = np.minimum(np.searchsorted(cut_index, index), len(cut_index) - 1)
        return np.where(cut_index[slot] == index, self.volume[slot], 1.0)


def limited(cut: CutVoxels, solid: Bool[np.ndarray, "x y z"]) -> CutVoxels:
    """Raise small volumes at the cost of neighbours; the total stays."""
    if not len(cut.voxel):
        return cut
    near = _around(cut, solid)
    minimum = near.minimum
    volume = np.ones(len(minimum))
    volume[near.cut] = cut.volume
    volume[-1] = 0
    # Few voxels are too small, and after the first round only those that have changed
    # may be.
    asking = np.flatnonzero(minimum > volume)
    for _ in range(_ROUNDS):
        missing = np.maximum(minimum[asking] - volume[asking], 0)
        if missing.max(initial=0) < _ENOUGH:
            break
        giving = near.neighbours(asking)
        spare = np.maximum(volume[giving] - 1.2 * minimum[giving], 0)
        total_spare = spare.sum(1)
        # No more than a fraction: several voxels may need the same neighbour's volume.
        gain = np.minimum(missing, total_spare / 4)
        share = spare * (gain / np.where(total_spare > 0, total_spare, 1))[:, None]
        volume[asking] += gain
        giving, slot = np.unique(giving, return_inverse=True)
        volume[giving] -= np.bincount(slot.reshape(-1), share.reshape(-1))
        changed = sorted_union(asking, giving)
        asking = changed[volume[changed] < minimum[changed]]
    volume = volume[:-1]
    cut_index = near.cut
    number = near.number
    bits = near.bits
    # The largest arrays follow.
    del near, minimum
    _raise_all(volume, cut_index)
    is_changed = volume != 1
    is_changed[cut_index] = True
    changed = np.flatnonzero(is_changed)
    section = np.ones((len(changed), 3))
    # Cut voxels are among those that changed.
    section[np.searchsorted(changed, cut_index)] = cut.section
    voxel = bits.voxels(number[changed])
    return CutVoxels(
        voxel=voxel, volume=volume[changed], section=section, links=cut.links
    )


def _raise_all(
    volume: Float[np.ndarray, " k"], cut_index: Int[np.ndarray, " m"]
) -> None:
    """Raise every volume to the smallest at the cost of all others, in place."""
    # Bodies of a voxel or two have no neighbour with volume to spare.
    small = np.flatnonzero(volume < MIN_OPEN)
    missing = float((MIN_OPEN - volume[small]).sum())
    volume[small] = MIN_OPEN
    # From cut voxels if they have enough: others stay whole, and need not be listed.
    giving: Any = cut_index
    if (volume[cut_index] - MIN_OPEN).sum() < missing:
        giving = slice(None)
    spare = volume[giving] - MIN_OPEN
    if missing:
        volume[giving] -= spare * min(missing / max(spare.sum(), _ENOUGH), 1.0)


class _Around(NamedTuple):
    """Cut voxels and their solid neighbours."""

    number: Int[np.ndarray, " k"]
    """Number of each voxel in `VoxelBits`, ascending."""
    cut: Int[np.ndarray, " m"]
    """Index of each cut voxel in `number`."""
    bits: VoxelBits
    index: VoxelIndex
    minimum: Float[np.ndarray, " j"]
    """Smallest volume with which each voxel allows the stable step [voxels]; the last
    one stands for all voxels that are not listed and have nothing to give."""

    def neighbours(self, which: Int[np.ndarray, " j"]) -> Int[np.ndarray, "j 6"]:
        """Indices of the six neighbours of each voxel; the last index if not listed."""
        neighbour = np.empty((len(which), 6), np.int64)
        for side, step in enumerate(_steps(self.bits)):
            neighbour[:, side], is_listed = self.index.at(self.number[which] + step)
            neighbour[~is_listed, side] = len(self.number)
        return neighbour


def _steps(bits: VoxelBits) -> tuple[int, ...]:
    """Jumps from a voxel to its six neighbours."""
    return tuple(sign * jump for jump in bits.jumps for sign in (-1, 1))


# Links that are looked up at once: arrays of all would be the largest of a run.
_CHUNK_LINKS = 2**16


def _around(cut: CutVoxels, solid: Bool[np.ndarray, "x y z"]) -> _Around:
    body = VoxelBits.of(solid)
    number = body.number(tuple(cut.voxel.T))
    cut_bits = VoxelBits.listed(solid.shape, number)
    bits = VoxelBits.none(solid.shape)
    for axis, ahead in np.ndindex(3, 2):
        np.bitwise_or(bits.word, cut_bits.shifted(axis, bool(ahead)), out=bits.word)
    np.bitwise_and(bits.word, body.word, out=bits.word)
    np.bitwise_or(bits.word, cut_bits.word, out=bits.word)
    del cut_bits
    near = bits.numbers()
    index = VoxelIndex(bits)
    # Sum over the links of each voxel, over k h.
    conductance = np.zeros(len(near) + 1)
    for step in _steps(bits):
        conductance[:-1] += body.has(near, step)
    for start in range(0, len(cut.links.extra), _CHUNK_LINKS):
        links = cut.links.selected(slice(start, start + _CHUNK_LINKS))
        low = bits.number(tuple(links.voxel.T))
        apart = links.step.astype(np.int64) @ np.array(bits.jumps)
        for end in (low, low + apart):
            end_index, _ = index.at(end)
            # Links are in lattice order: their ends are among few.
            first = int(end_index.min())
            change = np.bincount(end_index - first, links.extra)
            conductance[first : first + len(change)] += change
    # The stable step of a voxel is its volume over that sum: 1 / 6 for an inner voxel.
    minimum = conductance
    minimum *= _MIN_STEP / 6
    np.maximum(minimum, MIN_OPEN, out=minimum)
    minimum[-1] = 0
    return _Around(
        number=near, cut=index.at(number)[0], bits=bits, index=index, minimum=minimum
    )
