"""From crossings to cut voxels: volumes, open areas and the areas of cells.

With w = (theta - 1/2) n_a^2 of each cell of a voxel (see `crossings`), in voxels:

- volume 1 + sum w: on a smooth surface the weights n_a^2 of the axes add up to 1;
- section across axis a, 1 + sum over the other axes of w (1 - n_a^2)^10: what the
  surface adds or takes where it is along the axis. Links have the mean of both ends
  (see `cut_links`).

Two cells of one voxel on different sheets, as at an edge, also have the product w w' (1
- (n . n')^2), which makes boxes exact. A cell beside an edge is cut by the other sheets
likewise, and its middle is as far from the crossing as they cut more on one side.
"""

from collections.abc import Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .crossings import Cells
from .cut_links import WHOLE, Sides, cut_links
from .cut_voxels import MIN_OPEN, CutVoxels, limited


# Of 1 - n_a^2. A lower exponent changes links with a part along the normal, where the
# staircase is of second order by itself: a ball of 24 voxels' radius has 0.0019 of
# error with 1, 0.0014 with 10, and 0.0011 without open areas (Bi 10).
_ALONG = 10

# Axes, and sides below and above.
_SIDES = tuple(product(range(3), range(2)))


class CellShapes(NamedTuple):
    """Cells as other sheets of their voxels cut them."""

    factor: Float[np.ndarray, " s"]
    """Part of the area that is left [-]."""
    shift: Float[np.ndarray, "s 3"]
    """From the crossing to the middle of the cell [voxels]."""


def cut_voxels(
    found: Cells, solid: Bool[np.ndarray, "x y z"]
) -> tuple[CutVoxels, CellShapes]:
    """Cut voxels of a body, and the shapes of its cells.

    The voxels of the cells come in lattice order.
    """
    flat = np.asarray(np.ravel_multi_index(tuple(found.voxel.T), solid.shape))
    is_next = np.diff(flat, prepend=-1) != 0
    key, owner = flat[is_next], np.cumsum(is_next) - 1
    sides = _sides(found, owner, len(key))
    own = found.normal[np.arange(len(owner)), found.axis]
    weight = found.excess * np.square(own)
    pairs = list(_pairs(sides))
    # Sheets and gaps thinner than a voxel have volume, but no face.
    apart = np.where(found.on_face, 0.0, weight)
    volume = _volumes(sides, weight, pairs) + np.bincount(owner, apart, len(key))
    section = np.stack([_section(sides, weight, pairs, a) for a in range(3)], axis=1)
    shapes = _cell_shapes(weight, pairs)
    voxel = found.voxel[is_next]
    # The largest arrays follow.
    del pairs, flat, owner, own, weight, apart
    links = cut_links(voxel, section, sides, solid)
    del sides
    # A body whose faces lie between voxels has none: its stencil is the uniform one.
    off = np.abs(np.column_stack([volume, section]) - 1).max(axis=1)
    cut = np.flatnonzero(off > WHOLE)
    own = CutVoxels(voxel[cut], volume[cut], section[cut], links)
    return limited(own, solid), shapes


def _sides(found: Cells, owner: Int[np.ndarray, " s"], count: int) -> Sides:
    cell = np.full((3, 2, count), -1, np.int32)
    face = np.flatnonzero(found.on_face)
    cell[found.axis[face], found.ahead[face].astype(int), owner[face]] = face
    return Sides(cell, found.excess, found.normal)


class _Pair(NamedTuple):
    """Cells of the same voxels across two axes, on one side of each."""

    axes: tuple[int, int]
    at: tuple[int, int]
    """Side of each cell: below or above."""
    voxel: Int[np.ndarray, " k"]
    one: Int[np.ndarray, " k"]
    two: Int[np.ndarray, " k"]
    apart: Float[np.ndarray, " k"]
    """1 for cells of different sheets, 0 for those of one."""


def _pairs(sides: Sides) -> Iterator[_Pair]:
    # Few voxels have cells on two given sides: arrays of all would be mostly zero.
    there = sides.cell >= 0
    for (a, b), (i, j) in product(
        combinations(range(3), 2), product(range(2), range(2))
    ):
        voxel = np.flatnonzero(there[a, i] & there[b, j])
        one, two = sides.cell[a, i, voxel], sides.cell[b, j, voxel]
        apart = 1 - np.square((sides.normal[one] * sides.normal[two]).sum(-1))
        yield _Pair((a, b), (i, j), voxel, one, two, apart)


def _sums(
    sides: Sides, weight: Float[np.ndarray, " s"], axes: tuple[int, ...]
) -> Float[np.ndarray, " m"]:
    """1, and the weights of each voxel's cells across some axes."""
    total = np.zeros(sides.cell.shape[2])
    for axis, side in _SIDES:
        if axis in axes:
            voxel = np.flatnonzero(sides.cell[axis, side] >= 0)
            total[voxel] += weight[sides.cell[axis, side, voxel]]
    return 1 + total


def _volumes(
    sides: Sides, weight: Float[np.ndarray, " s"], pairs: list[_Pair]
) -> Float[np.ndarray, " m"]:
    total = _sums(sides, weight, (0, 1, 2))
    there = sides.cell >= 0
    for i, j, k in np.ndindex(2, 2, 2):
        voxel = np.flatnonzero(there[0, i] & there[1, j] & there[2, k])
        cells = [sides.cell[a, side, voxel] for a, side in enumerate((i, j, k))]
        n = [sides.normal[cell] for cell in cells]
        triple = np.square(np.einsum("mi,mi->m", n[0], np.cross(n[1], n[2])))
        w = [weight[cell] for cell in cells]
        total[voxel] += w[0] * w[1] * w[2] * triple
    for pair in pairs:
        total[pair.voxel] += weight[pair.one] * weight[pair.two] * pair.apart
    return total


def _section(
    sides: Sides, weight: Float[np.ndarray, " s"], pairs: list[_Pair], axis: int
) -> Float[np.ndarray, " m"]:
    """Open area across an axis."""
    one, two = other = tuple(a for a in range(3) if a != axis)
    weight = weight * (1 - np.square(sides.normal[:, axis])) ** _ALONG
    total = _sums(sides, weight, other)
    for pair in pairs:
        if pair.axes == (one, two):
            total[pair.voxel] += weight[pair.one] * weight[pair.two] * pair.apart
    return total


def _cell_shapes(weight: Float[np.ndarray, " s"], pairs: list[_Pair]) -> CellShapes:
    factor, shift = np.ones(len(weight)), np.zeros((len(weight), 3))
    for a, b in combinations(range(3), 2):
        own = [pair for pair in pairs if pair.axes == (a, b)]
        # What the sheets below and above across the other axis take from each cell.
        for other, swapped in ((b, False), (a, True)):
            below_above = np.zeros((2, len(weight)))
            for pair in own:
                here, there = (pair.one, pair.two)[:: -1 if swapped else 1]
                side = pair.at[0 if swapped else 1]
                below_above[side, here] = weight[there] * pair.apart
            below, above = below_above
            factor *= 1 + below + above
            shift[:, other] += (above - below) / 2
    return CellShapes(np.maximum(factor, MIN_OPEN), shift)
