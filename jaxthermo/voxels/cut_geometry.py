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


# Exponent of 1 - n_a^2. A lower one changes links with a component along the normal,
# where the staircase is of second order by itself: a ball of 24 voxels' radius has an
# error of 0.0019 with 1, 0.0014 with 10, and 0.0011 without open areas (Bi 10).
_ALONG = 10


class CellShapes(NamedTuple):
    """Shapes of cells that other sheets in their voxels cut."""

    factor: Float[np.ndarray, " s"]
    """Fraction of the area that is left [-]."""
    shift: Float[np.ndarray, "s 3"]
    """From the crossing to the middle of the cell [voxels]."""


class _VoxelShapes(NamedTuple):
    """Voxels with surface cells, before any limit of their volumes."""

    number: Int[np.ndarray, " m"]
    """Number of each voxel in `VoxelBits`, ascending."""
    volume: Float[np.ndarray, " m"]
    """Volume [voxels]."""
    section: Float[np.ndarray, "m 3"]
    """Section of the body across x, y, z [voxel faces]."""


def surface_shapes(cells: Cells) -> tuple[_VoxelShapes, CellShapes]:
    """Shapes of the voxels of surface cells, and of the cells.

    The numbers of the cells' voxels ascend.
    """
    number, owner = _owners(cells)
    weight = cells.normal[np.arange(len(owner)), cells.axis]
    weight *= weight
    weight *= cells.excess
    pairs = _pairs(cells, owner)
    # Sheets and gaps thinner than a voxel have volume, but no face.
    volume = 1 + np.bincount(owner, weight, len(number))
    _add_products(volume, weight, pairs)
    _add_triples(volume, cells=cells, owner=owner, weight=weight)
    section = np.ones((len(number), 3))
    for axis in range(3):
        # The component along the surface of the cells across the other axes.
        along = _power(1 - np.square(cells.normal[:, axis]), _ALONG)
        along *= weight
        along *= cells.on_face & (cells.axis != axis)
        section[:, axis] += np.bincount(owner, along, len(number))
        third = 3 - cells.axis[pairs.first] - cells.axis[pairs.second]
        pair = np.flatnonzero(third == axis)
        _add_products(section[:, axis], along, pairs.selected(pair))
    shapes = _VoxelShapes(number=number, volume=volume, section=section)
    return shapes, _cell_shapes(cells, weight, pairs)


def _owners(cells: Cells) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " s"]]:
    """Distinct numbers of the cells' voxels, and the index of each cell's voxel."""
    is_next = np.diff(cells.number, prepend=-1) != 0
    return cells.number[is_next], np.cumsum(is_next, dtype=np.int32) - 1


def sides_of(cells: Cells) -> Sides:
    """Cells on the sides of their voxels."""
    number, owner = _owners(cells)
    cell_of_side = np.full((3, 2, len(number)), -1, np.int32)
    face = np.flatnonzero(cells.on_face)
    side = 2 * cells.axis[face] + cells.ahead[face]
    slot = np.multiply(side, len(number), dtype=np.int64) + owner[face]
    cell_of_side.reshape(-1)[slot] = face
    return Sides(cell=cell_of_side, excess=cells.excess, normal=cells.normal)


def cut_voxels(
    shapes: _VoxelShapes, links: CutLinks, shape: tuple[int, ...]
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

    first: Int[np.ndarray, " k"]
    second: Int[np.ndarray, " k"]
    owner: Int[np.ndarray, " k"]
    """Index of the voxel that has both cells."""
    apart: Float[np.ndarray, " k"]
    """1 for cells of different sheets, 0 for those of one."""

    def selected(self, which: np.ndarray) -> "_Pairs":
        """Select pairs by mask or index."""
        return _Pairs(*(column[which] for column in self))


def _pairs(cells: Cells, owner: Int[np.ndarray, " s"]) -> _Pairs:
    # The cells of a voxel are one after the other.
    index_pairs = [np.zeros((2, 0), np.int32)]
    face = np.flatnonzero(cells.on_face).astype(np.int32)
    voxel = owner[face]
    axis = cells.axis[face]
    for apart in range(1, len(face)):
        same = voxel[apart:] == voxel[:-apart]
        if not same.any():
            break
        start = np.flatnonzero(same & (axis[apart:] != axis[:-apart]))
        index_pairs.append(np.stack([face[start], face[start + apart]]))
    first, second = np.concatenate(index_pairs, axis=1)
    first_normal = cells.normal.take(first, axis=0)
    second_normal = cells.normal.take(second, axis=0)
    cosine = np.einsum("ki,ki->k", first_normal, second_normal)
    return _Pairs(
        first=first, second=second, owner=owner[first], apart=1 - np.square(cosine)
    )


def _add_products(
    total: Float[np.ndarray, " m"], weight: Float[np.ndarray, " s"], pairs: _Pairs
) -> None:
    """Add w w' (1 - (n . n')^2) of all pairs to their voxels."""
    product = weight[pairs.first] * weight[pairs.second] * pairs.apart
    total += np.bincount(pairs.owner, product, len(total))


def _add_triples(
    volume: Float[np.ndarray, " m"],
    cells: Cells,
    owner: Int[np.ndarray, " s"],
    weight: Float[np.ndarray, " s"],
) -> None:
    """Add the volume that the three cells of a corner cut together to its voxel."""
    # Few voxels have three cells, and fewer have them across all axes.
    is_corner = np.zeros(len(volume), bool)
    is_corner[owner[:-2][owner[:-2] == owner[2:]]] = True
    face = np.flatnonzero(cells.on_face & is_corner[owner])
    has_cell = np.zeros((3, len(volume)), bool)
    has_cell[cells.axis[face], owner[face]] = True
    corner = np.flatnonzero(has_cell.all(axis=0))
    slot = np.full(len(volume), -1, np.int32)
    slot[corner] = np.arange(len(corner))
    face = face[slot[owner[face]] >= 0]
    side = np.full((3, 2, len(corner)), -1)
    side[cells.axis[face], cells.ahead[face].astype(int), slot[owner[face]]] = face
    for i, j, k in np.ndindex(2, 2, 2):
        corner_cells = np.stack([side[0, i], side[1, j], side[2, k]])
        complete = np.flatnonzero(np.min(corner_cells, axis=0) >= 0)
        x_cell, y_cell, z_cell = corner_cells[:, complete]
        across = np.cross(cells.normal[y_cell], cells.normal[z_cell])
        triple = np.square((cells.normal[x_cell] * across).sum(axis=1))
        volume[corner[complete]] += (
            weight[x_cell] * weight[y_cell] * weight[z_cell] * triple
        )


def _power(base: Float[np.ndarray, " s"], exponent: int) -> Float[np.ndarray, " s"]:
    # By repeated squaring: numpy's power takes a logarithm of each value.
    power = np.ones_like(base)
    while exponent:
        if exponent & 1:
            power *= base
        base = base * base
        exponent >>= 1
    return power


def _cell_shapes(
    cells: Cells, weight: Float[np.ndarray, " s"], pairs: _Pairs
) -> CellShapes:
    # Loss of a cell to the sheets across each axis: their sum, and above less below.
    cell = np.concatenate([pairs.first, pairs.second])
    partner = np.concatenate([pairs.second, pairs.first])
    loss = weight[partner] * np.tile(pairs.apart, 2)
    slot = np.multiply(cell, 3, dtype=np.int64) + cells.axis[partner]
    loss_by_axis = np.bincount(slot, loss, 3 * len(weight)).reshape(-1, 3)
    factor = (
        (1 + loss_by_axis[:, 0]) * (1 + loss_by_axis[:, 1]) * (1 + loss_by_axis[:, 2])
    )
    del loss_by_axis
    np.negative(loss, out=loss, where=~cells.ahead[partner])
    shift = np.bincount(slot, loss, 3 * len(weight)).reshape(-1, 3)
    shift /= 2
    return CellShapes(factor=np.maximum(factor, MIN_OPEN), shift=shift)
