"""Pieces of the report: scales, labels, tooltips, local thickness, checks."""

import numpy as np
import pytest
from bodies import blocks
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from experiments.structures import page
from experiments.structures.axes import LogAxis
from experiments.structures.config import ExpectConfig
from experiments.structures.labels import LINE, apart
from experiments.structures.local import LocalError, classes, thickness
from experiments.structures.scale import DifferenceScale, nice_limit
from experiments.structures.summary import check
from experiments.structures.svg import with_tooltips


def test_the_scale_is_symmetric_monotone_and_ends_at_its_limit():
    scale = DifferenceScale(20.0)
    kelvin = np.linspace(-30, 30, 601)
    place = scale.place(kelvin)
    np.testing.assert_allclose(place, -place[::-1], atol=1e-12)
    inside = np.abs(kelvin) < 20
    assert (np.diff(place[inside]) > 0).all()
    assert place[0] == -1 and place[-1] == 1 and place[300] == 0
    assert scale.ticks() == pytest.approx([-20, -2, -0.2, 0, 0.2, 2, 20])
    # A hundredth of the limit is still told from none.
    assert scale.place(np.array([0.2]))[0] > 0.1


def test_no_difference_is_light_and_the_background_dark():
    scale, kelvin = DifferenceScale(1.0), np.array([[0.0, -1.0, 1.0, 0.0]])
    body = np.array([[True, True, True, False]])
    none, cold, hot, outside = scale.picture(kelvin, body)[0].astype(int)
    assert none.min() > 230 and outside.max() < 80
    assert cold[2] > cold[0] and hot[0] > hot[2]


@pytest.mark.parametrize(
    ("largest", "limit"), [(0.7, 1), (1.0, 1), (1.1, 2), (23.0, 50), (60.0, 100)]
)
def test_nice_limits(largest, limit):
    assert nice_limit(largest) == pytest.approx(limit)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.floats(0, 600), st.floats(0, 400)), max_size=12))
def test_names_do_not_stand_on_one_another_nor_on_points(places):
    names = ["single shell"] * len(places)
    found = apart(names, places, places)
    for i, (x, y) in enumerate(places):
        assert abs(found[i] - y) >= 13 - 1e-9
        for j, (other_x, other_y) in enumerate(places):
            beside = abs(x - other_x) > 60
            assert beside or i == j or abs(found[i] - found[j]) >= LINE - 1e-9
            assert beside or abs(found[i] - other_y) >= 10


def test_an_axis_holds_its_values_and_goes_there_and_back():
    axis = LogAxis([0.02, 3.0], "s")
    assert axis.ticks == pytest.approx([0.02, 0.05, 0.1, 0.2, 0.5, 1, 2])
    assert axis.value(axis.pixels(0.7, 400.0), 400.0) == pytest.approx(0.7)
    assert 0 < axis.pixels(0.02, 400.0) < axis.pixels(3.0, 400.0) < 400


def test_descriptions_become_tooltips():
    svg = '<g><path aria-label="a &lt; 1 %, &quot;b&quot;" d="M0,0"/><path d="M1"/></g>'
    with_titles = with_tooltips(svg)
    assert "<title>a &lt; 1 %, &quot;b&quot;</title></path>" in with_titles
    assert with_titles.count("<title>") == 1


def test_what_users_write_is_text_in_the_page():
    assert "<script>" not in page.table(["<script>"], [["<script>", "x"]])
    assert page.table(["a"], [[page.marked("yes", True)]]).count("<td") == 1


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
    found = thickness(grid)
    for value, voxel, axis in zip(
        found, grid.fragment_voxel, grid.fragment_axis, strict=True
    ):
        assert value == brute_thickness(solid, voxel, axis)


def test_classes_double_and_the_parts_add_up_to_the_whole():
    assert classes(np.array([1, 7])) == [(1, 1), (2, 2), (3, 4), (5, 8)]
    solid = np.zeros((6, 6, 6), bool)
    solid[:, :, :2] = True
    solid[:2] = True
    grid = blocks(solid)
    local = LocalError(grid)
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
    found = {c["what"]: c["met"] for c in check(line, row, expect)}
    assert found == {"error_percent": False, "node_share": True, "times_faster": True}
    assert check(line, row, ExpectConfig(body="cube", nodes=1)) == []
