"""The parts of an error: which runs are compared, and how a line sums them up."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrate.study.config import load_sweep
from calibrate.study.evaluate import Truth, evaluate, find_truth
from calibrate.study.points import cases_of, choices
from experiments.front import budget
from experiments.front.budget import budget_lines, write_budget
from experiments.harness.record import Record
from jaxthermo.accuracy.truth_error import AtPoints, TruthPoints
from jaxthermo.config.loader import to_yaml
from tests.sweeping import SWEEP, sweep_file


TIMES = [0.0, 30.0, 60.0]
RANGE = np.linspace(300.0, 310.0, 101)
"""Temperatures at the points: from the 0.5 to the 99.5 % quantile 9.9 K."""

AXES = """
axes:
  high: {key: bodies.0.voxels_high, values: [8, 16]}
  structure:
    - {label: full volume, set: {bodies.0.structure: full_volume}}
    - {label: octree, set: {bodies.0.structure: octree}}
    - {label: blocks, set: {bodies.0.structure: {kind: aggregate, factor: 2}}}
sampling:
  kind: list
  points:
    - {high: 8}
    - {high: 16, structure: blocks}
goals:
  - {nodes: 40, error_percent: 2.5}
  - {nodes: 9, error_percent: 1}
"""


def config_file(folder: Path) -> Path:
    """A budget of a ball: full volume, octree and blocks of 8 and of 16 voxels."""
    head, tail = SWEEP.split("axes:")
    head = head.replace("{bodies.0.structure: {kind: aggregate, factor: 2}}", "{}")
    head = head.replace("set: {}", "set: {solver: error_control}")
    return sweep_file(folder, head + AXES.lstrip() + tail[tail.index("truth") :])


@pytest.fixture
def sweep_config(tmp_path):
    return load_sweep(config_file(tmp_path))


def cases_by_name(config) -> dict[tuple[str, str, str], Any]:
    all_cases = [
        case for choice in choices(config) for case in cases_of(config, choice)
    ]

    def key(case) -> Any:
        return (*dict(case.names).values(), case.load)

    return {key(case): case for case in all_cases}


def stored(record, case, lost=(), **offsets):
    """A row whose runs are so far from the truth at 30 and 60 s, everywhere [K]."""
    fields = {
        name: np.stack([RANGE + 99, *(RANGE + kelvin for kelvin in offset)])
        for name, offset in offsets.items()
    }
    is_lost = np.isin(np.arange(len(RANGE)), lost)
    row = {"times_s": TIMES, "nodes": 40, "run_time_s": 0.5}
    head = {"choice": dict(case.names), "load": case.load}
    return record.once(case.id, head, lambda: (row, {**fields, "is_lost": is_lost}))


def reference() -> Truth:
    own_error: Any = {
        "worst_rms_kelvin": 0.02,
        "is_bound": [False],
        "rms_kelvin": [0.02],
    }
    cost: Any = {
        "pitch_m": [0.002],
        "nodes": 5000,
        "memory_bytes": 2**20,
        "run_time_s": 2.0,
    }
    lost = np.arange(len(RANGE)) == 0
    expected = AtPoints(np.stack([RANGE] * 3), lost)
    points = TruthPoints(
        times=np.array(TIMES), samples=(), expected=expected, outlines=()
    )
    return Truth(points, own_error | {"order": [1.5]}, (cost,))


@pytest.fixture
def lines(sweep_config, tmp_path):
    record = Record(tmp_path)
    named = cases_by_name(sweep_config)
    shorter: dict[str, Any] = {"converged": (0.5, 0.51), "constant": (0.5, 0.8)}
    runs: dict[tuple[str, str, str], dict[str, Any]] = {
        ("8", "full volume", "+x"): {
            "surface": (0.1, 0.2), "converged": (0.1, 0.2), "constant": (1, 1)
        },
        ("8", "full volume", "+z"): {
            "surface": (0.1, 0.1), "converged": (0.1, 0.1), "constant": (1, 1)
        },
        ("8", "blocks", "+x"): {"surface": (0.5, 0.5), **shorter},
        ("8", "blocks", "+z"): {"surface": (-0.7, 0), "lost": [1], **shorter},
        ("16", "blocks", "+x"): {"surface": (0.3, 0.3), **shorter},
        ("16", "blocks", "+z"): {"surface": (0.3, 0.3), **shorter},
    }  # fmt: skip
    rows = {
        named[key].id: stored(record, named[key], **run) for key, run in runs.items()
    }
    for load in ("+x", "+z"):
        rows[named["8", "octree", load].id] = {"refused": "no memory"}
    truths = {case.truth_key: reference() for case in named.values()}
    table_lines = budget_lines(
        list(named.values()), rows=rows, truths=truths, record=record
    )
    return {tuple(line["choice"].values()): line for line in table_lines}


def test_each_part_is_between_two_runs_that_differ_in_it_alone(lines):
    full = lines["8", "full volume"]
    coarse = lines["8", "blocks"]
    assert full["whole_kelvin"] == full["discretisation_kelvin"]
    assert full["whole_kelvin"] == pytest.approx(0.2)
    assert full["structure_kelvin"] == 0
    assert full["reading_kelvin"] == pytest.approx(0.9)
    # The largest of loads and times, each part at its own.
    assert coarse["whole_kelvin"] == pytest.approx(0.7)
    assert coarse["discretisation_kelvin"] == pytest.approx(0.2)
    assert coarse["structure_kelvin"] == pytest.approx(0.8)
    assert coarse["time_kelvin"] == pytest.approx(1.2)
    assert coarse["bias_kelvin"] == pytest.approx(-0.7)
    assert coarse["rms_percent"] == pytest.approx(100 * 0.7 / 9.9, rel=0.02)
    assert coarse["by_load"]["+x"]["whole"]["times_s"] == [30, 60]


def test_points_that_the_reference_lost_count_for_no_one(lines):
    # One of the hundred others is lost by this structure under one load.
    assert lines["8", "blocks"]["lost_fraction"] == pytest.approx(0.01)
    assert lines["8", "full volume"]["lost_fraction"] == 0


def test_voxels_of_the_reference_are_marked_and_have_no_full_volume(lines):
    blocks = lines["16", "blocks"]
    assert blocks["shares_voxels"] and not lines["8", "blocks"]["shares_voxels"]
    assert "structure_kelvin" not in blocks and "discretisation_kelvin" not in blocks
    assert blocks["whole_kelvin"] == pytest.approx(0.3)


def test_the_page_has_kelvin_first_goals_and_the_references_own_error(
    lines, sweep_config, tmp_path, capsys
):
    write_budget(
        list(lines.values()), truths=[reference()], config=sweep_config, folder=tmp_path
    )
    said = capsys.readouterr().out
    assert said.index("error K") < said.index("%")
    assert "itself off by about 0.0200 K" in said and "no memory" in said
    assert "same voxels" in said and "none" in said
    page = (tmp_path / "report.html").read_text()
    assert "0.700, 0.00" in page and "8, full volume" in page


@pytest.mark.slow
def test_a_whole_budget_has_the_errors_of_its_runs_and_goes_on(tmp_path, monkeypatch):
    """The whole error is that of the same case in a sweep."""
    path = config_file(tmp_path)
    out = tmp_path / "out"
    result = budget.run(out, path)
    json.dumps(result, allow_nan=False)
    lines = {tuple(line["choice"].values()): line for line in result["table"]}
    case = cases_by_name(load_sweep(path))["8", "blocks", "+z"]
    expected = evaluate(case, find_truth(case, lambda _: None)).row["error"]
    error = lines["8", "blocks"]["by_load"]["+z"]["whole"]
    np.testing.assert_allclose(error["rms_kelvin"], expected["rms_kelvin"], rtol=1e-9)
    for line in lines.values():
        assert line["time_kelvin"] < 0.05 * line["whole_kelvin"] < 1
        assert line["reading_kelvin"] > 0.01
    full = lines["8", "full volume"]
    octree = lines["8", "octree"]
    assert full["structure_kelvin"] == 0 < octree["whole_kelvin"]
    assert lines["16", "blocks"]["shares_voxels"]
    content = (out / "rows.jsonl").read_text()
    monkeypatch.setattr(budget, "run_plan", None)
    again = budget.run(out, path)["table"]
    assert [line["choice"] for line in again] == [
        line["choice"] for line in lines.values()
    ]
    # The folder of a finished sweep stands for its config.
    folder = tmp_path / "finished"
    folder.mkdir()
    (folder / "config.yaml").write_text(to_yaml(load_sweep(path)))
    assert budget.run(out, folder)["table"] == again
    assert (out / "rows.jsonl").read_text() == content
