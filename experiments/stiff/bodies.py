"""Bodies and scenes of the cases: boxes of few voxels, of few shapes.

Scenes with equal shapes and mechanisms run as one program, whatever their numbers.
"""

import functools

import jax
import numpy as np

import jaxthermo as jt
from jaxthermo.choices import Dtype

from ..harness.scenes import single


AEROGEL = jt.Material(0.013, density=100.0, specific_heat=1000.0)
DIAMOND = jt.Material(2000.0, density=3510.0, specific_heat=508.0)
COPPER = jt.Material(401.0, density=8960.0, specific_heat=385.0)
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=1.0)

COLD = 300.0
HOT = 400.0
"""Temperatures of the two halves of a body at the start [K]."""

CELLS = (16, 6, 6)
PITCH = 1e-3
"""Voxels along x, y and z of the bodies of two materials, and their edge [m]."""

LENGTH = 0.1
"""Length of a rod [m]."""
AIR = 300.0
START = 400.0
"""Temperatures of the rod's air and of the rod at the start [K]."""


@functools.cache
def block(x: int, y: int, z: int, pitch: float) -> jt.VoxelGrid:
    """A box of x * y * z voxels of `pitch` [m], centred at the origin."""
    mesh = jt.shapes.box((x * pitch, y * pitch, z * pitch))
    # The first call may come from a function that is being traced.
    with jax.ensure_compile_time_eval():
        return jt.voxelize(mesh, pitch)


def two_halves(points: np.ndarray) -> np.ndarray:
    """Hot where x is negative, cold elsewhere [K]."""
    return np.where(points[:, 0] < 0, HOT, COLD)


def insulated(name: str, pair, dtype: Dtype, temperature=two_halves) -> jt.Scene:
    """A body of two materials in a pattern that exchanges heat with nothing."""
    index = np.indices(CELLS)
    # A uniform body has two materials as well: all run as one program.
    labels = {
        "laminate": index[0] % 2,
        "checkerboard": index.sum(axis=0) % 2,
        "uniform": np.ones(CELLS),
    }
    material = jt.MaterialLabels(labels[name].astype(np.int32), pair)
    grid = block(*CELLS, pitch=PITCH)
    return single(grid, material, temperature, dtype=dtype)


def rod(cells: int, material: jt.Material, h: float) -> jt.Scene:
    """A line of voxels that convects at one end, with h [W/(m^2 K)]."""
    air = jt.Convection(h, AIR, on=jt.Side((1.0, 0.0, 0.0)))
    grid = block(cells, 1, 1, pitch=LENGTH / cells)
    return single(grid, material, START, air)
