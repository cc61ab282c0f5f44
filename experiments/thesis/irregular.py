"""Irregular levels of the statue in two readings of 6.1, and what covers its left hand.

By depth, level l has cells of 2^l voxels in what is deeper than 2^l - 1. In the reading
as halved copies each level is a copy of the textures above at half their size, as in a
mipmap, one layer deeper inside. Nothing stops the copies where the body ends: a texture
of 100 texels gives 7 levels.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

import jaxthermo as jt
from jaxthermo.structures.kinds.shell import cover_count
from jaxthermo.voxels.lattice import pixel_axes

from .bodies import HEIGHT, buddha


LEVELS = 7
"""Levels that the thesis names."""

# The left hand is above this fraction of the height, and on this side of the middle.
_HAND_FROM = 0.84


class _Copies(NamedTuple):
    """Cubes of all levels, of 2^level voxels an edge."""

    centre: Float[np.ndarray, "n 3"]
    """Centres [voxels from the lowest corner]."""
    level: Int[np.ndarray, " n"]


def _copy_count(grid: jt.VoxelGrid) -> int:
    """Levels until the wide side of the lattice is a single texel."""
    return int(np.log2(min(grid.lattice.shape))) + 1


def _halved_copies(grid: jt.VoxelGrid, levels: int) -> _Copies:
    """Cubes of the halved textures of each axis, moved inward by the levels above.

    Args:
        grid: voxelized with `surface_cells="dominant_axis"`, so that its packed layers
            are the textures.
        levels: number of textures, the surface included.
    """
    centres = []
    numbers = []
    for axis in range(3):
        texels = np.flatnonzero(grid.is_packed(axis))
        for level in range(levels):
            middle = _level_centres(grid, texels=texels, axis=axis, level=level)
            centres.append(middle)
            numbers.append(np.full(len(middle), level))
    return _Copies(np.concatenate(centres), np.concatenate(numbers))


def _level_centres(
    grid: jt.VoxelGrid, texels: Int[np.ndarray, " t"], axis: int, level: int
) -> Float[np.ndarray, "n 3"]:
    size = 1 << level
    row_axis, column_axis = pixel_axes(axis)
    position = grid.lattice.to_cells(grid.fragment_position)[texels]
    inward = -np.sign(grid.fragment_normal[texels, axis])
    coarse_texel = np.floor(position[:, [row_axis, column_axis]]).astype(int) // size
    # Front and back of the body never share a texel, nor do two layers.
    layer = grid.fragment_layer[texels, 1]
    key = np.column_stack([coarse_texel, layer, inward])
    cells, cell_of_texel = np.unique(key, axis=0, return_inverse=True)
    cell_of_texel = cell_of_texel.reshape(-1)
    depth_sum = np.bincount(cell_of_texel, position[:, axis])
    depth = depth_sum / np.bincount(cell_of_texel)
    middle = np.empty((len(cells), 3))
    middle[:, row_axis] = (cells[:, 0] + 0.5) * size
    middle[:, column_axis] = (cells[:, 1] + 0.5) * size
    # Below all levels above, which are 1 + 2 + ... = 2^level - 1 voxels thick.
    middle[:, axis] = depth + cells[:, 3] * (size - 1 + size / 2)
    return middle


def _inside_only(copies: _Copies, grid: jt.VoxelGrid) -> _Copies:
    """The cubes whose centre lies in a solid voxel, and all of the surface."""
    points = grid.origin + copies.centre * grid.pitch
    is_inside = grid.contains(points) | (copies.level == 0)
    return _Copies(copies.centre[is_inside], copies.level[is_inside])


class _Reading(NamedTuple):
    """Cells of one reading."""

    levels: int
    cells: int
    count: Int[np.ndarray, "x y z"]
    """Number of cells that cover each voxel."""

    def shares(
        self, region: Bool[np.ndarray, "x y z"], solid: Bool[np.ndarray, "x y z"]
    ) -> dict[str, float]:
        """Capacity, overlap and cracks over the volume of the body in a region."""
        count = self.count[region]
        inside = solid[region]
        body = int(inside.sum())
        return {
            "capacity": float(count.sum() / body),
            "overlap": float(np.maximum(count[inside] - 1, 0).sum() / body),
            "crack": float((count[inside] == 0).sum() / body),
            "outside": float(count[~inside].sum() / body),
        }


@cache
def readings() -> dict[str, _Reading]:
    """Cells by depth, by halved copies, and by copies whose centres are inside."""
    grid = buddha().grid(HEIGHT, "dominant_axis")
    by_depth = jt.IrregularMultiLevel(grid)
    copies = _halved_copies(grid, min(LEVELS, _copy_count(grid)))
    return {
        "by depth": _Reading(
            levels=by_depth.level_count,
            cells=by_depth.node_count,
            count=by_depth.cover_count(),
        ),
        "halved copies": _reading(copies, grid),
        "halved copies, centres inside": _reading(_inside_only(copies, grid), grid),
    }


def _reading(copies: _Copies, grid: jt.VoxelGrid) -> _Reading:
    return _Reading(
        levels=int(copies.level.max()) + 1,
        cells=len(copies.level),
        count=cover_count(copies.centre, copies.level, grid.lattice.shape),
    )


def regions() -> dict[str, Bool[np.ndarray, "x y z"]]:
    """The whole lattice, the left hand, and the right one to compare it with."""
    grid = buddha().grid(HEIGHT, "dominant_axis")
    x, y, z = grid.lattice.shape
    above = np.arange(z) >= _HAND_FROM * z
    left = np.arange(x) >= x / 2
    everywhere = np.ones((x, y, z), bool)
    return {
        "whole statue": everywhere,
        "left hand": everywhere & left[:, None, None] & above,
        "right hand": everywhere & ~left[:, None, None] & above,
    }


def shares_of_readings() -> dict[str, dict[str, int | dict[str, float]]]:
    """Levels and cells of every reading, and its shares in every region."""
    solid = buddha().grid(HEIGHT, "dominant_axis").solid
    return {
        name: {
            "levels": reading.levels,
            "cells": reading.cells,
            **{
                where: reading.shares(region, solid)
                for where, region in regions().items()
            },
        }
        for name, reading in readings().items()
    }


def hand_of_surface(grid: jt.VoxelGrid) -> dict[str, Bool[np.ndarray, " s"]]:
    """Flags of the fragments of the whole surface and of both hands."""
    position = grid.fragment_position
    low, high = grid.mesh.bounds
    hand_height = low[2] + _HAND_FROM * (high[2] - low[2])
    above = position[:, 2] > hand_height
    left = position[:, 0] > (low[0] + high[0]) / 2
    return {
        "whole surface": np.ones(len(position), bool),
        "left hand": above & left,
        "right hand": above & ~left,
    }
