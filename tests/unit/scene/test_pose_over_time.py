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


@pytest.mark.parametrize(
    ("angles", "share", "degrees"),
    [
        ((0.0, 360.0), 0.25, 90.0),
        ((0.0, 270.0), 1 / 3, 90.0),
        ((0.0, 180.0), 0.75, 135.0),
        ((30.0, -700.0), 0.5, -335.0),
        ((-360.0, 720.0), 0.1, -252.0),
    ],
)
def test_poses_by_angle_turn_by_the_difference_of_their_angles(angles, share, degrees):
    first, second = (Pose.about((0, 0, 2), math.radians(angle)) for angle in angles)
    actual = np.array(_between(first, second, share).rotation)
    assert np.abs(actual - np.array(about_z(degrees).rotation)).max() < 1e-13
    # About the opposite axis angles are of opposite sign.
    opposite = Pose.about((0, 0, -1), -math.radians(angles[1]))
    reversed_axis = np.array(_between(first, opposite, share).rotation)
    assert np.abs(reversed_axis - actual).max() < 1e-13
    motion = Motion(PoseTable((0.0, 1.0), (first, second)))
    assert not motion.is_still


def test_a_pose_without_rotation_is_at_angle_0_about_any_axis():
    full = Pose.about((1.0, 2.0, 3.0), 2 * math.pi)
    half = Pose.about((1.0, 2.0, 3.0), math.pi)
    for first, second in ((Pose(), full), (full, Pose())):
        assert np.allclose(_between(first, second, 0.5).rotation, half.rotation)


def test_poses_about_different_axes_turn_the_short_way():
    first = Pose.about((1, 0, 0), math.radians(350.0))
    second = Pose.about((0, 0, 1), math.radians(20.0))
    by_matrix = Pose(rotation=first.rotation), Pose(rotation=second.rotation)
    expected = np.array(_between(by_matrix[0], by_matrix[1], 0.5).rotation)
    assert np.array_equal(_between(first, second, 0.5).rotation, expected)


@pytest.mark.parametrize(
    ("poses", "every", "pattern"),
    [
        ((about_z(10.0), about_z(190.0)), 1.0, "poses at 0 and 60 s are half a turn"),
        ((Pose(), Pose.about((0, 0, 1), math.pi)), 5.0, None),
        ((about_z(10.0), about_z(189.0)), 1.0, None),
        ((Pose(), Pose.about((0, 0, 1), 2 * math.pi)), None, "turns by 360 degrees"),
        ((Pose(), Pose.about((0, 0, 1), 20.0)), 12.0, "between its snapshots at"),
        ((Pose(), Pose.about((0, 0, 1), 20.0)), 2.0, None),
    ],
)
def test_a_way_that_is_open_is_told(poses, every, pattern):
    motion = Motion(PoseTable((0.0, 60.0), poses), every=every)
    warnings = list(motion.warnings((0.0, *motion.snapshot_times(60.0)), 60.0))
    if pattern is None:
        assert not warnings
    else:
        (warning,) = warnings
        assert pattern in warning and "give" in warning


NUMBER: Any = 3.0


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (lambda: PoseTable((), ()), "0 times and 0 poses"),
        (lambda: PoseTable((0, 1), (Pose(),)), "2 times and 1 poses"),
        (lambda: PoseTable((1, 1), (Pose(), Pose())), "increase"),
        (lambda: PoseTable((0, math.inf), (Pose(), Pose())), "finite"),
        (lambda: Pose.about((0, 0, 0), 1.0), "axis"),
        (lambda: Pose.about((0, 0, 1), math.inf), "finite angle"),
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
