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

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .crossings import Crossings
from .cut_links import WHOLE, Sides, cut_links
from .cut_voxels import MIN_OPEN, CutVoxels, limited


# Of 1 - n_a^2. A lower exponent changes links with a part along the normal, where the
# staircase is of second order by itself: a ball of 24 voxels' radius has 0.0019 of
# error with 1, 0.0014 with 10, and 0.0011 without open areas (Bi 10).
_ALONG = 10


class _Sheets(NamedTuple):
    """Cells on the six sides of voxels: [voxel, axis, below or above]."""

    weight: Float[np.ndarray, "m 3 2"]
    """w, 0 on sides without a face."""
    normal: Float[np.ndarray, "m 3 2 3"]


class CellShapes(NamedTuple):
    """Cells as other sheets of their voxels cut them."""

    factor: Float[np.ndarray, " s"]
    """Part of the area that is left [-]."""
    shift: Float[np.ndarray, "s 3"]
    """From the crossing to the middle of the cell [voxels]."""


def cut_voxels(
    found: Crossings, solid: Bool[np.ndarray, "x y z"]
) -> tuple[CutVoxels, CellShapes]:
    """Cut voxels of a body, and the shapes of its cells.

    No crossing may be lost.
    """
    flat = np.ravel_multi_index(tuple(found.voxel.T), solid.shape)
    key, owner = np.unique(flat, return_inverse=True)
    owner = owner.reshape(-1)
    sides = _sides(found, owner, len(key))
    squared = np.square(found.normal[np.arange(len(owner)), found.axis])
    # Sheets and gaps thinner than a voxel have volume, but no face.
    apart = np.where(found.on_face, 0.0, found.excess * squared)
    sheets = _sheets(sides)
    volume = _volumes(sheets) + np.bincount(owner, apart, len(key))
    section = np.stack([_section(sheets, a) for a in range(3)], axis=1)
    voxel = np.stack(np.unravel_index(key, solid.shape), axis=1)
    links = cut_links(voxel, section, sides, solid)
    # A body whose faces lie between voxels has none: its stencil is the uniform one.
    off = np.abs(np.column_stack([volume, section]) - 1).max(axis=1)
    cut = np.flatnonzero(off > WHOLE)
    own = CutVoxels(voxel[cut], volume[cut], section[cut], links)
    return limited(own, solid), _cell_shapes(found, owner, sheets)


def _sides(found: Crossings, owner: Int[np.ndarray, " s"], count: int) -> Sides:
    there, excess = np.zeros((count, 3, 2), bool), np.zeros((count, 3, 2))
    normal = np.zeros((count, 3, 2, 3))
    face = np.flatnonzero(found.on_face)
    at = owner[face], found.axis[face], found.ahead[face].astype(int)
    there[at], excess[at] = True, found.excess[face]
    normal[at] = found.normal[face]
    return Sides(there, excess, normal)


def _sheets(sides: Sides) -> _Sheets:
    own = np.einsum("maia->mai", sides.normal)
    return _Sheets(sides.excess * np.square(own), sides.normal)


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """1 for cells of different sheets, 0 for those of one."""
    return 1 - np.square((one * other).sum(-1))


def _volumes(sides: _Sheets) -> Float[np.ndarray, " m"]:
    weight, normal = sides
    total = 1 + weight.sum((1, 2))
    for i in np.ndindex(2, 2, 2):
        w = [weight[:, a, i[a]] for a in range(3)]
        n = [normal[:, a, i[a]] for a in range(3)]
        triple = np.square(np.einsum("mi,mi->m", n[0], np.cross(n[1], n[2])))
        total += w[0] * w[1] * w[2] * triple
    for a, b in ((0, 1), (0, 2), (1, 2)):
        for i, j in np.ndindex(2, 2):
            both = weight[:, a, i] * weight[:, b, j]
            total += both * _apart(normal[:, a, i], normal[:, b, j])
    return total


def _section(sides: _Sheets, axis: int) -> Float[np.ndarray, " m"]:
    """Open area across an axis."""
    other = [a for a in range(3) if a != axis]
    weight = sides.weight * (1 - np.square(sides.normal[..., axis])) ** _ALONG
    total = 1 + weight[:, other].sum((1, 2))
    one, two = other
    for i, j in np.ndindex(2, 2):
        both = weight[:, one, i] * weight[:, two, j]
        total += both * _apart(sides.normal[:, one, i], sides.normal[:, two, j])
    return total


def _cell_shapes(
    found: Crossings, owner: Int[np.ndarray, " s"], sides: _Sheets
) -> CellShapes:
    factor, shift = np.ones(len(owner)), np.zeros((len(owner), 3))
    for axis in range(3):
        own = np.flatnonzero(found.on_face & (found.axis == axis))
        weight, normal = sides.weight[owner[own]], sides.normal[owner[own]]
        here = weight * _apart(normal, found.normal[own][:, None, None])
        for other in range(3):
            if other != axis:
                below, above = here[:, other].T
                factor[own] *= 1 + below + above
                shift[own, other] = (above - below) / 2
    return CellShapes(np.maximum(factor, MIN_OPEN), shift)
