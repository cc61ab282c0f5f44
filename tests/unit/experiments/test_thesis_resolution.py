"""Exhibits over the resolution and of the wake: counts, charts and verdicts."""

import json

import numpy as np
import pytest

from experiments.thesis import resolution
from experiments.thesis.exhibit import Verdict
from experiments.thesis.exhibits import (
    figure_6_4,
    figure_6_6,
    figure_6_8,
    figure_6_9,
    section_6_1_cubes,
)
from experiments.thesis.line_chart import log_chart, point


@pytest.fixture
def figurine(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    for kept in (resolution.counts, resolution._body):
        kept.cache_clear()
    yield "figurine"
    for kept in (resolution.counts, resolution._body):
        kept.cache_clear()


def test_allocated_texels_are_more_than_occupied_ones(figurine):
    (row,) = resolution.count_rows([figurine], (24,))
    json.dumps(row)
    nx, ny, nz = row["lattice_shape"]
    assert row["box"] == nx * ny * nz
    sides = np.array([ny * nz, nx * nz, nx * ny])
    assert row["texels_shell"] == np.dot(row["layers_packed"], sides)
    assert row["texels_occupied"] < row["texels_shell"] <= row["texels_peeled"]
    assert 1 < row["texels_irregular"] / row["texels_shell"] <= 4 / 3
    # Every piece of surface is stored once, whatever the crossings of other rays.
    assert row["texels_occupied"] < row["fragments"]


def test_without_its_mesh_an_exhibit_of_one_body_is_skipped(figurine):
    exhibits = *figure_6_8.EXHIBITS, *figure_6_9.EXHIBITS
    assert {e.measure(True).verdict for e in exhibits} == {Verdict.SKIPPED}


def test_cells_of_a_cube_grow_without_a_logarithm(monkeypatch):
    monkeypatch.setattr(section_6_1_cubes, "_QUICK_POWERS", range(3, 7))
    found = section_6_1_cubes.EXHIBIT.measure(True)
    assert found.verdict is Verdict.CONTRADICTED
    power = found.numbers
    assert 2 < power["slope_of_the_largest"] < power["slope_claimed_there"]


def test_the_power_is_that_of_the_last_two_times():
    rows = [{"height": n, "step_s": {"a": [2e-9 * n**3]}} for n in (10, 50, 100)]
    assert figure_6_8._slope(rows, "a") == pytest.approx(3)


def test_a_tail_that_does_not_end_is_the_longer_one():
    longer = figure_6_4._is_longer
    assert longer(5.0, None) and longer(5.0, 6.0)
    assert not longer(None, 6.0) and not longer(6.0, 5.0)


def test_stretched_curves_of_one_shape_are_one():
    x = np.linspace(0, 8, 40)
    curve = lambda end, low: low + (end - low) * (1 - np.exp(-x)) / (1 - np.exp(-8))
    (same,) = figure_6_6._stretched([curve(0.9, -0.2), curve(0.7, -0.1)])
    assert same["rms"] == pytest.approx(0, abs=1e-12)
    (apart,) = figure_6_6._stretched([curve(0.9, -0.2), x])
    assert apart["rms"] > 0.1


def test_a_chart_has_lines_and_points_that_stand_alone():
    points = [point("a", 1, 2), point("a", 10, 20), point("b", 5, 5, "b", mark=True)]
    found = log_chart(points, "x", "y", "title").to_dict()
    kinds = [layer["mark"]["type"] for layer in found["layer"]]
    assert kinds == ["line", "point", "point"]
    _, _, alone = (layer["data"]["values"] for layer in found["layer"])
    assert [each["curve"] for each in alone] == ["b"]
