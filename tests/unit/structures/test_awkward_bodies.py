"""Bodies that leave a structure little to work with still give temperatures."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import blocks
from tests.shallow import SHALLOW


pytestmark = pytest.mark.slow

METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
KINDS = {
    "full": lambda g: jt.FullVolume(g),
    "shell": lambda g: jt.SingleShell(g, capacity="body"),
    "levels": lambda g: jt.MultiLevel(g, levels=3),
    "innermost": lambda g: jt.MultiLevel(g, levels=1, hollow="innermost"),
    "irregular": lambda g: jt.IrregularMultiLevel(g),
    "octree": lambda g: jt.Octree(g),
    "aggregate": lambda g: jt.Aggregate(g, factor=4),
    "core": lambda g: jt.ShellOverCore(g, layers=2, factor=3),
    "labels": lambda g: jt.Partition(g, np.indices(g.solid.shape)[0]),
}


def _apart():
    solid = np.zeros((7, 3, 3), bool)
    solid[:3] = True
    solid[4:] = True
    return solid


def _with_a_lone_voxel():
    solid = np.ones((4, 4, 6), bool)
    solid[..., 4:] = False
    solid[1, 1, 5] = True
    return solid


BODIES = {
    "one voxel": np.ones((1, 1, 1), bool),
    "one voxel thick": np.ones((5, 4, 1), bool),
    "a thread": np.ones((1, 1, 6), bool),
    "two parts": _apart(),
    "a lone voxel": _with_a_lone_voxel(),
}


@SHALLOW
@pytest.mark.parametrize(
    "body",
    [
        pytest.param(name, marks=[pytest.mark.slice] * (name == "one voxel"))
        for name in BODIES
    ],
)
def test_every_structure_of_it_warms_and_keeps_its_heat(body):
    """Finite, above the start, and with a closed ledger."""
    grid = blocks(BODIES[body], 0.01)
    terms = (jt.HeatFlux(500.0), jt.Convection(5.0, 300.0))
    for name, make in KINDS.items():
        structure = make(grid)
        solid = jt.Body(structure, METAL, temperature=300.0)
        scene = jt.Scene((solid,), terms, dtype="float64")
        solution = jt.simulate(scene, 2.0, solver=jt.ForwardEuler(0.5))
        surface = np.asarray(solution.surface_temperature)
        assert np.isfinite(surface).all(), name
        assert surface.min() > 300.0, name
        assert abs(float(solution.energy.residual_relative[0])) < 1e-12, name
        assert solution.result == jt.RESULTS.successful
