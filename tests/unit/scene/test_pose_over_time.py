"""Poses over time: _between two poses straight and at a constant rate of turn."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation, Slerp

from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.scene.motion import Motion, PoseTable, _between


def turned(rotation, translation=(0.0, 0.0, 0.0)):
    return Pose(translation, tuple(tuple(row) for row in rotation.as_matrix().tolist()))


def about_z(degrees, translation=(0.0, 0.0, 0.0)):
    return turned(Rotation.from_euler("z", degrees, degrees=True), translation)


@settings(deadline=None, max_examples=50)
@given(
    seed=st.integers(0, 10**6),
    share=st.floats(0, 1),
    turn=st.sampled_from([1e-12, 1e-8, 1e-3, 1.0, 3.1]),
)
def test_turns_are_those_of_scipy(seed, share, turn):
    random = np.random.default_rng(seed)
    first = Rotation.from_quat(random.normal(size=4))
    axis = random.normal(size=3)
    second = first * Rotation.from_rotvec(turn * axis / np.linalg.norm(axis))
    expected = Slerp([0.0, 1.0], Rotation.concatenate([first, second]))(share)
    actual = _between(turned(first), turned(second), share)
    assert np.abs(np.array(actual.rotation) - expected.as_matrix()).max() < 1e-12


def test_half_a_turn_keeps_its_rate():
    quarter = _between(about_z(0.0), about_z(180.0), 0.25)
    angle = Rotation.from_matrix(np.array(quarter.rotation)).magnitude()
    assert angle == pytest.approx(math.pi / 4)


def test_a_table_is_met_at_its_times_and_held_beyond_them():
    poses = (about_z(10.0, (1.0, 2.0, 3.0)), about_z(50.0, (3.0, 2.0, 1.0)))
    motion = Motion(PoseTable((2.0, 4.0), poses))
    assert motion.at(0.0) == motion.at(2.0) == poses[0]
    assert motion.at(4.0) == motion.at(9) == poses[1]
    middle = motion.at(2.5)
    assert middle.translation == pytest.approx((1.5, 2.0, 2.5))
    assert np.allclose(middle.rotation, about_z(20.0).rotation)


def test_a_function_is_asked():
    motion = Motion(lambda time: Pose((0.0, 0.0, 2.0 * time)), every=0.5)
    assert motion.at(3).translation == (0.0, 0.0, 6.0)
    assert not motion.is_still


def test_moments():
    table = PoseTable((0.0, 1.0, 3.0), (about_z(0.0), about_z(90.0), about_z(0.0)))
    assert Motion(table).snapshot_times(3.0) == (1.0,)
    assert Motion(table).snapshot_times(4.0) == (1.0, 3.0)
    assert Motion(table, every=0.75).snapshot_times(3) == (0.75, 1.5, 2.25)
    assert Motion(table, every=0.1).snapshot_times(0.3) == pytest.approx((0.1, 0.2))
    assert Motion(table, every=5.0).snapshot_times(3.0) == ()


def test_equal_poses_are_still():
    still = Motion(PoseTable([0, 1], [about_z(30.0), about_z(30.0)]), every=0.1)
    assert still.is_still and still.snapshot_times(10.0) == ()
    assert not Motion(PoseTable((0, 1), (about_z(30.0), about_z(31.0)))).is_still


NUMBER: Any = 3.0


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (lambda: PoseTable((), ()), "0 times and 0 poses"),
        (lambda: PoseTable((0, 1), (Pose(),)), "2 times and 1 poses"),
        (lambda: PoseTable((1, 1), (Pose(), Pose())), "increase"),
        (lambda: PoseTable((0, math.inf), (Pose(), Pose())), "finite"),
        (lambda: Motion(lambda time: Pose()), "every="),
        (lambda: Motion(NUMBER), "PoseTable or a function"),
        (lambda: Motion(lambda time: Pose(), every=0.0), "positive number"),
        (lambda: Motion(lambda time: Pose(), every=math.nan), "positive number"),
        (lambda: Motion(lambda time: NUMBER, every=1.0).at(2.0), "not a Pose"),
        (
            lambda: Motion(lambda time: Pose(), every=1e-9).snapshot_times(60.0),
            "give 0.006 s or more",
        ),
    ],
)
def test_mistakes_are_told_in_one_line(mistake, message):
    with pytest.raises(InputError, match=message) as told:
        mistake()
    assert "\n" not in str(told.value)
