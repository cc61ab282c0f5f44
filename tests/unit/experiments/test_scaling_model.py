"""Steps over many devices, on paper: the numbers of a cube by hand."""

import pytest

from experiments.benchmarks.scaling_model import Machine, on_paper


MACHINE = Machine("by hand", 1e12, 1e11, 1e10, 0.0)


def test_a_cube_of_a_billion_voxels():
    assert MACHINE.interior_time(1e9, 9) == pytest.approx(1e-3)
    # Two planes of a million voxels.
    assert MACHINE.halo_time(1e9) == pytest.approx(8e-4)
    assert MACHINE.useful_devices(1e9) == pytest.approx(9 * 1000 * 1e10 / (8 * 1e12))
    assert MACHINE.fewest_devices(1e9) == 1
    assert MACHINE.fewest_devices(1e12) == 145


def test_a_block_sends_six_faces():
    # Eight cubes of 500 voxels.
    assert MACHINE.block_time(1e9, 8) == pytest.approx(6 * 4 * 500**2 / 1e10)


def test_more_devices_than_are_useful_gain_nothing():
    for row in on_paper():
        assert row["useful"] >= row["fewest"] >= 1
        assert row["step_on_useful_s"] <= row["step_on_fewest_s"]
        if row["useful"] > 1:
            assert row["step_on_useful_s"] >= row["planes_s"]
