"""The experiment on contact, on the smallest of its bodies."""

import pytest
from rich.console import Console

from experiments import catalogue
from experiments.thesis.contact import (
    _area_chart,
    _area_sheet,
    _area_table,
    _balls_on_heads,
    _head_table,
    _measure_areas,
    _measure_pruning,
    _pruning_table,
)
from jaxthermo.geometry.shapes import figurine


def test_it_is_listed_and_takes_a_height():
    (found,) = catalogue.find("contact")
    assert found.options == ("height",)


def test_areas_are_measured_and_drawn(tmp_path):
    rows = _measure_areas((8,))
    assert [row["threshold"] for row in rows] == ["one voxel", "1/16 radius"]
    assert all(abs(row["error_percent"]) < 4 for row in rows)
    assert all(abs(row["swapped_percent"]) < 4 for row in rows)
    _area_chart(rows, tmp_path / "area")
    _area_sheet(tmp_path / "layers.png", (8,))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["area.png", "area.svg", "layers.png"]
    Console(quiet=True).print(_area_table(rows).rich())


@pytest.mark.slow
def test_pruning_loses_nothing_and_a_ball_rests_on_a_head(tmp_path):
    (row,) = _measure_pruning((8,))
    assert row["lost"] == 0 < row["touching"] <= row["after_views"]
    assert row["after_views"] <= row["after_boxes"] <= row["possible"] == 28
    (head,) = _balls_on_heads({"figurine": figurine(0.5)}, 30, tmp_path)
    assert head["pairs"] > 0 < head["first_heat_rate_W"]
    assert (tmp_path / head["picture"]).is_file()
    console = Console(quiet=True)
    console.print(_pruning_table([row]).rich(), _head_table([head]).rich())
