"""What a sheet is told to be doubtful for, and the report of its cells."""

import json
from typing import Any

import jaxtyping
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo
from jaxthermo.sheets.doubts import curvature, double_area
from jaxthermo.structures.report import structure_report
from jaxthermo.structures.sheet_report import sheet_notes, sheet_warnings


# Without types: each mistake here is one that a type checker reports too.
jt: Any = jaxthermo
STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.3)


def sheet(mesh, thickness=1e-3, pitch=0.1, **options):
    return jt.Sheet(mesh, (jt.Layer(STEEL, thickness),), pitch, **options)


@pytest.mark.parametrize("pitch", [0.02, 0.2])
def test_the_curvature_of_a_pipe(pitch):
    pipe = sheet(jt.shapes.pipe(0.1, 0.5, sections=48), pitch=pitch)
    assert_allclose(np.median(curvature(pipe.grid)), 10.0, rtol=0.05)


def test_flat_walls_with_sharp_edges_do_not_curve():
    for mesh in (jt.shapes.rectangle(1.0, 0.5), jt.shapes.box((1.0, 1.0, 1.0))):
        assert_allclose(curvature(sheet(mesh).grid), 0, atol=1e-9)


def test_a_wall_thicker_than_the_radius_is_told_with_the_place():
    pipe = jt.shapes.pipe(0.1, 0.5)
    assert sheet_warnings(sheet(pipe, 0.08, 0.04)) == []
    (line,) = sheet_warnings(sheet(pipe, 0.15, 0.04))
    assert "its wall of 150 mm is thicker than the radius of curvature of 1" in line
    radius = float(line.split("surface, ")[1].split(" mm")[0])
    assert radius == pytest.approx(100, rel=0.15)


@pytest.mark.parametrize("pitch", [0.005, 0.05])
def test_a_pipe_thinner_than_a_cell_is_told_too(pitch):
    pipe = jt.shapes.pipe(0.01, 0.5)
    assert sheet_warnings(sheet(pipe, 0.005, pitch)) == []
    (line,) = sheet_warnings(sheet(pipe, 0.02, pitch))
    assert "its wall of 20 mm is thicker than the radius of curvature of 1" in line


@pytest.mark.parametrize("weld", [0.6, 10.0])
def test_a_weld_that_leaves_nothing_is_refused(weld):
    plate = jt.shapes.rectangle(0.5, 0.3)
    message = (
        rf"Sheet\(weld={weld:g} m\): no face is left of a mesh of 0.583\d* m: give"
    )
    with pytest.raises(jt.InputError, match=message):
        sheet(plate, weld=weld)


def test_parts_that_lie_on_each_other_are_told():
    plate = jt.shapes.rectangle(1.0, 0.5)
    smaller = jt.shapes.rectangle(0.4, 0.2)
    layers = (jt.Layer(STEEL, 1e-3),)
    both = jt.Sheet({"roof": plate, "patch": smaller}, layers, 0.05)
    double = double_area(both.grid)
    assert double is not None
    # That of either part: triangles are counted by their centres.
    assert_allclose(double.area, 2 * 0.4 * 0.2, rtol=0.2)
    (line,) = sheet_warnings(both)
    assert "of its faces lie on other faces" in line
    above = smaller.placed(jt.Pose((0.0, 0.0, 0.01)))
    apart = jt.Sheet({"roof": plate, "patch": above}, layers, 0.05)
    assert double_area(apart.grid) is None
    assert double_area(sheet(jt.shapes.sphere(0.2), pitch=0.05).grid) is None


def test_seams_that_stay_open_are_told():
    left = jt.shapes.rectangle(1.0, 1.0)
    right = left.placed(jt.Pose((1.0005, 0.0, 0.0)))
    layers = (jt.Layer(STEEL, 1e-3),)
    parts = {"left": left, "right": right}
    (line,) = sheet_warnings(jt.Sheet(parts, layers, 0.25))
    assert "2 m of its border run next to another border" in line
    assert sheet_warnings(jt.Sheet(parts, layers, 0.25, weld=1e-3)) == []


def test_double_faces_are_noted():
    plate = jt.shapes.rectangle(1.0, 1.0)
    twice = jt.Sheet({"a": plate, "b": plate}, (jt.Layer(STEEL, 1e-3),), 0.25)
    assert "left out: 2 faces that are there twice" in sheet_notes(twice)


def test_the_report_has_the_cells_through_the_wall():
    wall = sheet(jt.shapes.rectangle(1.0, 1.0), 0.1, 0.5, cells=4, back="adiabatic")
    report: Any = structure_report(wall)
    assert json.loads(json.dumps(report)) == report
    assert "solid_voxels" not in report
    assert report["sheet"]["back"] == "adiabatic"
    assert report["sheet"]["border_m"] == pytest.approx(4.0)
    (through,) = report["sheet"]["through"]
    sizes = np.array(through["cells_m"])
    assert_allclose(sizes, 0.1 * 1.5 ** np.arange(4) / (1.5**4 - 1) * 0.5, rtol=1e-9)
    diffusivity = 45.0 / (7850.0 * 480.0)
    assert_allclose(through["resolved_time_s"], 4 * sizes[0] ** 2 / diffusivity)
    (line,) = sheet_notes(wall)
    assert line.startswith("a wall of 100 mm has 4 cells through it (12.3, 18.5, 27.7,")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"back": "dry"}, "back='dry'"),
        ({"nodes": "faces"}, "nodes='faces'"),
        ({"weld": 0.0}, "weld"),
        ({"pitch": -1.0}, "pitch"),
        ({"pitch": "5 cm"}, "pitch"),
        ({"shortest_time": 0.0}, "shortest_time"),
        ({"mesh": "a.glb"}, "a Mesh"),
        ({"mesh": {}}, "no parts"),
        ({"layers": {"roof": ()}}, "there is no part 'roof'"),
        ({"layers": {"*": ()}}, "none"),
        ({"layers": ("steel",)}, "Layer("),
        ({"layers": "soil"}, "Layer("),
    ],
)
def test_mistakes_have_one_line(options, words):
    jaxtyping.config.update("jaxtyping_disable", True)
    plate = jt.shapes.rectangle(1.0, 1.0)
    arguments = {"mesh": plate, "layers": (jt.Layer(STEEL, 1e-3),), "pitch": 0.2}
    try:
        with pytest.raises(jt.InputError) as caught:
            jt.Sheet(**(arguments | options))
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_open_sheet_has_no_inside():
    with pytest.raises(jt.InputError, match="this sheet is open and has no inside"):
        jt.Body(sheet(jt.shapes.rectangle(1.0, 1.0)), temperature=300.0, inside="open")
    closed = sheet(jt.shapes.box((1.0, 1.0, 1.0)), pitch=0.5)
    assert jt.Body(closed, temperature=300.0, inside="open").inside == "open"
