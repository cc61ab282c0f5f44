"""Measurements of benchmarks: ratios, bounds, their table, page and CSV file."""

import csv
import json
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import pytest

from experiments import benchmark_group, catalogue
from experiments.harness.measurement import Measurement, plain_rows
from jaxthermo.errors import InputError


FAST = Measurement("step", "s", [2e-3, 1e-3, 4e-3], "numba", [4e-3, 3e-3, 4e-3], 1.5)
COST = Measurement("gradient", "s", [3.0], "its run", [1.0], 2.0, overhead=True)
PLAIN = Measurement("power of the nodes", "-", [1.1], bound=1.2, note="a ball")
BETWEEN = Measurement("call less its loop", "s", [-2e-3])


def test_a_ratio_is_that_of_values_measured_in_turn():
    assert FAST.ratio == pytest.approx((2.0, 1.0, 3.0))
    assert FAST.ratio_text == "2 (1-3) x as fast"
    assert COST.ratio_text == "3 (3-3) x the time"
    # One value of the peer stands beside each of ours.
    once = Measurement("voxels", "s", [1.0, 2.0], "trimesh", [4.0])
    assert once.ratio == pytest.approx((3.0, 2.0, 4.0))
    assert PLAIN.ratio is None and PLAIN.ratio_text == ""


def test_a_bound_is_of_a_speed_an_overhead_or_a_value():
    rows = FAST, COST, PLAIN, BETWEEN
    assert [row.met for row in rows] == [True, False, True, None]
    asked = [row.asked for row in rows]
    assert asked == ["at least 1.5", "at most 2", "at most 1.2", ""]


def test_times_are_shown_in_the_unit_of_ours():
    assert FAST.shown == ("ms", "2 (1-4)", "4 (3-4)")
    assert BETWEEN.shown == ("ms", "-2 (-2--2)", "")
    assert Measurement("cell", "s", [3e-8]).shown[:2] == ("ns", "30 (30-30)")
    assert PLAIN.shown == ("-", "1.1 (1.1-1.1)", "")


def test_plain_values_give_the_same_measurement():
    plain = json.loads(json.dumps(plain_rows([FAST, PLAIN])))
    found = [Measurement(**row) for row in plain]
    assert plain_rows(found) == plain and found[0].ratio == FAST.ratio


def result_of(*rows: Measurement, **more) -> dict:
    body = {"measurements": plain_rows(rows), **more}
    return {"result": body, "took_s": 2.0}


def made_up(monkeypatch, results):
    """Benchmarks that end with a result or an error, without being run."""

    def ended(function, experiment, folder, quick, **options):
        found = results[experiment.name]
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(benchmark_group, "in_new_process", ended)
    return [e for e in catalogue.EXPERIMENTS if e.name in results]


def test_the_group_has_one_table_on_one_page(monkeypatch, tmp_path, capsys):
    (tmp_path / "growth").mkdir()
    (tmp_path / "growth" / "growth.svg").write_text("<svg>line</svg>")
    growth = result_of(PLAIN, charts={"growth": "Time over nodes"})
    results = {
        "steps": result_of(FAST, COST, BETWEEN),
        "growth": growth,
        "voxelize": InputError("voxelize needs trimesh: `make env EXTRAS=test`"),
        "mixed": BrokenProcessPool(),
        "multigrid": ValueError("<no such> level"),
        "gradients": {"result": {"rows": []}},
    }
    experiments = made_up(monkeypatch, results)
    benchmark_group.run_group(experiments, tmp_path)
    page = (tmp_path / "report.html").read_text()
    for words in (
        "2 (1-3) x as fast",
        "2 of 3 bounds met; missed: steps: gradient",
        "without a result: voxelize, mixed, multigrid, gradients",
        "experiments run steps",
        "make env EXTRAS=test",
        "too little memory?",
        "ValueError: &lt;no such&gt; level",
        "see result.json",
        "<svg>line</svg>",
        "numba",
        "processor",
    ):
        assert words in page
    # One file: nothing is fetched and nothing runs.
    assert "<script" not in page and "src=" not in page and "<link" not in page
    table = list(
        csv.DictReader((tmp_path / "measurements.csv").read_text().splitlines())
    )
    assert [row["name"] for row in table[:4]] == [
        *("step", "gradient", "call less its loop", "power of the nodes"),
    ]
    assert float(table[0]["ratio_median"]) == pytest.approx(2.0)
    assert [row["ratio_of"] for row in table[:2]] == ["peer / ours", "ours / peer"]
    assert table[0]["met"] == "True" and table[-1]["error"]
    stored = json.loads((tmp_path / "result.json").read_text())
    assert stored["experiment"] == "benchmarks" and stored["result"]["took_s"] == 4.0
    assert "missed: steps: gradient" in capsys.readouterr().out


def test_an_option_that_one_of_them_does_not_take_runs_none(monkeypatch, tmp_path):
    experiments = made_up(monkeypatch, {"stencil": {}, "steps": {}})
    with pytest.raises(InputError, match="stencil takes no options"):
        benchmark_group.run_group(experiments, tmp_path / "new", height=40)
    assert not (tmp_path / "new").exists()


def test_results_of_this_commit_and_size_are_kept(monkeypatch, tmp_path):
    origin = {
        "commit": "abc",
        "processor": "one",
        "date": "today",
        "device": "cpu",
        "versions": {"jax": "1"},
    }
    monkeypatch.setattr(benchmark_group, "provenance", lambda: dict(origin))
    (tmp_path / "steps").mkdir()
    stored = {**result_of(FAST), **origin, "quick": False}
    (tmp_path / "steps" / "result.json").write_text(json.dumps(stored))
    experiments = made_up(monkeypatch, {"steps": result_of(PLAIN)})

    def name_of(**options) -> str:
        found = benchmark_group.run_group(experiments, tmp_path, **options)
        return found["result"]["rows"][0]["name"]

    assert name_of(resume=True) == "step"
    # Not asked to, of another size, and of code that has no name.
    assert name_of() == name_of(resume=True, quick=True) == "power of the nodes"
    origin["commit"] = "abc+changes"
    assert name_of(resume=True) == "power of the nodes"


def test_a_benchmark_alone_has_the_same_files(monkeypatch, tmp_path):
    steps = catalogue.find("steps")[0]
    measured = lambda: {"measurements": plain_rows([FAST])}
    module = SimpleNamespace(QUICK={"height": 8})
    module.run = lambda folder, height=9: {"height": height, **measured()}
    monkeypatch.setattr(catalogue.importlib, "import_module", lambda name: module)
    whole = catalogue.run(steps, tmp_path / "whole")
    assert whole["result"]["height"] == 9
    assert whole["result"]["files"] == ["report.html", "measurements.csv"]
    assert "at least 1.5" in (tmp_path / "whole" / "report.html").read_text()
    # Of small bodies no bound is asked.
    quick = catalogue.run(steps, tmp_path / "quick", quick=True)
    assert quick["result"]["height"] == 8 and quick["quick"]
    assert quick["result"]["measurements"][0]["bound"] is None
    del module.QUICK
    with pytest.raises(InputError, match="no quick size"):
        catalogue.run(steps, tmp_path / "none", quick=True)


@pytest.mark.slow
def test_the_quick_group_measures_everything(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    found = benchmark_group.run_group(
        catalogue.find("benchmarks"), tmp_path / "out", quick=True
    )
    rows = found["result"]["rows"]
    # None has stopped because results of its alternatives differ.
    assert not [row["error"] for row in rows if row.get("error")]
    named = {experiment.name for experiment in catalogue.find("benchmarks")}
    assert {row["benchmark"] for row in rows} == named
    assert (tmp_path / "out" / "growth" / "growth.svg").is_file()
    for row in rows:
        if "ours_low" in row:
            assert row["ours_low"] <= row["ours_median"] <= row["ours_high"]
