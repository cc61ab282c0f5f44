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
from jaxtyping import Float, Int

from .crossings import Cells
from .cut_links import WHOLE, CutLinks, Sides
from .cut_voxels import MIN_OPEN, CutVoxels
from .voxel_bits import VoxelBits


# Of 1 - n_a^2. A lower exponent changes links with a part along the normal, where the
# staircase is of second order by itself: a ball of 24 voxels' radius has 0.0019 of
# error with 1, 0.0014 with 10, and 0.0011 without open areas (Bi 10).
_ALONG = 10


class CellShapes(NamedTuple):
    """Cells as other sheets of their voxels cut them."""

    factor: Float[np.ndarray, " s"]
    """Part of the area that is left [-]."""
    shift: Float[np.ndarray, "s 3"]
    """From the crossing to the middle of the cell [voxels]."""


class VoxelShapes(NamedTuple):
    """Voxels with surface cells, before any limit of their volumes."""

    number: Int[np.ndarray, " m"]
    """Number of each voxel, as of `VoxelBits`, ascending."""
    volume: Float[np.ndarray, " m"]
    """Volume [voxels]."""
    section: Float[np.ndarray, "m 3"]
    """Section of the body across x, y, z [voxel faces]."""


def surface_shapes(found: Cells) -> tuple[VoxelShapes, CellShapes]:
    """Shapes of the voxels of surface cells, and of the cells.

    The numbers of the cells' voxels ascend.
    """
    number, owner = _owners(found)
    weight = found.normal[np.arange(len(owner)), found.axis]
    weight *= weight
    weight *= found.excess
    pairs = _pairs(found, owner)
    # Sheets and gaps thinner than a voxel have volume, but no face.
    volume = 1 + np.bincount(owner, weight, len(number))
    _add_products(volume, weight, pairs)
    _add_triples(volume, found=found, owner=owner, weight=weight)
    section = np.ones((len(number), 3))
    for axis in range(3):
        # What is along the surface, of the cells across the other axes.
        along = _power(1 - np.square(found.normal[:, axis]), _ALONG)
        along *= weight
        along *= found.on_face & (found.axis != axis)
        section[:, axis] += np.bincount(owner, along, len(number))
        third = 3 - found.axis[pairs.one] - found.axis[pairs.two]
        others = np.flatnonzero(third == axis)
        _add_products(section[:, axis], along, pairs.chosen(others))
    shapes = VoxelShapes(number, volume, section)
    return shapes, _cell_shapes(found, weight, pairs)


def _owners(found: Cells) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " s"]]:
    """Numbers of the voxels of cells, each once, and the index of each cell's."""
    is_next = np.diff(found.number, prepend=-1) != 0
    return found.number[is_next], np.cumsum(is_next, dtype=np.int32) - 1


def sides_of(cells: Cells) -> Sides:
    """Cells on the sides of their voxels."""
    number, owner = _owners(cells)
    found = np.full((3, 2, len(number)), -1, np.int32)
    face = np.flatnonzero(cells.on_face)
    side = 2 * cells.axis[face] + cells.ahead[face]
    slot = np.multiply(side, len(number), dtype=np.int64) + owner[face]
    found.reshape(-1)[slot] = face
    return Sides(found, cells.excess, cells.normal)


def cut_voxels(
    shapes: VoxelShapes, links: CutLinks, shape: tuple[int, ...]
) -> CutVoxels:
    """Voxels of a lattice that are not whole, before any limit of their volumes."""
    # A body whose faces lie between voxels has none: its stencil is the uniform one.
    off = np.abs(shapes.volume - 1)
    for section in shapes.section.T:
        np.maximum(off, np.abs(section - 1), out=off)
    cut = np.flatnonzero(off > WHOLE)
    voxel = VoxelBits.none(shape).voxels(shapes.number[cut])
    return CutVoxels(
        voxel=voxel, volume=shapes.volume[cut], section=shapes.section[cut], links=links
    )


class _Pairs(NamedTuple):
    """Cells of the same voxel across different axes, each pair once."""

    one: Int[np.ndarray, " k"]
    two: Int[np.ndarray, " k"]
    owner: Int[np.ndarray, " k"]
    """Voxel of both."""
    apart: Float[np.ndarray, " k"]
    """1 for cells of different sheets, 0 for those of one."""

    def chosen(self, which: np.ndarray) -> "_Pairs":
        """Some of them."""
        return _Pairs(*(column[which] for column in self))


def _pairs(found: Cells, owner: Int[np.ndarray, " s"]) -> _Pairs:
    # The cells of a voxel are one after the other.
    parts = [np.zeros((2, 0), np.int32)]
    face = np.flatnonzero(found.on_face).astype(np.int32)
    of, axis = owner[face], found.axis[face]
    for apart in range(1, len(face)):
        same = of[apart:] == of[:-apart]
        if not same.any():
            break
        first = np.flatnonzero(same & (axis[apart:] != axis[:-apart]))
        parts.append(np.stack([face[first], face[first + apart]]))
    one, two = np.concatenate(parts, axis=1)
    normals = (found.normal.take(cell, axis=0) for cell in (one, two))
    cosine = np.einsum("ki,ki->k", *normals)
    return _Pairs(one=one, two=two, owner=owner[one], apart=1 - np.square(cosine))


def _add_products(
    total: Float[np.ndarray, " m"], weight: Float[np.ndarray, " s"], pairs: _Pairs
) -> None:
    """Add w w' (1 - (n . n')^2) of all pairs to their voxels."""
    both = weight[pairs.one] * weight[pairs.two] * pairs.apart
    total += np.bincount(pairs.owner, both, len(total))


def _add_triples(
    volume: Float[np.ndarray, " m"],
    found: Cells,
    owner: Int[np.ndarray, " s"],
    weight: Float[np.ndarray, " s"],
) -> None:
    """Add what three cells across all axes have in common to their voxels."""
    # Few voxels have three cells, and fewer have them across all axes.
    is_corner = np.zeros(len(volume), bool)
    is_corner[owner[:-2][owner[:-2] == owner[2:]]] = True
    face = np.flatnonzero(found.on_face & is_corner[owner])
    there = np.zeros((3, len(volume)), bool)
    there[found.axis[face], owner[face]] = True
    corner = np.flatnonzero(there.all(axis=0))
    slot = np.full(len(volume), -1, np.int32)
    slot[corner] = np.arange(len(corner))
    face = face[slot[owner[face]] >= 0]
    side = np.full((3, 2, len(corner)), -1)
    side[found.axis[face], found.ahead[face].astype(int), slot[owner[face]]] = face
    for i, j, k in np.ndindex(2, 2, 2):
        one, two, three = cells = side[0, i], side[1, j], side[2, k]
        kept = np.flatnonzero(np.min(cells, axis=0) >= 0)
        one, two, three = one[kept], two[kept], three[kept]
        across = np.cross(found.normal[two], found.normal[three])
        triple = np.square((found.normal[one] * across).sum(axis=1))
        volume[corner[kept]] += weight[one] * weight[two] * weight[three] * triple


def _power(base: Float[np.ndarray, " s"], exponent: int) -> Float[np.ndarray, " s"]:
    # By squares, in a tenth of the time of numpy's.
    found = np.ones_like(base)
    while exponent:
        if exponent & 1:
            found *= base
        base, exponent = base * base, exponent >> 1
    return found


def _cell_shapes(
    found: Cells, weight: Float[np.ndarray, " s"], pairs: _Pairs
) -> CellShapes:
    # What the sheets across each other axis take from a cell: in all, and above less
    # below.
    cell = np.concatenate([pairs.one, pairs.two])
    other = np.concatenate([pairs.two, pairs.one])
    taken = weight[other] * np.tile(pairs.apart, 2)
    slot = np.multiply(cell, 3, dtype=np.int64) + found.axis[other]
    part = np.bincount(slot, taken, 3 * len(weight)).reshape(-1, 3)
    factor = (1 + part[:, 0]) * (1 + part[:, 1]) * (1 + part[:, 2])
    del part
    np.negative(taken, out=taken, where=~found.ahead[other])
    shift = np.bincount(slot, taken, 3 * len(weight)).reshape(-1, 3)
    shift /= 2
    return CellShapes(np.maximum(factor, MIN_OPEN), shift)
