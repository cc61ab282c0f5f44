"""Choices by error and cost: the worst of their loads, and which are on the front."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calibrate.study.front import (
    Point,
    _non_dominated,
    errors_of,
    fastest_within,
    front,
    points_of,
    rivals_of,
)
from calibrate.study.wording import sentence, structure_words
from experiments.front.comparisons import pairs
from experiments.front.rivals import TWELVE_STEPS
from jaxthermo.timing import Spread
from tests.front_rows import error, row, time


def point(percent: float, seconds: float | None, name: str = "a") -> Point:
    errors = dict.fromkeys(("rms_kelvin", "p99_percent", "p99_kelvin"), percent)
    spread = None if seconds is None else Spread(seconds, seconds, seconds)
    return Point(
        name=name,
        choice={},
        errors={"rms_percent": percent, **errors},
        own_error_percent=None,
        nodes=10,
        memory_bytes=10,
        steps=3,
        time=spread,
    )


def test_a_choice_is_as_bad_as_its_worst_load():
    rows = [row("a", "+x", 1.0), row("a", "-z", 3.0, nodes=20, picture="z.png")]
    times = [time("a", "+x", 4.0), time("a", "-z", 2.0)]
    (front_point,) = points_of(rows, times, {"+x", "-z"})
    assert front_point.errors["rms_percent"] == 3.0
    assert front_point.nodes == 20
    assert front_point.picture == "z.png"
    assert front_point.time == Spread(4.0, 3.6, 8.0)
    # Of the slowest load, repeat by repeat.
    assert front_point.ratio == Spread(2.0, 2.0, 2.5)


def test_a_choice_without_a_load_is_no_point():
    rows = [row("a", "+x", 1.0), row("b", "+x", 1.0), row("b", "-z", 1.0)]
    rows.append({"id": "f", "choice": {"structure": "a"}, "load": "-z", "failed": "no"})
    (front_point,) = points_of(rows, [time("b", "+x", 1.0)], {"+x", "-z"})
    assert front_point.name == "b"
    # Timed under one load only: no time.
    assert front_point.time is None


def test_percent_of_the_99th_percentile_are_of_the_range_of_the_rms():
    largest = errors_of(
        {"rms_kelvin": [1.0, 2.0], "rms_percent": [2.0, 8.0], "p99_kelvin": [3.0, 4.0]}
    )
    assert largest == {
        "rms_percent": 8.0, "rms_kelvin": 2.0, "p99_percent": 16.0, "p99_kelvin": 4.0
    }  # fmt: skip


def test_an_infinite_error_is_never_on_the_front():
    bad = error(1.0) | {"rms_percent": [None, None]}
    points = points_of([row("a", "+x", 1.0, error=bad)], [time("a", "+x", 1.0)], {"+x"})
    assert points[0].errors["rms_percent"] == np.inf
    assert not front(points)


def test_the_front_leaves_out_beaten_and_untimed_choices():
    best = [point(3.0, 1.0), point(2.0, 2.0), point(0.5, 9.0)]
    beaten = [point(3.0, 1.5), point(2.5, 2.0), point(0.1, None)]
    assert front([*beaten, *best]) == best
    assert fastest_within([*beaten, *best], 2.2) is best[1]
    assert fastest_within(best, 0.4) is None


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1))
def test_every_row_is_on_the_front_or_beaten_by_one_that_is(costs):
    values = np.array(costs, float)
    on_front = _non_dominated(values)
    best = values[on_front]
    for value, is_best in zip(values, on_front, strict=True):
        better = ((best <= value).all(1) & (best < value).any(1)).any()
        assert better != is_best


def test_rivals_have_offline_times_of_their_own():
    common = {"name": "reduced model", "choice": {"vectors": "20"}, "loop_s": [1e-3]}
    rows = [
        {**common, "load": load, "error": error(0.1), "nodes": 20, "memory_bytes": 5,
         "processor": "p", "offline_s": seconds}
        for load, seconds in (("+x", 9.0), ("-z", 11.0))
    ]  # fmt: skip
    (model,) = rivals_of(rows, {"+x", "-z"})
    assert (model.name, model.offline_s) == ("reduced model, vectors 20", 11.0)
    assert model.time == Spread(1e-3, 1e-3, 1e-3)
    assert not rivals_of(rows[:1], {"+x", "-z"})


def test_twelve_steps_are_timed_beside_the_nearer_choice_and_the_nearer_model():
    choices = [point(1.9, 0.006, "x4"), point(2.6, 0.002, "x8"), point(0.7, 0.1, "x2")]
    models = [point(2.0, 5e-4, "3 vectors"), point(3.0, 1e-4, "1 vector")]
    rivals = [point(2.34, 1.0, TWELVE_STEPS.name), point(0.6, 2.0, "numba RKL2")]
    compared = pairs(choices, rivals=rivals, tolerances=(3.0,), models=models)
    nearer = [pair for pair in compared if pair.tolerance == 2.34]
    assert [pair.choice.name for pair in nearer] == ["x4", "3 vectors"]
    assert all(pair.rival is rivals[0] for pair in nearer)


@pytest.mark.parametrize(
    ("structure", "words"),
    [
        ({"kind": "full_volume"}, "full volume of 2 mm voxels"),
        ({"kind": "aggregate", "factor": 4}, "blocks of 8 mm from 2 mm voxels"),
        (
            {"kind": "shell_over_core", "factor": 4, "layers": 2},
            "2 surface layers over blocks of 8 mm from 2 mm voxels",
        ),
    ],
)
def test_structures_in_words_have_sizes(structure, words):
    assert structure_words(structure, 2e-3) == words
    assert structure_words(structure, 2e-3, fitted=True) == f"{words}, fitted"


def test_a_sentence_has_error_time_and_what_it_is():
    assert sentence(point(0.5, 0.04, "x8")) == "0.5 % (0.5 K) in 40 ms: x8"
