"""Bars and closed meshes of blocks, their runs, and temperatures between nodes."""

from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

import jaxthermo as jt


# The ends of a bar along x; its other sides are adiabatic.
LEFT = jt.Side(normal=(-1.0, 0.0, 0.0))
RIGHT = jt.Side(normal=(1.0, 0.0, 0.0))
UP = jt.Side(normal=(0.0, 0.0, 1.0))
DOWN = jt.Side(normal=(0.0, 0.0, -1.0))

# Cell Fourier number alpha dt / pitch^2 of explicit steps: stable, and not 1/6, where
# the leading errors of space and time cancel and the order would flatter.
_FOURIER = 0.25


class Bar(NamedTuple):
    """Voxels in one row along x, with a fragment that shows each node's temperature."""

    grid: jt.VoxelGrid
    depth: Float[np.ndarray, " n"]
    """Distance of each node from the end at -x [m]."""
    along: Int[np.ndarray, " n"]
    """Index of a fragment of each node, on an adiabatic side."""
    length: float
    """Length of the bar [m]."""

    def end(self, surface: np.ndarray, side: jt.Side) -> float:
        """Surface temperature of one end."""
        normal = self.grid.fragment_normal[:, 0] * side.normal[0]
        return float(surface[normal > 0.9][0])


def bar(cells: int, pitch: float) -> Bar:
    """A bar of `cells` x 1 x 1 voxels along x, centred at the origin."""
    length = cells * pitch
    grid = jt.voxelize(jt.shapes.box((length, pitch, pitch)), pitch)
    top = np.flatnonzero(grid.fragment_normal[:, 2] > 0.9)
    top = top[np.argsort(grid.fragment_position[top, 0])]
    return Bar(
        grid=grid,
        depth=(np.arange(cells) + 0.5) * pitch,
        along=top,
        length=length,
    )


def conductor(conductivity: float, emissivity: float = 0.9) -> jt.Material:
    """A material for steady states, which need only its conductivity [W/(m K)]."""
    return jt.Material(conductivity, 1000.0, 1000.0, emissivity)


def explicit(pitch: float, material: jt.Material) -> jt.ForwardEuler:
    """Explicit Euler in steps that go with the square of the pitch [m]."""
    # The errors of space and time are then of one order together.
    return jt.ForwardEuler(dt=_FOURIER * pitch**2 / float(material.diffusivity))


def run(scene: jt.Scene, times: tuple[float, ...], solver=None) -> jt.Solution:
    """Simulate to the last of the times [s], by default with explicit Euler."""
    if solver is None:
        first = scene.bodies[0]
        assert isinstance(first.material, jt.Material)
        solver = explicit(first.structure.grid.pitch, first.material)
    return jt.simulate(scene, times[-1], times, solver=solver)


def between(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], positions: tuple[float, ...]
) -> list[float]:
    """Interpolate a smooth profile by the cubic through the four nearest points."""
    interpolated = []
    for position in positions:
        near = np.argsort(np.abs(x - position), kind="stable")[:4]
        # In units of the points' distance the fit is well conditioned at any pitch.
        scale = float(np.ptp(x[near]))
        fit = np.polyfit((x[near] - position) / scale, y[near], 3)
        interpolated.append(float(fit[-1]))
    return interpolated


def mirrored(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """A profile continued through a plane of symmetry at x = 0 by two points."""
    position = np.concatenate([-x[1::-1], x])
    value = np.concatenate([y[1::-1], y])
    return position, value


def layered(surface: np.ndarray, grid: jt.VoxelGrid, axis: int, sign=1) -> np.ndarray:
    """Temperatures of the voxels on one side across an axis, by the other two axes."""
    side = np.flatnonzero(sign * grid.fragment_normal[:, axis] > 0.9)
    by_cell = np.full(np.delete(grid.lattice.shape, axis), np.nan)
    cells = np.delete(grid.fragment_voxel[side], axis, 1)
    by_cell[tuple(cells.T)] = surface[side]
    return by_cell


# Corners of a face across the last axis, counter-clockwise from its positive side.
_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def of_blocks(
    solid: Bool[np.ndarray, "a b c"], *planes: Float[np.ndarray, "_"]
) -> jt.Mesh:
    """The surface of the solid blocks between planes across x, y and z [m]."""
    # No two blocks may touch along an edge only: four faces would share it.
    padded = np.pad(solid, 1)
    faces = []
    for axis in range(3):
        for sign in (-1, 1):
            neighbour = np.roll(padded, -sign, axis)
            cells = np.argwhere(solid & ~neighbour[1:-1, 1:-1, 1:-1])
            # In the opposite order for faces that are seen from their negative side.
            corners = np.roll(_CORNERS, axis + 1, axis=1)[::sign].copy()
            corners[:, axis] = (sign + 1) // 2
            quad = cells[:, None] + corners
            faces.append(quad[:, [0, 1, 2]])
            faces.append(quad[:, [0, 2, 3]])
    # Faces share their corners: without that the mesh would have open edges.
    corners, number = np.unique(
        np.concatenate(faces).reshape(-1, 3), axis=0, return_inverse=True
    )
    vertices = [p[corners[:, axis]] for axis, p in enumerate(planes)]
    return jt.Mesh(np.stack(vertices, axis=1), number.reshape(-1, 3), "blocks")


def hollow_hemisphere(inner: float, outer: float) -> jt.Mesh:
    """The upper half of a spherical shell of two radii [m], closed by a flat ring."""
    # Steps from the pole to the ring; four times as many around.
    steps = 32
    angle = np.pi / 2 * np.arange(steps + 1) / steps
    arc = np.column_stack([np.sin(angle), np.cos(angle)])
    # The cosine of a right angle is not 0 in floating point: the ring must be flat.
    arc[-1, 1] = 0.0
    # Out along the inner sphere and back along the outer one.
    profile = np.concatenate([inner / outer * arc, arc[::-1]])
    shell = trimesh.creation.revolve(profile, sections=4 * steps)
    # Widened such that it holds the true volume.
    volume = 2 * np.pi / 3 * (outer**3 - inner**3)
    size = (volume / shell.volume) ** (1 / 3)
    return jt.Mesh(size * shell.vertices, shell.faces, "shell")
