"""Pieces of the report: colours, points, local thickness, checks."""

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp

from experiments.structures.charts import _SHADES, _colour, colours, error_against_time
from experiments.structures.claims import _check
from experiments.structures.config import ExpectConfig
from experiments.structures.measure import _repeated
from experiments.structures.sweeps import _classes, _LocalError, _thickness
from jaxthermo.report.numbers import significant
from tests.bodies import blocks


def test_a_structure_keeps_its_colour_and_a_kind_its_hue():
    kinds = {"full volume": "full volume", "x2": "aggregate", "octree": "octree"}
    few, more = colours(kinds), colours({**kinds, "x4": "aggregate", "own": "mine"})
    assert few["octree"] == more["octree"] and more["x2"] == _SHADES["aggregate"][0]
    assert more["x4"] == _SHADES["aggregate"][1]
    assert len(set(more.values())) == len(more)
    shown: Any = _colour(["x4", "octree"], more).to_dict()
    assert shown["scale"] == {
        "domain": ["x4", "octree"],
        "range": [more["x4"], more["octree"]],
    }


def row(label: str, load: str, error: float, time: float) -> dict:
    return {
        "label": label,
        "load": load,
        "nodes": 9,
        "error": {"worst_rms_percent": error},
        "run_time_s": {"median": time, "fastest": time / 2, "slowest": 2 * time},
        "times_faster": {"median": 3.0, "least": 2.0, "most": 4.0},
    }


def test_a_point_a_structure_and_load_with_both_in_the_legend():
    rows = [row(name, load, 1.0, 2.0) for name in "ab" for load in ("+x", "-z")]
    chart = error_against_time(rows, {"a": "#111111", "b": "#222222"}, "c").to_dict()
    spread, dots = (layer["encoding"] for layer in chart["layer"])
    assert dots["shape"]["scale"]["domain"] == ["+x", "-z"]
    assert dots["color"]["scale"]["domain"] == spread["color"]["scale"]["domain"]
    low, high = spread["x"]["scale"]["domain"]
    assert spread["x"]["scale"] == dots["x"]["scale"] and low < 1 < 4 < high


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.40541, "0.405"), (999.4, "999"), (999.6, "1,000"), (87947, "87,947")],
)
def test_numbers_have_three_digits_or_all_before_the_point(value, text):
    assert significant(value) == text


def test_a_run_is_repeated_as_often_as_there_is_time_for():
    calls = []
    call = lambda: calls.append(time.sleep(0.02))
    _, spans = _repeated(call, 3, max_seconds=10.0)
    assert (len(spans), len(calls)) == (3, 4)
    calls.clear()
    # Too long for three, and for one: the first counts, and it is repeated once.
    _, spans = _repeated(call, 3, max_seconds=1e-6)
    assert (len(spans), len(calls)) == (2, 2) and min(spans) >= 0.02


def brute_thickness(solid, voxel, axis):
    """Step both ways along the axis until outside."""
    count = 1
    for step in (-1, 1):
        here = np.array(voxel)
        while True:
            here[axis] += step
            outside = not 0 <= here[axis] < solid.shape[axis]
            if outside or not solid[tuple(here)]:
                break
            count += 1
    return count


@settings(deadline=None, max_examples=20)
@given(hnp.arrays(bool, (4, 3, 5)))
def test_thickness_against_a_plain_loop(solid):
    if not solid.any():
        return
    grid = blocks(solid)
    found = _thickness(grid)
    for value, voxel, axis in zip(
        found, grid.fragment_voxel, grid.fragment_axis, strict=True
    ):
        assert value == brute_thickness(solid, voxel, axis)


def test_classes_double_and_the_parts_add_up_to_the_whole():
    assert _classes(np.array([1, 7])) == [(1, 1), (2, 2), (3, 4), (5, 8)]
    solid = np.zeros((6, 6, 6), bool)
    solid[:, :, :2] = True
    solid[:2] = True
    grid = blocks(solid)
    local = _LocalError(grid)
    difference = np.random.default_rng(0).normal(size=len(grid.fragment_area))
    parts = local.by_class(difference)
    square = sum(p["area_share"] * p["rms_kelvin"] ** 2 for p in parts)
    assert sum(p["area_share"] for p in parts) == pytest.approx(1)
    assert square == pytest.approx((difference**2).mean())


def test_expectations_are_met_or_not():
    line = {
        "body": "ball",
        "nodes": 40,
        "worst_rms_percent": 0.5,
        "times_faster": {"median": 9.0},
    }
    row = {"structure": {"solid_voxels": 100}}
    expect = ExpectConfig(error_percent=0.3, node_share=0.45, times_faster=8)
    found = {c["what"]: c["met"] for c in _check(line, row, expect)}
    assert found == {"error_percent": False, "node_share": True, "times_faster": True}
    assert _check(line, row, ExpectConfig(body="cube", nodes=1)) == []
