"""The verdicts of the stiff cases, and cheap cases through them."""

import json
from itertools import islice

import numpy as np
import pytest

import jaxthermo as jt
from experiments import catalogue
from experiments.harness.case import (
    FAIL,
    PASS,
    REFUSED,
    REPORTED,
    Case,
    Check,
    Group,
    Row,
    check,
    refusal,
)
from experiments.harness.report import select
from experiments.harness.scenes import stable_step
from experiments.stiff import extremes, run as stiff
from experiments.stiff.radiation import cube
from experiments.stiff.solved import (
    LIMITS,
    Limits,
    Method,
    _row_of,
    run_nodes,
)
from jaxthermo.errors import InputError


def test_it_is_listed_with_all_its_cases():
    (experiment,) = catalogue.find("stiff")
    assert experiment.options == ("cases",)
    assert [case.id for case in stiff._CASES] == [f"S{n:02}" for n in range(1, 23)]


@pytest.mark.parametrize("computed", [2.0, -1.0, float("nan"), float("inf")])
def test_a_check_out_of_its_limits_fails_the_row(computed):
    good = Check("x", computed=0.5, highest=1.0, lowest=0.0)
    bad = Check("x", computed=computed, highest=1.0, lowest=0.0)
    assert Row("", checks=(good,)).verdict == PASS
    assert Row("", checks=(good, bad)).verdict == FAIL
    assert Row("", checks=(good, bad), if_met=REPORTED).verdict == FAIL
    assert Row("").verdict == REPORTED


def _raises(error):
    def call():
        raise error

    return call


def test_only_a_refusal_that_says_why_is_met():
    def verdict(call):
        return refusal("", call, "the limit is 3").verdict

    assert verdict(_raises(InputError("too long: the limit is 3"))) == REFUSED
    assert verdict(_raises(InputError("too long"))) == FAIL
    assert verdict(_raises(InputError("the limit is 3\nor so"))) == FAIL
    assert verdict(_raises(ValueError("the limit is 3"))) == FAIL
    assert verdict(lambda: None) == FAIL


def test_a_case_that_breaks_is_a_row_that_fails():
    def measure():
        yield Row("first", checks=(Check("x", 0.0, 1.0),))
        raise ZeroDivisionError("by none")

    rows = check(Case("S00", "", "", "", "", measure)).rows
    assert [row.verdict for row in rows] == [PASS, FAIL]
    assert "ZeroDivisionError: by none" in rows[1].failure


def test_no_heat_capacity_is_refused_in_rows_of_its_case():
    """S14 up to its runs: an error outside of a row would stop the case."""
    case = next(case for case in stiff._CASES if case.id == "S14")
    rows = list(islice(case.measure(), 3))
    assert [row.verdict for row in rows] == [REFUSED] * 3


def test_a_run_out_of_bounds_or_energy_fails():
    scene = cube(400.0)
    dt = stable_step(scene) / 2
    method = Method("ForwardEuler", jt.ForwardEuler(dt=dt), 10 * dt)
    ran = run_nodes(scene, method)

    def row(bounds, limits=LIMITS, ran=ran):
        return _row_of(
            ran, dtype="float64", bounds=bounds, limits=limits, max_newton=None
        )

    assert row((300.0, 400.0)).verdict == PASS
    # The same run fails if it must stay below 350 K, or close its energy exactly.
    assert row((300.0, 350.0)).verdict == FAIL
    strict = Limits(overshoot={"float64": 1e-9}, energy={"float64": -1.0})
    assert row((300.0, 400.0), limits=strict).verdict == FAIL
    assert row((300.0, 350.0)).overshoot_K == pytest.approx(50.0, abs=1.0)
    without_number = ran._replace(nodes=(np.array([np.nan]),))
    assert row((300.0, 400.0), ran=without_number).verdict == FAIL


def _some():
    yield refusal("k = 0", lambda: jt.Material(0.0, 1.0, 1.0), "positive, finite")
    yield Row("not a number", checks=(Check("x", float("nan"), 1.0),))


def test_what_fails_is_written_as_what_passes_is(tmp_path, monkeypatch):
    small = Case("S00", "two rows", "none", "both", "", _some)
    monkeypatch.setattr(stiff, "_CASES", (small,))
    (experiment,) = catalogue.find("stiff")
    result = catalogue.run(experiment, tmp_path, cases=" s00")["result"]
    assert result["verdicts"] == {PASS: 0, REFUSED: 1, REPORTED: 0, FAIL: 1}
    record = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    rows = record["result"]["cases"][0]["rows"]
    assert [row["verdict"] for row in rows] == [REFUSED, FAIL]
    assert rows[1]["checks"][0]["computed"] == "nan"
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "S00: two rows" in text and "http" not in text
    assert 'class="left missed">FAIL' in text


@pytest.mark.slow
def test_cheap_cases_pass(tmp_path):
    (experiment,) = catalogue.find("stiff")
    result = catalogue.run(experiment, tmp_path, cases="S14,S16")["result"]
    assert result["verdicts"][FAIL] == 0
    assert [case["id"] for case in result["cases"]] == ["S14", "S16"]


def test_unknown_cases_are_refused():
    for names in ("S99", "S01,x", " , "):
        with pytest.raises(InputError, match="there are S01; S02"):
            select((Group("", stiff._CASES),), names)


def test_the_island_has_a_gap():
    solid = extremes._island_body().structure.voxels.solid
    assert solid.any(axis=(1, 2)).tolist() == [True] * 3 + [False] * 2 + [True] * 3
