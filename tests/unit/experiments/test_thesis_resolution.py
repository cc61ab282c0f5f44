"""Exhibits over the resolution and of the wake: counts, charts and verdicts."""

import json

import numpy as np
import pytest

from experiments.harness.line_chart import ALONE, CurvePoint, log_chart
from experiments.thesis import bodies, resolution
from experiments.thesis.exhibits import wake
from jaxthermo.errors import InputError
from tests.exhibits import measured


@pytest.fixture
def figurine(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    remembered = (resolution.counts, resolution._body, bodies._statues)
    for function in remembered:
        function.cache_clear()
    yield "figurine"
    for function in remembered:
        function.cache_clear()


def test_allocated_texels_are_more_than_occupied_ones(figurine):
    row = resolution.counts(figurine, 24)
    json.dumps(row)
    nx, ny, nz = row["lattice_shape"]
    assert row["box"] == nx * ny * nz
    sides = np.array([ny * nz, nx * nz, nx * ny])
    assert row["texels_shell"] == np.dot(row["layers_packed"], sides)
    assert row["texels_occupied"] < row["texels_shell"] <= row["texels_peeled"]
    assert 1 < row["texels_irregular"] / row["texels_shell"] <= 4 / 3
    # Every piece of surface is stored once, whatever the crossings of other rays.
    assert row["texels_occupied"] < row["fragments"]


@pytest.mark.parametrize(
    "name", ["figure-6.8", "figure-6.10", "figure-6.9", "figure-6.11"]
)
def test_without_its_mesh_an_exhibit_of_one_body_is_refused(figurine, name):
    with pytest.raises(InputError, match="JAXTHERMO_MESHES has no"):
        measured(name)


def test_cells_of_a_cube_grow_without_a_logarithm():
    found = measured("section-6.1-cubes").numbers
    assert 2 < found["slope_of_the_largest"] < found["slope_claimed_there"]
    assert abs(found["slope_of_the_largest"] - 2) < abs(
        found["slope_of_the_largest"] - found["slope_claimed_there"]
    )


def test_the_power_is_that_of_the_last_two_times():
    rows = [
        resolution.StepTimes(
            mesh="",
            height=height,
            nodes={},
            step_s={"a": [2e-9 * height**3]},
            times_faster={},
        )
        for height in (10, 50, 100)
    ]
    assert resolution.power_of_time(rows, "a") == pytest.approx(3)


def test_a_tail_that_does_not_end_is_the_longer_one():
    never = float("inf")
    assert wake.is_longer(wide=never, narrow=5.0)
    assert wake.is_longer(wide=6.0, narrow=5.0)
    assert not wake.is_longer(wide=6.0, narrow=never)
    assert not wake.is_longer(wide=5.0, narrow=6.0)


def test_stretched_curves_of_one_shape_are_one():
    x = np.linspace(0, 8, 40)

    def curve(end, low):
        return low + (end - low) * (1 - np.exp(-x)) / (1 - np.exp(-8))

    def stretched_distance(a, b):
        (row,) = wake.measure_collapse({1.0: a, 0.5: b})
        return row["stretched from 0 to 1"]

    same = stretched_distance(curve(0.9, -0.2), curve(0.7, -0.1))
    assert same == pytest.approx(0, abs=1e-12)
    assert stretched_distance(curve(0.9, -0.2), x) > 0.1


def test_a_chart_has_lines_and_points_that_stand_alone():
    alone = CurvePoint("b", 5, 5, "b", ALONE)
    points = [CurvePoint("a", 1, 2), CurvePoint("a", 10, 20), alone]
    found = log_chart(points, "x", "y", "title").to_dict()
    kinds = [layer["mark"]["type"] for layer in found["layer"]]
    assert kinds == ["line", "point", "point"]
    _, _, alone = (layer["data"]["values"] for layer in found["layer"])
    assert [mark["curve"] for mark in alone] == ["b"]
