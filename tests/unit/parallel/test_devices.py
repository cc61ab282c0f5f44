"""Full volumes over four devices against one, in a process that has four."""

from pathlib import Path

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.parallel.devices import provide_devices, require_device_memory
from jaxthermo.voxels.sharded_lattice import sharded_lattice
from tests.four_devices import run_on_four


PROGRAM = Path(__file__).with_name("lattices_on_four.py")


def test_four_devices_equal_one_and_go_on_with_each_others_runs(tmp_path):
    assert run_on_four(PROGRAM, "small", tmp_path) == "equal"


@pytest.mark.slow
def test_stencils_and_implicit_steps_on_four_devices_equal_those_on_one(tmp_path):
    assert run_on_four(PROGRAM, "every_kind", tmp_path) == "equal"


@pytest.mark.slow
def test_a_large_body_on_four_devices_equals_that_on_one(tmp_path):
    assert run_on_four(PROGRAM, "large", tmp_path) == "equal"


def test_too_little_memory_of_a_device_is_refused(monkeypatch):
    class Small:
        def memory_stats(self):
            return {"bytes_limit": 1000, "bytes_in_use": 400}

    monkeypatch.setattr(jax, "local_devices", lambda: [Small()])
    require_device_memory(500, "simulating", "use a coarser pitch")
    with pytest.raises(jt.InputError, match="600 B is free: use a coarser pitch, or"):
        require_device_memory(600, "simulating", "use a coarser pitch")


def test_a_process_that_has_its_devices_keeps_them():
    available = jax.device_count()
    provide_devices(available + 1)
    assert jax.device_count() == available


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
