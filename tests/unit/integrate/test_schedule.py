"""The layout of steps: lands exactly, never steps above the limit."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from bodies import bar
from hypothesis import given

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.schedule import (
    checked_save_times,
    narrowed,
    save_intervals,
    schedule,
    similar_intervals,
)


TIMES = st.lists(
    st.floats(1e-3, 1e3), min_size=1, max_size=6, unique=True
).map(sorted)  # fmt: skip


def test_a_table_of_steps_is_not_as_wide_as_its_longest_save_interval():
    saves = tuple(float(k) for k in range(1, 101))
    events = tuple(49.0 + k / 1000 for k in range(1, 1000))
    groups = save_intervals(schedule(100.0, saves, events, max_dt=10.0))
    table = narrowed(groups)
    assert [i for group in table for i in group] == [i for g in groups for i in g]
    assert len(table) * max(map(len, table)) < 4 * 1100
    assert [group[-1].end for group in table if group[-1].saved] == list(saves)
    # Rows of about one length stay as they are.
    assert narrowed(groups[:40]) == groups[:40]


@given(saves=TIMES, events=TIMES, later=st.floats(0.0, 10.0), dt=st.floats(1e-2, 1e4))
def test_lands_on_every_stop_with_steps_under_the_limit(saves, events, later, dt):
    t1 = saves[-1] + later
    intervals = schedule(t1, saves=tuple(saves), event_times=tuple(events), max_dt=dt)
    ends = [i.end for i in intervals]
    stops = {*saves, t1, *(k for k in events if k < t1)}
    assert ends == sorted(stops)
    assert [i.start for i in intervals] == [0.0, *ends[:-1]]
    assert [i.end for i in intervals if i.saved] == saves
    assert all(i.steps >= 1 and i.dt <= dt * (1 + 2e-9) for i in intervals)
    # Nor more steps than it takes.
    assert all((i.steps - 1) * dt < i.end - i.start for i in intervals)


@given(st.integers(1, 10**6), st.sampled_from([0.1, 0.3, 0.7, 1e-3, 1 / 3]))
def test_a_whole_number_of_steps_costs_no_step_more(steps, dt):
    (interval,) = schedule(steps * dt, saves=(steps * dt,), event_times=(), max_dt=dt)
    assert interval.steps == steps


@given(saves=TIMES, events=TIMES, dt=st.floats(1e-2, 1e2))
def test_loops_of_fixed_length_take_at_most_twice_the_steps(saves, events, dt):
    intervals = schedule(
        saves[-1], saves=tuple(saves), event_times=tuple(events), max_dt=dt
    )
    groups = save_intervals(intervals)
    sequences = similar_intervals(groups)
    assert tuple(group for sequence in sequences for group in sequence) == groups
    for sequence in sequences:
        columns = max(len(group) for group in sequence)
        steps = [interval.steps for group in sequence for interval in group]
        padded = len(sequence) * columns * max(steps)
        assert len(sequence) == 1 or padded <= 2 * sum(steps)


def test_equal_intervals_are_one_loop():
    saves = tuple(np.linspace(5.0, 500.0, 100).tolist())
    groups = save_intervals(schedule(500.0, saves=saves, event_times=(), max_dt=0.3))
    assert similar_intervals(groups) == [groups]


def test_an_infinite_limit_is_one_step():
    (interval,) = schedule(5.0, saves=(5.0,), event_times=(), max_dt=math.inf)
    assert (interval.steps, interval.dt) == (1, 5.0)


def test_time_zero_needs_no_step():
    assert schedule(0.0, saves=(0.0,), event_times=(1.0,), max_dt=0.1) == ()


def test_knots_beyond_the_end_or_before_the_start_are_not_stops():
    intervals = schedule(
        2.0, saves=(2.0,), event_times=(-1.0, 0.0, 2.0, 3.0), max_dt=1.0
    )
    assert [(i.start, i.end) for i in intervals] == [(0.0, 2.0)]


def test_the_end_is_reached_though_it_is_not_saved():
    intervals = schedule(3.0, saves=(1.0,), event_times=(), max_dt=1.0)
    assert [(i.end, i.saved) for i in intervals] == [(1.0, True), (3.0, False)]


def test_more_steps_than_can_be_counted_are_refused_with_the_limit():
    """S03: 10 um of diamond for three minutes."""
    with pytest.raises(InputError, match=r"1\.49e-08 s.*coarser"):
        schedule(180.0, saves=(180.0,), event_times=(), max_dt=1.49e-8)


@pytest.mark.parametrize(
    ("t1", "save_at", "words"),
    [
        (-1.0, None, "at least 0 s"),
        (math.nan, None, "at least 0 s"),
        (math.inf, None, "at least 0 s"),
        (1.0, [], "empty"),
        (1.0, [0.5, 0.5], "increase"),
        (1.0, [0.5, 0.2], "increase"),
        (1.0, [-0.5, 0.2], r"in \[0, 1\]"),
        (1.0, [0.5, 1.5], r"in \[0, 1\]"),
        (1.0, [math.nan], r"in \[0, 1\]"),
        (1.0, [0.5, math.nan, 0.7], "increase"),
    ],
)
def test_bad_times_are_refused(t1, save_at, words):
    with pytest.raises(InputError, match=words):
        checked_save_times(t1, save_at)


def test_the_end_is_saved_if_nothing_else_is():
    assert checked_save_times(3.0, None) == (3.0,)
    assert checked_save_times(3, [0, 1, 3]) == (0.0, 1.0, 3.0)


def test_a_run_stops_at_its_last_saved_time():
    """With the solver and the bounds of that time, and with a note."""
    steel = jt.Material(16.0, 8000.0, 500.0)
    body = jt.Body(jt.FullVolume(bar(4, 0.01)), steel, temperature=350.0)
    scene = jt.Scene((body,), (jt.Convection(10.0, 290.0),))
    short, long = (jt.simulate(scene, end, save_at=[3.0, 5.0]) for end in (5.0, 1e12))
    assert set(long.receipt.notes) > set(short.receipt.notes)
    (note,) = set(long.receipt.notes) - set(short.receipt.notes)
    assert "stops at the last saved time, 5 s" in note and "1e+12 s" in note
    assert (short.run.steps, short.run.solver) == (long.run.steps, long.run.solver)
    for name in ("times", "surface_temperature", "mean_temperature"):
        np.testing.assert_array_equal(getattr(short, name), getattr(long, name))
    np.testing.assert_array_equal(short.energy.stored_J, long.energy.stored_J)


def test_save_intervals_end_at_saves_and_keep_every_interval():
    intervals = schedule(
        10.0, saves=(4.0, 8.0), event_times=(1.0, 2.0, 5.0, 9.0), max_dt=1.0
    )
    groups = save_intervals(intervals)
    assert [group[-1].end for group in groups] == [4.0, 8.0, 10.0]
    assert sum(groups, ()) == intervals
    assert [len(group) for group in groups] == [3, 2, 2]
