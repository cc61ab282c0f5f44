"""The page of a fit: its words and charts, its pictures, and that it is whole."""

import copy
import io
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from calibrate.config.loader import load_calibration
from calibrate.problem.build import Calibration, build
from calibrate.problem.frame_values import AS_GIVEN
from calibrate.problem.problem import Problem
from calibrate.report import page as report, pictures
from calibrate.report.charts import (
    correlation_chart,
    error_chart,
    loss_chart,
    parameter_charts,
)
from calibrate.report.page import write_report
from calibrate.report.pictures import (
    Solutions,
    _close_up,
    _scatter,
    difference_picture,
    frame_picture,
    run_both,
)
from calibrate.report.text_summary import MEANING, summary
from calibrate.solvers.fit import Fit
from jaxthermo.arrays import precision
from tests.calibrating import RESULT, SPHERE


SMALL = 60
"""Side of pictures here [px]."""
FIT = """
scene: scene.yaml
train: [{name: "+x"}]
parameters: [{name: weights.between}]
"""
FRAMES = """
scene: scene.yaml
train: [{name: seen}]
reference: {kind: simulated_frames, set: {bodies.0.material.conductivity: 30}}
parameters: [{name: material.conductivity}]
"""


def build_in(folder: Path, text: str) -> Calibration:
    (folder / "scene.yaml").write_text(SPHERE)
    (folder / "fit.yaml").write_text(text)
    return build(load_calibration(folder / "fit.yaml"), lambda stage: None)


@pytest.fixture(scope="module")
def sphere(tmp_path_factory) -> Calibration:
    """With its one case again as the one that is held out."""
    with pytest.warns(UserWarning, match="heat has gone"):
        calibration = build_in(tmp_path_factory.mktemp("sphere"), FIT)
    train = calibration.train
    again = replace(train.cases[0], name="+z")
    calibration.held_out = Problem(train.parameters, (again,))
    calibration.configs = {**calibration.configs, "+z": calibration.configs["+x"]}
    return calibration


@pytest.fixture(scope="module")
def runs(sphere) -> Solutions:
    return run_both(sphere.train, sphere.train.cases[0], np.array([0.3]))


@pytest.fixture
def run_before(monkeypatch, runs):
    """Pages of the sphere show these runs, and need no others."""
    monkeypatch.setattr(report, "run_both", lambda problem, case, z: runs)


@pytest.fixture(scope="module")
def frames(tmp_path_factory) -> Calibration:
    return build_in(tmp_path_factory.mktemp("frames"), FRAMES)


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    monkeypatch.setattr(pictures, "SIDE", SMALL)


def fit_at(z: list[float]) -> Fit:
    none = np.zeros((len(z), 0))
    return Fit(
        z=np.array(z),
        loss=1.0,
        initial_loss=2.0,
        residual=np.zeros(0),
        jacobian=none,
        errors=(),
    )


def parameter(value, error, **fields) -> Any:
    defaults = {"initial": 1.0, "verdict": "fine", "with": [], "unit": ""}
    return {"value": value, "standard_error": error, **defaults, **fields}


def error(*percent) -> Any:
    return {
        "times_s": [30.0 * (n + 1) for n in range(len(percent))],
        "rms_percent": list(percent),
        "rms_kelvin": [p / 10 for p in percent],
        "worst_percent": max(percent),
    }


def result_of(parameters, held_out=True, **fields) -> Any:
    def both(case):
        return {
            "default": {case: error(4.0, 3.0)},
            "fitted": {case: error(1.0, 2.0)},
        }

    errors = {"train": both("+x")} | ({"held_out": both("+z")} if held_out else {})
    result = {
        "name": "a < b",
        "verdict": {"pays": True, "words": "it pays < c", "times": 2, "worse": 0},
        "parameters": parameters,
        "error_percent": {g: {"default": 4.0, "fitted": 2.0} for g in errors},
        "errors": errors,
        "correlation": np.eye(len(parameters)).tolist(),
        "singular_values": [1.0] * len(parameters),
        "speedup": {
            "times_faster": 3.0,
            "min": 2.0,
            "max": 4.0,
            "default": {"times_faster": 2.5},
            "run_time_s": {"full_volume": [3.0, 3.0], "fitted": [1.0, 1.0]},
            "nodes": {"full_volume": 80, "fitted": 10},
            "steps": {"full_volume": 9, "fitted": 3},
        },
        "steps": [
            {"step": 1, "loss": 1.0, "accepted": True, "values": [1.0]},
            {"step": 2, "loss": 1.0, "accepted": False, "values": [1.0]},
        ],
        "config": {"scene": "scene.yaml"},
        "config_hash": "0123",
        "program_hash": "4567",
        "seed": 0,
        "versions": {"jaxthermo": "0", "jax": "1"},
    }
    return RESULT | result | fields


ONE = {"weights.between": parameter(0.8, 0.1)}


def bars(parameters):
    charts = parameter_charts(result_of(parameters))
    return [row for chart in charts for row in chart.to_dict()["data"]["values"]]


def test_a_bar_on_a_logarithmic_axis_is_a_factor():
    (bar,) = bars(ONE)
    assert bar["high"] == pytest.approx(0.8 * math.exp(0.1 / 0.8))
    assert bar["low"] * bar["high"] == pytest.approx(0.8**2)


def test_a_bar_on_a_linear_axis_is_a_difference():
    (bar,) = bars({"sun.temperature": parameter(290.0, 2.0, initial=300.0, unit="K")})
    assert (bar["low"], bar["high"]) == (288.0, 292.0)


@pytest.mark.parametrize("missing", [None, math.nan, math.inf])
def test_a_value_without_a_standard_error_has_no_bar(missing):
    (bar,) = bars({"weights.between": parameter(0.8, missing)})
    assert bar["low"] == bar["high"] == 0.8 and "no error bar" in bar["text"]


def test_a_bar_wider_than_the_chart_ends_there():
    (bar,) = bars({"weights.between": parameter(0.8, 1e6)})
    assert bar["low"] == pytest.approx(0.08) and bar["high"] == pytest.approx(10)


def test_values_that_share_a_unit_share_a_chart():
    charts = parameter_charts(
        result_of(
            {
                "weights.within": parameter(0.5, 0.1),
                "weights.nearest_capacity": parameter(-0.5, 0.1),
                "material.conductivity": parameter(20.0, 1.0, unit="W/(m K)"),
                "weights.between": parameter(1.5, 0.1),
            }
        )
    )
    names = [[r["name"] for r in c.to_dict()["data"]["values"]] for c in charts]
    assert names == [
        ["weights.within", "weights.between"],
        ["weights.nearest_capacity"],
        ["material.conductivity"],
    ]


def test_the_loss_begins_before_the_first_step():
    chart = loss_chart(result_of(ONE))
    assert chart is not None
    points = chart.to_dict()["data"]["values"]
    assert [(p["step"], p["loss"]) for p in points] == [(0, 2.0), (1, 1.0), (2, 1.0)]
    assert [p["kind"] for p in points][1:] == ["accepted", "not accepted"]


def test_nothing_above_zero_has_no_logarithmic_chart():
    nothing = result_of(ONE, loss={"initial": 0.0, "final": 0.0}, steps=[])
    assert loss_chart(nothing) is None
    still: Any = {way: {"a": error(0.0, math.nan)} for way in ("default", "fitted")}
    assert error_chart(still, "%") is None


def test_every_case_has_a_frame_with_both_lines():
    cases = {name: error(1.0, 2.0) for name in "abcd"}
    errors: Any = {"default": cases, "fitted": cases}
    chart = error_chart(errors, "%")
    assert chart is not None
    spec = chart.to_dict()
    assert spec["facet"]["sort"] == list("abcd") and spec["columns"] == 3
    assert len(spec["data"]["values"]) == 4 * 2 * 2


def test_a_cell_for_every_pair_with_its_number():
    parameters = {"a": parameter(1.0, 0.1), "b": parameter(1.0, 0.1)}
    result = result_of(parameters, correlation=[[1.0, -0.5], [-0.5, 1.0]])
    spec = correlation_chart(result).to_dict()
    values = {(v["row"], v["column"]): v["value"] for v in spec["data"]["values"]}
    assert values == {("a", "a"): 1, ("a", "b"): -0.5, ("b", "a"): -0.5, ("b", "b"): 1}
    assert spec["layer"][1]["encoding"]["text"]["field"] == "value"


def test_the_summary_says_what_became_worse_and_what_is_missing():
    worse = result_of(ONE, error_percent={"train": {"default": 1.0, "fitted": 3.0}})
    assert any("3.00 times MORE" in text for text in summary(worse))
    alone = summary(result_of(ONE, held_out=False))
    assert alone[0].startswith("Verdict: ")
    assert "nothing was held out" in alone[1]
    assert not any("Error, held out" in text for text in alone)
    assert any("2.00 times less" in text for text in alone)


def test_the_runs_that_are_shown_are_those_that_were_fitted(sphere, runs):
    problem = sphere.train
    z = np.array([0.3])
    with precision(problem.dtype.name):
        compiled = eqx.filter_jit(problem.residuals)
        for way, point in (("default", 0 * z), ("fitted", z)):
            at = jnp.asarray(point, problem.dtype)
            _, diagnostics = compiled(at, problem.step_tables_at(at))
            target = problem.cases[0].target
            residual = target.residual(problem.cases[0].scene, runs[way])
            error = jnp.sqrt(len(residual) * (residual * residual).sum(axis=1))
            np.testing.assert_allclose(error, diagnostics.errors[0], rtol=1e-4)


def test_no_difference_is_light_everywhere(sphere, runs):
    case = sphere.train.cases[0]
    solution = runs["default"]
    same = solution._replace(surface_temperature=case.target.reference)
    pair = {"default": solution, "fitted": same}
    png = difference_picture(
        case, camera=sphere.configs["+x"].camera, solutions=pair, times=[0]
    )
    pixels = np.asarray(Image.open(io.BytesIO(png))).astype(int)
    left, right = np.array_split(pixels[: pixels.shape[0] // 2], 2, axis=1)

    def coloured(half):
        return (np.ptp(half, axis=2) > 40).sum()

    assert coloured(left) > 20 and coloured(right) == 0


def count_pictures(text: str) -> int:
    return text.count("data:image/png;base64,")


def test_the_page_needs_nothing_but_itself(sphere, run_before, tmp_path):
    write_report(tmp_path, calibration=sphere, fit=fit_at([0.3]), result=result_of(ONE))
    text = (tmp_path / "report.html").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    links = [u for u in re.findall(r'https?://[^"\s)]+', text) if "w3.org" not in u]
    assert not links and "<script" not in text
    assert "a &lt; b" in text and "a < b" not in text
    assert "Verdict: it pays &lt; c." in text
    assert "Errors at every saved time" in text
    assert count_pictures(text) == 2 and text.count("<svg") == 4
    assert "Which experiment to add" not in text and "Correlations" not in text
    assert "Biot number" in text and "0123" in text


def test_a_page_without_held_out_cases(sphere, run_before, tmp_path):
    alone = copy.copy(sphere)
    alone.held_out = None
    parameters = {
        "weights.between": parameter(
            0.8, None, verdict="flat", **{"with": ["weights.surface"]}
        ),
        "weights.surface": parameter(math.nan, math.nan, verdict="dead"),
    }
    advice = [{"what": "more", "gain_nats": 1.5}]
    result = result_of(parameters, held_out=False, advice=advice)
    write_report(tmp_path, calibration=alone, fit=fit_at([0.3]), result=result)
    text = (tmp_path / "report.html").read_text()
    assert count_pictures(text) == 1 and "held out" in text
    assert MEANING["dead"] in text and "determine 0 of 2 values" in text
    assert "Which experiment to add" in text and "1.50" in text
    assert "Correlations" in text


def test_a_camera_that_sees_nothing_spoils_no_report(sphere, run_before, tmp_path):
    blind = copy.copy(sphere)
    camera = sphere.configs["+x"].camera.model_copy(
        update={"position": (1.0, 0.0, 0.0), "look_at": (2.0, 0.0, 0.0)}
    )
    config = sphere.configs["+x"].model_copy(update={"camera": camera})
    blind.configs = {**sphere.configs, "+x": config}
    write_report(tmp_path, calibration=blind, fit=fit_at([0.3]), result=result_of(ONE))
    text = (tmp_path / "report.html").read_text()
    assert count_pictures(text) == 1 and "no picture: camera:" in text


@pytest.mark.slow
def test_frames_are_shown_beside_the_models(frames, tmp_path):
    case = frames.train.cases[0]
    solutions = run_both(frames.train, case, np.array([0.1]))
    as_given = dict.fromkeys(solutions, AS_GIVEN)
    drawn = frame_picture(case, solutions=solutions, values=as_given, time=1, view=0)
    width, height = Image.open(io.BytesIO(drawn)).size
    # Two tiles across and two down, of pixels that can be seen.
    assert width >= SMALL and height >= SMALL
    errors = {w: {"seen": error(300.0, 100.0)} for w in ("default", "fitted")}
    parameters = {
        "material.conductivity": parameter(20.0, 1.0, initial=16.0, unit="W/(m K)")
    }
    result = result_of(
        parameters,
        errors={"train": errors},
        error_percent={"train": {"default": 300.0, "fitted": 300.0}},
        reference="simulated_frames",
    )
    write_report(tmp_path, calibration=frames, fit=fit_at([0.1]), result=result)
    text = (tmp_path / "report.html").read_text()
    assert (
        count_pictures(text) == 1 and "of the noise" in text and "default K" not in text
    )
    assert "3 times the noise" in text


def test_a_frame_of_chosen_pixels():
    counts = np.array([[True, False], [False, True]])
    frame = _scatter(np.array([1.0, 2.0]), counts)
    np.testing.assert_array_equal(frame, [[1.0, np.nan], [np.nan, 2.0]])


def test_a_close_up_holds_all_that_counts():
    counts = np.zeros((60, 50), bool)
    counts[20:30, 5:9] = True
    image = np.repeat(counts[..., None], 3, axis=2).astype(np.uint8) * 255
    seen = _close_up(image, counts)
    times = SMALL // 12
    assert seen.shape == (12 * times, 6 * times, 3)
    assert (seen > 0).all(axis=2).sum() == counts.sum() * times**2
