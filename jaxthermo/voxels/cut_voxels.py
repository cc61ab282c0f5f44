"""Voxels that the surface cuts: their volumes and links.

Volumes so small that they would shorten explicit steps are raised, and what they gain
is taken from their neighbours: the total stays.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import sorted_union
from .cut_links import CutLinks
from .voxel_bits import VoxelBits, VoxelIndex


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
        return CutVoxels(
            voxel=shifted, volume=self.volume[own], section=own_section, links=links
        )

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
    near = _around(cut, solid)
    volume, least = np.ones(len(near.least)), near.least
    volume[near.own], volume[-1] = cut.volume, 0
    # Few ask, and after the first round only those that have asked or given.
    asking = np.flatnonzero(least > volume)
    for _ in range(_ROUNDS):
        missing = np.maximum(least[asking] - volume[asking], 0)
        if missing.max(initial=0) < _ENOUGH:
            break
        giving = near.neighbours(asking)
        spare = np.maximum(volume[giving] - 1.2 * least[giving], 0)
        every = spare.sum(1)
        # No more than a fraction of it: others may ask the same neighbour.
        given = np.minimum(missing, every / 4)
        share = spare * (given / np.where(every > 0, every, 1))[:, None]
        volume[asking] += given
        giving, slot = np.unique(giving, return_inverse=True)
        volume[giving] -= np.bincount(slot.reshape(-1), share.reshape(-1))
        every = sorted_union(asking, giving)
        asking = every[volume[every] < least[every]]
    volume, own, number, bits = volume[:-1], near.own, near.number, near.bits
    # The largest arrays follow.
    del near, least
    _raise_all(volume, own)
    is_changed = volume != 1
    is_changed[own] = True
    changed = np.flatnonzero(is_changed)
    section = np.ones((len(changed), 3))
    # Cut voxels are among those that changed.
    section[np.searchsorted(changed, own)] = cut.section
    voxel = bits.voxels(number[changed])
    return CutVoxels(
        voxel=voxel, volume=volume[changed], section=section, links=cut.links
    )


def _raise_all(volume: Float[np.ndarray, " k"], own: Int[np.ndarray, " m"]) -> None:
    """Raise every volume to the smallest at the cost of all others, in place."""
    # Parts of a voxel or two have no neighbour that could give.
    small = np.flatnonzero(volume < MIN_OPEN)
    missing = float((MIN_OPEN - volume[small]).sum())
    volume[small] = MIN_OPEN
    # Of cut voxels if they have it: others stay whole, and need not be listed.
    giving: Any = own
    if (volume[own] - MIN_OPEN).sum() < missing:
        giving = slice(None)
    spare = volume[giving] - MIN_OPEN
    if missing:
        volume[giving] -= spare * min(missing / max(spare.sum(), _ENOUGH), 1.0)


class _Around(NamedTuple):
    """Cut voxels and their solid neighbours."""

    number: Int[np.ndarray, " k"]
    """Their numbers, as of `VoxelBits`, ascending."""
    own: Int[np.ndarray, " m"]
    """Index of each cut voxel among them."""
    bits: VoxelBits
    index: VoxelIndex
    least: Float[np.ndarray, " j"]
    """Volume from which each keeps the stable step [voxels]; the last stands for any
    other voxel, which has nothing to give."""

    def neighbours(self, which: Int[np.ndarray, " j"]) -> Int[np.ndarray, "j 6"]:
        """Index of the neighbours of some voxels; that of the last for any other."""
        found = np.empty((len(which), 6), np.int64)
        for side, step in enumerate(_steps(self.bits)):
            found[:, side], there = self.index.at(self.number[which] + step)
            found[~there, side] = len(self.number)
        return found


def _steps(bits: VoxelBits) -> tuple[int, ...]:
    """Jumps from a voxel to its six neighbours."""
    return tuple(sign * jump for jump in bits.jumps for sign in (-1, 1))


# Links that are looked up at once: arrays of all would be the largest of a run.
_CHUNK_LINKS = 2**16


def _around(cut: CutVoxels, solid: Bool[np.ndarray, "x y z"]) -> _Around:
    body = VoxelBits.of(solid)
    number = body.number(tuple(cut.voxel.T))
    own = VoxelBits.listed(solid.shape, number)
    bits = VoxelBits.none(solid.shape)
    for axis, ahead in np.ndindex(3, 2):
        np.bitwise_or(bits.word, own.shifted(axis, bool(ahead)), out=bits.word)
    np.bitwise_and(bits.word, body.word, out=bits.word)
    np.bitwise_or(bits.word, own.word, out=bits.word)
    del own
    every, index = bits.numbers(), VoxelIndex(bits)
    # Sum over the links of each voxel, over k h.
    conductance = np.zeros(len(every) + 1)
    for step in _steps(bits):
        conductance[:-1] += body.has(every, step)
    for start in range(0, len(cut.links.extra), _CHUNK_LINKS):
        links = cut.links.chosen(slice(start, start + _CHUNK_LINKS))
        low = bits.number(tuple(links.voxel.T))
        apart = links.step.astype(np.int64) @ np.array(bits.jumps)
        for end in (low, low + apart):
            at, _ = index.at(end)
            # Links are in lattice order: their ends are among few.
            first = int(at.min())
            part = np.bincount(at - first, links.extra)
            conductance[first : first + len(part)] += part
    # The step of a voxel is its volume over that sum; that of a voxel inside 1 / 6.
    least = conductance
    least *= _MIN_STEP / 6
    np.maximum(least, MIN_OPEN, out=least)
    least[-1] = 0
    return _Around(
        number=every, own=index.at(number)[0], bits=bits, index=index, least=least
    )
