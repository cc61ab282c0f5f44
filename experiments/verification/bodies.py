"""Bars, columns and closed meshes of blocks, and reading temperatures between nodes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import box
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.selection import Side
from jaxthermo.voxels.voxelize import voxelize


LEFT, RIGHT = Side(normal=(-1.0, 0.0, 0.0)), Side(normal=(1.0, 0.0, 0.0))
"""The ends of a bar along x; its other sides are adiabatic."""

FOURIER = 0.25
"""Cell Fourier number alpha dt / pitch^2 of explicit steps: stable, and not 1/6,
where the leading errors of space and time cancel and the order would flatter."""


class Bar(NamedTuple):
    """Voxels in one row along x, with a fragment that shows each node's temperature."""

    grid: VoxelGrid
    depth: Float[np.ndarray, " n"]
    """Distance of each node from the end at -x [m]."""
    along: Int[np.ndarray, " n"]
    """Index of a fragment of each node, on an adiabatic side."""
    length: float
    """[m]"""

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    def end(self, surface: np.ndarray, side: Side) -> float:
        """The surface of one end."""
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
    """Interpolate a smooth profile by the cubic through the four nearest points."""
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


_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
"""Corners of a face across the last axis, counter-clockwise from its positive side."""


def of_blocks(
    solid: Bool[np.ndarray, "a b c"],
    x: Float[np.ndarray, " i"],
    y: Float[np.ndarray, " j"],
    z: Float[np.ndarray, " k"],
) -> Mesh:
    """The surface of the blocks between planes that are solid.

    Args:
        solid: which are; no two may touch along an edge only.
        x: of the planes across x, one more than blocks [m].
        y: likewise.
        z: likewise.
    """
    padded, faces = np.pad(solid, 1), []
    for axis in range(3):
        for sign in (-1, 1):
            open_ = ~np.roll(padded, -sign, axis)[1:-1, 1:-1, 1:-1]
            cells = np.argwhere(solid & open_)
            corners = np.roll(_CORNERS, axis + 1, axis=1)[::sign].copy()
            corners[:, axis] = (sign + 1) // 2
            quad = cells[:, None] + corners
            faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    places = np.concatenate(faces).reshape(-1, 3)
    vertices, number = np.unique(places, axis=0, return_inverse=True)
    planes = [p[vertices[:, axis]] for axis, p in enumerate((x, y, z))]
    return Mesh(np.stack(planes, axis=1), number.reshape(-1, 3), "blocks")


def hollow_hemisphere(inner: float, outer: float, steps: int = 32) -> Mesh:
    """The upper half of a spherical shell around the origin, closed by a flat ring.

    Both spheres are widened such that each of them holds its true volume.

    Args:
        inner: radius of the hollow [m].
        outer: radius [m].
        steps: from the pole to the ring; four times as many around.
    """
    rings = 4 * steps
    turn = 2 * np.pi * np.arange(rings) / rings
    angle = np.pi / 2 * np.arange(1, steps + 1) / steps
    unit = np.stack(
        [
            np.outer(np.sin(angle), np.cos(turn)),
            np.outer(np.sin(angle), np.sin(turn)),
            np.outer(np.cos(angle), np.ones(rings)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    unit[-rings:, 2] = 0.0
    unit = np.concatenate([unit, [[0.0, 0.0, 1.0]]])
    cap = _cap(steps, rings)
    corners = unit[cap]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    wide = float((2 * np.pi / 3 / (volume / 6)) ** (1 / 3))
    count, this = len(unit), np.arange(rings)
    after = np.roll(this, -1)
    last = (steps - 1) * rings
    rim, hole = last + np.stack([this, after]), count + last + np.stack([this, after])
    ring = [
        np.stack([rim[0], hole[0], rim[1]], axis=1),
        np.stack([rim[1], hole[0], hole[1]], axis=1),
    ]
    vertices = np.concatenate([outer * wide * unit, inner * wide * unit])
    return Mesh(vertices, np.concatenate([cap, cap[:, ::-1] + count, *ring]), "shell")


def _cap(steps: int, rings: int) -> np.ndarray:
    """Triangles of a hemisphere, outward; the pole is the last vertex."""
    this = np.arange(rings)
    after, pole = np.roll(this, -1), np.full(rings, steps * rings)
    faces = [np.stack([pole, this, after], axis=1)]
    for step in range(steps - 1):
        up, low = step * rings, (step + 1) * rings
        faces += [
            np.stack([up + this, low + this, up + after], axis=1),
            np.stack([up + after, low + this, low + after], axis=1),
        ]
    return np.concatenate(faces)
