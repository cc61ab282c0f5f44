"""Full volumes over four devices against one, in a process that has four."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.parallel.devices import provide_devices, require_device_memory
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

RESUMED = """
from pathlib import Path
import numpy as np
import jaxthermo as jt
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.scene.compile.on_devices import on_devices

grid = jt.voxelize(jt.shapes.box((0.02, 0.07, 0.03)), 0.01)
body = jt.Body(
    jt.FullVolume(grid),
    jt.materials["copper"],
    temperature=lambda points: 300 + 500 * points[:, 1],
)
scene = jt.Scene((body,), (jt.Convection(50.0, 280.0),))
plans = {
    count: plan_run(on_devices(scene, count), 20.0, [10.0, 20.0], jt.ForwardEuler())
    for count in (1, 2, 4)
}


def finished(plan, progress):
    for progress in run_segments(plan, progress, 0.0):
        pass
    return np.asarray(finish_run(plan, progress).surface_temperature)


straight = finished(plans[1], begin_run(plans[1]))
path = Path("checkpoint.npz")
for before, after in ((4, 1), (1, 4), (4, 2)):
    plan, other = plans[before], plans[after]
    progress = next(iter(run_segments(plan, begin_run(plan), 0.0)))
    save_checkpoint(path, plan, progress, "key")
    kept = load_checkpoint(path, other, begin_run(other), "key")
    assert kept is not None and kept.steps_taken == 2, kept
    assert len(kept.state.theta[0].sharding.device_set) == after
    resumed = finished(other, kept)
    assert np.abs(resumed - straight).max() <= 1.3e-4, (before, after)
print("equal")
"""


def run_on_four(program: str, folder: Path) -> str:
    environment = os.environ | {"XLA_FLAGS": FOUR, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=environment,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_four_devices_equal_one(tmp_path):
    solvers = "jt.ForwardEuler(), jt.SuperTimeStepping(dt=1.0)"
    assert run_on_four(RUN.replace("{SOLVERS}", solvers), tmp_path) == "equal"


@pytest.mark.slow
def test_implicit_steps_on_four_devices_equal_one(tmp_path):
    solvers = "jt.BackwardEuler(dt=2.0), jt.TRBDF2(dt=2.0)"
    assert run_on_four(RUN.replace("{SOLVERS}", solvers), tmp_path) == "equal"


def test_a_run_goes_on_on_another_number_of_devices(tmp_path):
    assert run_on_four(RESUMED, tmp_path) == "equal"


def test_too_little_memory_of_a_device_is_refused(monkeypatch):
    class Small:
        def memory_stats(self):
            return {"bytes_limit": 1000, "bytes_in_use": 400}

    monkeypatch.setattr(jax, "local_devices", lambda: [Small()])
    require_device_memory(500, "simulating", "use a coarser pitch")
    with pytest.raises(jt.InputError, match="600 B is free: use a coarser pitch, or"):
        require_device_memory(600, "simulating", "use a coarser pitch")


def test_a_process_that_has_its_devices_keeps_them():
    there = jax.device_count()
    provide_devices(there + 1)
    assert jax.device_count() == there


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
