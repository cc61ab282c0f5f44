"""Bars and columns of voxels, and what is read from them between their nodes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxthermo.geometry.shapes import box
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.selection import Side
from jaxthermo.voxels.voxelize import voxelize


LEFT, RIGHT = Side(normal=(-1.0, 0.0, 0.0)), Side(normal=(1.0, 0.0, 0.0))
"""The ends of a bar along x; nothing passes through its other sides."""

FOURIER = 0.25
"""Of explicit steps along a bar, alpha dt / pitch^2: stable, and not 1/6, at which the
leading errors of space and time cancel and the order would flatter."""


class Bar(NamedTuple):
    """Voxels in one row along x; the sides show what the nodes have."""

    grid: VoxelGrid
    depth: Float[np.ndarray, " n"]
    """Of the nodes, from the end at -x [m]."""
    along: Int[np.ndarray, " n"]
    """A fragment of each, on a side that nothing passes through."""
    length: float
    """[m]"""

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    def end(self, surface: np.ndarray, side: Side) -> float:
        """The surface of one end.

        Args:
            surface: of every fragment.
            side: which end.
        """
        normal = self.grid.fragment_normal[:, 0] * side.normal[0]
        return float(surface[normal > 0.9][0])


def bar(cells: int, pitch: float) -> Bar:
    """A bar of `cells` x 1 x 1 voxels along x, centred at the origin."""
    grid = voxelize(box((cells * pitch, pitch, pitch)), pitch)
    top = np.flatnonzero(grid.fragment_normal[:, 2] > 0.9)
    top = top[np.argsort(grid.fragment_position[top, 0])]
    return Bar(grid, (np.arange(cells) + 0.5) * pitch, top, cells * pitch)


def between(
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    places: tuple[float, ...],
) -> list[float]:
    """A smooth profile at some places: the cubic through the four nearest points.

    Args:
        x: where it is known.
        y: what it is there.
        places: where it is asked for.
    """
    found = []
    for place in places:
        near = np.argsort(np.abs(x - place), kind="stable")[:4]
        scale = float(np.ptp(x[near]))
        fit = np.polyfit((x[near] - place) / scale, y[near], 3)
        found.append(float(fit[-1]))
    return found


def mirrored(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """A profile continued through a plane of symmetry at x = 0 by two points."""
    return np.concatenate([-x[1::-1], x]), np.concatenate([y[1::-1], y])


def layered(solution_surface: np.ndarray, grid: VoxelGrid) -> np.ndarray:
    """Nodes of a body one voxel thick along y, of its side +y [x z]."""
    side = np.flatnonzero(grid.fragment_normal[:, 1] > 0.9)
    wide, _, high = grid.lattice.shape
    found = np.full((wide, high), np.nan)
    cell = grid.fragment_voxel[side]
    found[cell[:, 0], cell[:, 2]] = solution_surface[side]
    return found
