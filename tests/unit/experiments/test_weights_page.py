"""Charts of a sweep over two weights: a known bowl, its optimum and lines of error."""

import math
from typing import Any

import pytest

from calibrate.study.config import load_sweep, sweep_hash
from calibrate.study.points import cases_of, choices
from calibrate.study.summary import lines, table
from calibrate.study.sweep import Sweep
from calibrate.study.tuning import _contour, _curve, grid_errors, sections
from jaxthermo.errors import InputError
from jaxthermo.report import page
from tests.sweeping import FIT, TUNED, sweep_file


def bowl(within: float, between: float) -> float:
    """Smallest at 1 and 2, and there 0.5 %."""
    return 0.5 + 2 * math.log(within) ** 2 + math.log(between / 2) ** 2


def swept(folder) -> Sweep:
    (folder / "fit.yaml").write_text(FIT)
    config = load_sweep(sweep_file(folder, TUNED))
    cases = [c for choice in choices(config) for c in cases_of(config, choice)]
    sweep = Sweep(config=config, hash=sweep_hash(config), folder=folder, cases=cases)
    for case in cases:
        percent = bowl(*(float(label) for _, label in case.names))
        error = {f"worst_{name}": percent for name in ("rms_percent", "rms_kelvin")}
        error |= {"worst_p99_kelvin": 3 * percent, "worst_lost_fraction": 0.0}
        sweep.rows[case.id] = {**case.head, "error": error, "nodes": 9, "steps": 4}
    return sweep


FOUND: Any = {
    "sweep": {
        "values": {"within": 1.0, "between": 2.0},
        "rms_percent": 0.5,
        "runs": 25,
    },
    "fit": {
        "values": {"within": 1.01, "between": 1.99},
        "rms_percent": 0.51,
        "runs": 5,
    },
    "start": {"values": {"within": 1.0, "between": 1.0}, "rms_percent": 0.98},
    "times_fewer_runs": 5.0,
}


def test_the_page_has_both_optima_curves_and_a_contour(tmp_path):
    sweep = swept(tmp_path)
    best = min(grid_errors(sweep).items(), key=lambda item: item[1])
    assert dict(best[0]) == {"within": 1.0, "between": 2.0} and best[1] == 0.5
    page.write_page(tmp_path / "page.html", "Weights", sections(sweep, FOUND))
    text = (tmp_path / "page.html").read_text()
    assert text.count("<svg") == 3 and "Error over both" in text
    assert "The fit took 5 runs and the sweep 25, 5 times as many" in text


def test_a_start_whose_run_failed_has_an_infinite_error(tmp_path):
    start: Any = {"values": {"within": 1.0, "between": 1.0}, "rms_percent": None}
    written = sections(swept(tmp_path), FOUND | {"start": start})
    page.write_page(tmp_path / "page.html", "Weights", written)
    text = (tmp_path / "page.html").read_text()
    assert text.count("<svg") == 3 and "start: infinite %" in text


def _values(chart) -> list[list[dict]]:
    return [layer["data"]["values"] for layer in chart.to_dict()["layer"]]


def test_lines_of_a_contour_have_the_error_that_they_stand_for(tmp_path):
    contour, optima = _values(_contour(swept(tmp_path), FOUND))
    assert [point["mark"] for point in optima] == ["start", "sweep", "fit"]
    assert len({point["line"] for point in contour}) >= 8
    for point in contour:
        assert abs(bowl(point["x"], point["y"]) / point["error"] - 1) < 0.6
    curves, _ = _values(_curve(swept(tmp_path), FOUND, "within"))
    at_two = [point for point in curves if "sweep" in point["line"]]
    assert len(at_two) == 5
    for point in at_two:
        assert point["error"] == pytest.approx(bowl(point["x"], 2.0))


def test_failed_choices_are_left_out_and_listed_last(tmp_path):
    sweep = swept(tmp_path)
    case = sweep.cases[12]
    sweep.rows[case.id] = {**case.head, "failed": "diverged"}
    assert len(grid_errors(sweep)) == 24
    choice_lines: Any = lines(sweep)
    assert choice_lines[-1]["failed"] == ["as given: diverged"]
    assert [line["rms_percent"] for line in choice_lines[:-1]] == sorted(
        line["rms_percent"] for line in choice_lines[:-1]
    )
    assert len(table(sweep, 3).rows) == 3
    sweep.rows = {}
    with pytest.raises(InputError, match="no choice of the sweep has an error"):
        grid_errors(sweep)
