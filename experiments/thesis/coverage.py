"""Irregular levels of the statue in two readings, and what covers its left hand."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

import jaxthermo as jt

from .bodies import buddha
from .nested_copies import copy_count, cover_count, halved_copies, inside_only


HEIGHT = 250
"""Voxels along up, of the thesis' 100x250x100; quick, so also in the reduced size."""
LEVELS = 7
"""Levels that the thesis names."""

# The left hand is above this part of the height, and on this side of the middle.
_HAND_FROM = 0.84


class Reading(NamedTuple):
    """Cells of one reading."""

    name: str
    levels: int
    cells: int
    count: Int[np.ndarray, "x y z"]
    """Number of cells that cover each voxel."""

    def within(
        self, region: Bool[np.ndarray, "x y z"], solid: Bool[np.ndarray, "x y z"]
    ) -> dict[str, float]:
        """Capacity, overlap and cracks over the volume of the body in a region."""
        own, inside = self.count[region], solid[region]
        body = int(inside.sum())
        return {
            "capacity": float(own.sum() / body),
            "overlap": float(np.maximum(own[inside] - 1, 0).sum() / body),
            "crack": float((own[inside] == 0).sum() / body),
            "outside": float(own[~inside].sum() / body),
        }


@cache
def readings() -> tuple[Reading, ...]:
    """Cells by depth, by halved copies, and by copies that are kept inside."""
    grid = buddha().grid(HEIGHT, "dominant_axis")
    nested = jt.IrregularMultiLevel(grid)
    copies = halved_copies(grid, min(LEVELS, copy_count(grid)))
    kept = inside_only(copies, grid)
    by_depth = nested.cover_count()
    count = lambda cells: int(cells.level.max()) + 1
    return (
        Reading("by depth", nested.level_count, nested.node_count, by_depth),
        Reading(
            "halved copies",
            count(copies),
            len(copies.level),
            cover_count(copies, grid),
        ),
        Reading(
            "halved copies, centres inside",
            count(kept),
            len(kept.level),
            cover_count(kept, grid),
        ),
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


def measured() -> dict[str, dict[str, Any]]:
    """Shares of every reading in every region."""
    solid = buddha().grid(HEIGHT, "dominant_axis").solid
    return {
        reading.name: {
            "levels": reading.levels,
            "cells": reading.cells,
            **{name: reading.within(at, solid) for name, at in regions().items()},
        }
        for reading in readings()
    }
