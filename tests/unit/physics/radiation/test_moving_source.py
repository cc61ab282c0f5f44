"""Tables of points and directions: on the way between them, and what is refused."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.errors import InputError


NUMBERS = st.tuples(*[st.floats(-10, 10)] * 3)
DIRECTIONS = NUMBERS.filter(lambda v: np.linalg.norm(v) > 1e-3)


def test_a_point_goes_straight_and_stops_at_the_ends():
    table = jt.PointTable([0, 10, 30], [[0, 0, 0], [1, 0, 0], [1, 4, 0]])
    assert table(-5.0) == (0, 0, 0)
    assert table(2.5) == (0.25, 0, 0)
    assert table(10.0) == (1, 0, 0)
    assert table(20.0) == (1, 2, 0)
    assert table(99.0) == (1, 4, 0)


def test_a_direction_turns_at_a_constant_rate():
    table = jt.DirectionTable((0.0, 90.0), ((2, 0, 0), (0, 0, -5)))
    for time in (0.0, 1.0, 30.0, 89.0, 90.0):
        angle = np.radians(time)
        expected = (np.cos(angle), 0.0, -np.sin(angle))
        assert_allclose(table(time), expected, atol=1e-15)
    assert table(-1.0) == table(0.0) and table(91.0) == table(90.0)


@settings(deadline=None, max_examples=50)
@given(DIRECTIONS, DIRECTIONS, st.floats(0, 1))
def test_a_direction_stays_between_its_neighbours(first, second, share):
    units = [np.asarray(v) / np.linalg.norm(v) for v in (first, second)]
    if np.linalg.norm(units[0] + units[1]) < 1e-3:
        return
    direction = np.array(jt.DirectionTable((0.0, 1.0), (first, second))(share))
    assert np.linalg.norm(direction) == pytest.approx(1, abs=1e-12)

    def between(a, b):
        return np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)

    total = between(*units)
    assert between(units[0], direction) == pytest.approx(share * total, abs=1e-7)
    assert between(direction, units[1]) == pytest.approx((1 - share) * total, abs=1e-7)


@pytest.mark.parametrize("table_class", [jt.PointTable, jt.DirectionTable])
def test_tables_are_equal_by_value_and_can_be_kept(table_class):
    table = table_class([0, 1], np.eye(3)[:2])
    same = table_class((0.0, 1.0), ((1, 0, 0), (0, 1, 0)))
    assert table == same and hash(table) == hash(same)
    assert pickle.loads(pickle.dumps(table)) == table
    assert table_class([0, 2], np.eye(3)[:2]) != table


@pytest.mark.parametrize("table_class", [jt.PointTable, jt.DirectionTable])
@pytest.mark.parametrize(
    ("times", "rows", "message"),
    [
        ([], [], "give times"),
        ([0, 1], [[1, 0, 0]], "three numbers for each"),
        ([0], [[1, 0]], "three numbers for each"),
        ([0, "a"], [[1, 0, 0]] * 2, "three numbers for each"),
        ([0, 0], [[1, 0, 0]] * 2, "must increase"),
        ([0, np.nan], [[1, 0, 0]] * 2, "finite"),
        ([0], [[np.inf, 0, 0]], "finite"),
    ],
)
def test_what_is_no_table(table_class, times, rows, message):
    with pytest.raises(InputError, match=message):
        table_class(times, rows)


@pytest.mark.parametrize(
    ("rows", "message"),
    [([[1, 0, 0], [0, 0, 0]], "not all zero"), ([[1, 1, 0], [-2, -2, 0]], "opposite")],
)
def test_what_is_no_direction(rows, message):
    with pytest.raises(InputError, match=message):
        jt.DirectionTable([0, 1], rows)
