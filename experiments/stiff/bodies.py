"""Bodies and materials of the cases: boxes of few voxels, of few shapes.

What has the same shape and mechanisms runs as the same program, whatever its numbers.
"""

import functools

import jax
import numpy as np

import jaxthermo as jt


AEROGEL = jt.Material(0.013, density=100.0, specific_heat=1000.0)
DIAMOND = jt.Material(2000.0, density=3510.0, specific_heat=508.0)
AIR = jt.Material(0.026, density=1.18, specific_heat=1006.0)
COPPER = jt.Material(401.0, density=8960.0, specific_heat=385.0)
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=1.0)

COLD, HOT = 300.0, 400.0
"""Temperatures of the two halves of a body at the start [K]."""


@functools.cache
def block(x: int, y: int, z: int, pitch: float) -> jt.VoxelGrid:
    """A box of so many voxels of `pitch` [m], centred at the origin."""
    mesh = jt.shapes.box((x * pitch, y * pitch, z * pitch))
    # Also where it is first asked for in what is being traced.
    with jax.ensure_compile_time_eval():
        return jt.voxelize(mesh, pitch)


def two_halves(points: np.ndarray) -> np.ndarray:
    """Hot where x is negative, cold elsewhere [K]."""
    return np.where(points[:, 0] < 0, HOT, COLD)


def pattern(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Material 0 or 1 of every voxel."""
    index = np.indices(shape)
    number = {
        "laminate": index[0] % 2,
        "checkerboard": index.sum(axis=0) % 2,
        "uniform": np.ones(shape),
    }
    return number[name].astype(np.int32)


def labelled(
    grid: jt.VoxelGrid,
    name: str,
    pair: tuple[jt.Material, jt.Material],
    temperature=two_halves,
) -> jt.Body:
    """A body of two materials in a pattern, hot and cold by halves."""
    labels = jt.MaterialLabels(pattern(name, grid.solid.shape), pair)
    return jt.Body(jt.FullVolume(grid), labels, temperature=temperature)


def beside(grid: jt.VoxelGrid, x: float, material, temperature) -> jt.Body:
    """A body moved along x.

    Args:
        grid: its voxels.
        x: its place [m].
        material: of the body.
        temperature: at the start, as of `Body`.
    """
    pose = jt.Pose(translation=(x, 0.0, 0.0))
    return jt.Body(jt.FullVolume(grid), material, temperature=temperature, pose=pose)
