"""Small simulations by name, and the bits of their results, in any process."""

import hashlib

import jax
import numpy as np

import jaxthermo as jt


END = 120.0
SAVE_AT = (60.0, END)
NAMES = ("block", "contact", "block", "contact")
"""Scenes that are simulated at once: each is met by itself and by another one."""


def scene(name: str, factor: float = 1.0) -> jt.Scene:
    """One body, or two in contact, with numbers that are multiplied by a factor."""
    steel = jt.Material(16.0 * factor, density=8000.0, specific_heat=500.0)
    sun = jt.Sun((-1.0, 0.0, -1.0), 800.0 * factor)
    air = jt.Convection(10.0 * factor, 293.15)
    grid = jt.voxelize(jt.shapes.box((0.04, 0.03, 0.03)), 0.01)
    block = jt.Body(jt.FullVolume(grid), steel, temperature=300.0)
    if name == "block":
        return jt.Scene((block,), (sun, air))
    upper_grid = jt.voxelize(jt.shapes.box((0.02, 0.02, 0.04)), 0.01)
    upper = jt.Body(
        jt.Aggregate(upper_grid, 2),
        steel,
        temperature=350.0,
        pose=jt.Pose((0.0, 0.0, 0.035)),
    )
    return jt.Scene((block, upper), (jt.Contact(500.0), sun, air))


def bits(solution: jt.Solution) -> str:
    """Hash of the saved temperatures and of the energy."""
    digest = hashlib.sha256()
    results = (
        solution.surface_temperature,
        solution.mean_temperature,
        solution.energy,
    )
    for values in jax.tree.leaves(results):
        digest.update(np.asarray(values).tobytes())
    return digest.hexdigest()[:16]


def simulated(name: str, factor: float = 1.0) -> str:
    """Bits of a simulation of a scene."""
    return bits(jt.simulate(scene(name, factor), END, SAVE_AT))


def compiled(name: str) -> jt.CompiledSimulation:
    """The compiled simulation of a scene."""
    return jt.compile_simulation(scene(name), END, SAVE_AT)
