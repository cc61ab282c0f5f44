"""Full volumes over four devices against one, in a process that has four."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.voxels.sharded_lattice import sharded_lattice


ROOT = Path(__file__).resolve().parents[3]
FOUR = "--xla_force_host_platform_device_count=4"

RUN = """
import numpy as np
import jaxthermo as jt

mesh = jt.shapes.sphere(0.05)
grid = jt.voxelize(mesh, 0.1 / 11, "dominant_axis")
body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
terms = (jt.Convection(50.0, 280.0), jt.Sun((-1.0, 0.0, -0.2), 800.0))
scene = jt.Scene((body,), terms)
solvers = {SOLVERS}
for solver in solvers:
    one = jt.simulate(scene, 20.0, [5.0, 20.0], solver=solver)
    four = jt.simulate(scene, 20.0, [5.0, 20.0], solver=solver, devices=4)
    apart = np.abs(np.asarray(one.surface_temperature - four.surface_temperature))
    assert one.surface_temperature.min() < 299.9
    # Four roundings of a temperature in float32.
    assert apart.max() <= 1.3e-4, (solver, apart.max())
    assert np.abs(np.asarray(four.energy.residual_relative)).max() < 1e-5
try:
    jt.simulate(scene, 20.0, devices=5)
except jt.InputError as error:
    assert "there are 4 cpu devices; give at most 4" in str(error)
else:
    raise AssertionError("five of four devices")
print("equal")
"""


def run_on_four(solvers: str) -> str:
    environment = os.environ | {"XLA_FLAGS": FOUR, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", RUN.replace("{SOLVERS}", solvers)],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_four_devices_equal_one():
    assert run_on_four("jt.ForwardEuler(), jt.SuperTimeStepping(dt=1.0)") == "equal"


@pytest.mark.slow
def test_implicit_steps_on_four_devices_equal_one():
    assert run_on_four("jt.BackwardEuler(dt=2.0), jt.TRBDF2(dt=2.0)") == "equal"


def test_sections_hold_every_voxel_once():
    solid = np.ones((3, 9, 2), bool)
    lattice = sharded_lattice(solid, 3)
    cells = lattice.cells(np.argwhere(solid))
    assert len(np.unique(cells, axis=0)) == solid.sum()
    # Two empty cells between sections of three.
    assert sorted(set(cells[:, 0])) == [0, 1, 2, 5, 6, 7, 10, 11, 12]
    assert lattice.shape == (13, 3, 2)


def test_more_devices_than_planes_are_refused():
    with pytest.raises(jt.InputError, match="at most 3 devices"):
        sharded_lattice(np.ones((2, 3, 2), bool), 5)


def test_more_devices_than_there_are_are_refused():
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    with pytest.raises(jt.InputError, match="give at most"):
        jt.simulate(jt.Scene((body,)), 1.0, devices=999)
