"""Two results compared: only what changed beyond noise, from small stored files."""

import json

import pytest
from stored_results import experiment, fit, plan, row, run_summary, stored, sweep

from experiments.results.changes import (
    differences,
    flatten,
    plain_changes,
    time_changes,
)
from experiments.results.compare import compare
from experiments.results.read import read_result
from jaxthermo.errors import InputError


def compared(a, b):
    return compare(read_result(a), read_result(b))


def both_runs(tmp_path, **changes):
    a = stored(tmp_path / "a", "summary.json", run_summary())
    b = stored(tmp_path / "b", "summary.json", run_summary(**changes))
    return compared(a, b)


def changed(comparison):
    return {change.key: (change.old, change.new) for change in comparison.numbers}


def test_keys_are_dotted_and_a_vector_is_one_value():
    value = {"terms": [{"direction": [1, 0, 0], "kind": "sun"}], "empty": []}
    assert flatten(value) == {
        "terms.0.direction": [1, 0, 0],
        "terms.0.kind": "sun",
        "empty": [],
    }
    (change,) = differences({"a": {"b": None}}, {"a": {}} | {"a": {"b": 1}})
    assert change.as_dict() == {"key": "a.b", "old": None, "new": 1}
    (gone,) = differences({"a": 1, "b": 2}, {"a": 1.0})
    assert gone.as_dict() == {"key": "b", "old": 2}


def test_a_time_changes_if_the_ranges_of_its_repeats_are_apart():
    assert not list(time_changes("t", [1.0, 1.2, 1.1], [1.15, 1.3, 1.4]))
    (change,) = time_changes("t", [1.0, 1.2, 1.1], [2.1, 2.2, 2.4])
    assert (change.old, change.new) == (1.1, 2.2)
    # Measured once there is no range: half as long again may be the machine's load.
    assert not list(time_changes("t", [1.0], [1.4]))
    assert list(time_changes("t", [1.0], [1.6]))
    # Ranges as narrow as the clock's resolution say nothing.
    assert not list(time_changes("t", [1.0, 1.001], [1.002, 1.003]))


def test_plain_values_of_an_experiment_are_matched_by_name():
    timing = {"median": 1.0, "fastest": 0.9, "slowest": 1.2}
    old = {"cases": [{"id": "A", "x": 1.0, "run": timing}, {"id": "B", "x": 2.0}]}
    slower = {"median": 3.0, "fastest": 2.9, "slowest": 3.2}
    new = {"cases": [{"id": "B", "x": 2.5}, {"id": "A", "x": 1 + 1e-6, "run": slower}]}
    changes = {c.key: (c.old, c.new) for c in plain_changes(old, new)}
    assert changes == {"cases.A.run": (1.0, 3.0), "cases.B.x": (2.0, 2.5)}


def test_a_run_is_the_same_within_rounding(tmp_path):
    surface = {"min": [290.0, 291.0], "mean": [295.0, 296.0], "max": [300.0, 310.0001]}
    bodies = [{"surface_temperature_K": surface}]
    comparison = both_runs(
        tmp_path, bodies=bodies, run_time_s=1.3, date="2026-02-02T03:04:05+00:00"
    )
    assert not comparison.config and not comparison.origin and not comparison.numbers
    # Said, since nothing was compared point by point.
    assert "solution.npz is missing" in comparison.remarks[0]


def test_what_changed_in_a_run(tmp_path):
    surface = {"min": [290.0, 291.0], "mean": [295.0, 296.5], "max": [300.0, 310.0]}
    comparison = both_runs(
        tmp_path,
        bodies=[{"surface_temperature_K": surface}],
        config={"name": "block", "terms": [{"direction": [0, 0, 1]}]},
        versions={"jax": "0.11"},
        commit="abc",
        nodes=101,
        run_time_s=2.0,
        energy={"stored_J": [1.0, 2.0001], "sun_J": [10.0, 21.0]},
        probes={"tip": {"temperature_K": [300.0, 301.5]}},
        truth_error={"worst_rms_kelvin": 0.5},
    )
    config = [(c.key, c.old, c.new) for c in comparison.config]
    assert config == [("terms.0.direction", [1, 0, 0], [0, 0, 1])]
    assert [c.key for c in comparison.origin] == ["versions.jax", "commit"]
    assert set(changed(comparison)) == {
        "nodes",
        "bodies.0: mean of the surface [K]",
        "truth_error.worst_rms_kelvin",
        "probes.tip [K]",
        "energy.sun_J, at the end",
        "run_time_s",
    }
    assert changed(comparison)["energy.sun_J, at the end"] == (20.0, 21.0)


def test_a_fitted_value_changes_beyond_its_standard_errors(tmp_path):
    a = fit(tmp_path / "a", 1.0)
    b = fit(tmp_path / "b", 1.13)
    assert not compared(a, b).numbers
    c = fit(tmp_path / "c", 1.15)
    assert changed(compared(a, c)) == {"parameters.weights.within": (1.0, 1.15)}
    errors = {"train": {"default": 2.0, "fitted": 1.2}}
    d = fit(tmp_path / "d", 1.0, error_percent=errors)
    assert changed(compared(a, d)) == {"error_percent.train.fitted": (1.0, 1.2)}
    # Without standard errors only rounding is noise.
    e = fit(tmp_path / "e", 1.0, None)
    f = fit(tmp_path / "f", 1.01, None)
    assert changed(compared(e, f)) == {"parameters.weights.within": (1.0, 1.01)}


def test_rows_of_sweeps_are_matched_by_choice_and_load(tmp_path):
    rows = [row("full", 0.1), row("full", 0.2, "-z"), row("octree", 0.3)]
    a = sweep(tmp_path / "a", rows, {"full+x": [1.0, 1.1], "octree+x": [0.5, 0.6]})
    # Of another program: the ids are others, the choices the same.
    later = [row("full", 0.100001), row("full", 0.25, "-z"), row("shell", 0.4)]
    later = [{**row, "id": f"new {row['id']}"} for row in later]
    b = sweep(tmp_path / "b", later, {"new full+x": [2.0, 2.1]})
    comparison = compared(a, b)
    names = changed(comparison)
    assert set(names) == {
        "structure octree, load +x",
        "structure shell, load +x",
        "structure full, load -z: worst_rms_kelvin",
        "structure full, load -z: worst_rms_percent",
        "structure full, load +x: loop [s]",
    }
    plain = comparison.as_dict()["numbers"]
    only = next(c for c in plain if c["key"] == "structure octree, load +x")
    assert only == {"key": "structure octree, load +x", "old": "a row"}


def test_a_case_that_fails_now_is_a_change(tmp_path):
    a = sweep(tmp_path / "a", [row("full", 0.1)], {})
    failed = {"id": "1", "choice": {"structure": "full"}, "load": "+x", "failed": "no"}
    b = sweep(tmp_path / "b", [failed], {})
    assert list(changed(compared(a, b))) == ["structure full, load +x: failed"]


def test_a_plan_changes_with_its_time(tmp_path):
    a = plan(tmp_path / "a", 0.01)
    b = plan(tmp_path / "b", 0.02)
    assert changed(compared(a, b)) == {"run_time_s": (0.01, 0.02)}
    assert not compared(a, a).numbers and read_result(a).date.year == 2026


def test_results_of_two_kinds_are_not_compared(tmp_path):
    a = stored(tmp_path / "a", "summary.json", run_summary())
    b = fit(tmp_path / "b", 1.0)
    c = experiment(tmp_path / "c", x=1.0)
    with pytest.raises(InputError, match="is a run and .* a fit"):
        compared(a, b)
    mixed = json.loads((c / "result.json").read_text()) | {"experiment": "mixed"}
    d = stored(tmp_path / "d", "result.json", mixed)
    with pytest.raises(InputError, match="of the experiment stencil and .* of mixed"):
        compared(c, d)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("summary.json", '{"a": ', "damaged"),
        ("summary.json", "[]", "no result"),
        ("summary.json", "{}", "receipt is missing"),
        ("result.json", '{"experiment": "x", "result": 3}', "no values"),
        ("fit.json", "{}", "not a calibration result"),
        ("rows.jsonl", "{}", "not finished"),
        ("other.json", "{}", "no result"),
    ],
)
def test_what_is_no_result_is_refused_in_one_line(tmp_path, name, text, reason):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=reason) as refused:
        read_result(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_summary_of_another_form_is_refused(tmp_path):
    with pytest.raises(InputError, match="damaged or of another version"):
        both_runs(tmp_path, bodies=[{}])
