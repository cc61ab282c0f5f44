"""The parts of an error: which runs are compared, and how a line sums them up."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxthermo as jt
from experiments.harness.record import Record
from experiments.structures import budget
from experiments.structures.budget_table import budget_lines, write_budget
from experiments.structures.config import load_comparison
from jaxthermo.config.strict_yaml import read_yaml, write_yaml
from jaxthermo.errors import InputError


SHIPPED = Path(__file__).parents[3] / "configs/experiments/structures-figurine.yaml"
TIMES = [0.0, 30.0, 60.0]
RANGE = np.linspace(300.0, 310.0, 101)
"""Temperatures at the points: from the 0.5 to the 99.5 % quantile 9.9 K."""


def config(folder: Path, **changes):
    data = read_yaml(SHIPPED)
    data["budget"] |= changes
    path = folder / "budget.yaml"
    path.write_text(write_yaml(data))
    return load_comparison(path)


@pytest.fixture
def record(tmp_path):
    return Record(tmp_path)


def stored(record, head, lost=(), **offsets):
    """A row whose runs are so far from the truth at 30 and 60 s, everywhere [K]."""
    fields = {
        name: np.stack([RANGE + 99, *(RANGE + each for each in offset)])
        for name, offset in offsets.items()
    }
    is_lost = np.isin(np.arange(len(RANGE)), lost)
    row = {"times_s": TIMES, **head}
    return record.once(head, {}, lambda: (row, {**fields, "is_lost": is_lost}))


def reference(record, load):
    own = {"worst_rms_kelvin": 0.02, "is_bound": [False], "rms_kelvin": [0.02]}
    head = {"load": load, "own_error": own | {"order": [1.5]}}
    cost = {"pitch_m": [0.002], "nodes": 5000, "memory_bytes": 2**20, "cached": False}
    head |= {"body": "figurine", "costs": [cost | {"run_time_s": 2.0}]}
    return stored(record, head, lost=[0], surface=(0, 0))


def structure(record, label, height, load, lost=(), kind="aggregate", **offsets: Any):
    head = {"label": label, "voxels_high": height, "load": load, "kind": kind}
    head |= {"surface_cells": "crossings", "nodes": 40, "run_time_s": 0.5}
    return stored(record, head, lost, **offsets)


@pytest.fixture
def lines(record, tmp_path):
    given = config(tmp_path).budget
    assert given is not None
    references = [reference(record, "+x"), reference(record, "-z")]
    rows = [
        structure(record, "full volume", 32, load, kind="full_volume", **runs)
        for load, runs in {
            "+x": {"surface": (0.1, 0.2), "converged": (0.1, 0.2), "constant": (1, 1)},
            "-z": {"surface": (0.1, 0.1), "converged": (0.1, 0.1), "constant": (1, 1)},
        }.items()
    ]
    runs: dict[str, Any] = {"converged": (0.5, 0.51), "constant": (0.5, 0.8)}
    rows += [
        structure(record, "aggregate x2", 32, "+x", surface=(0.5, 0.5), **runs),
        structure(
            record, "aggregate x2", 32, "-z", lost=[1], surface=(-0.7, 0), **runs
        ),
        structure(record, "aggregate x4", 64, "+x", surface=(0.3, 0.3), **runs),
        {"label": "octree", "voxels_high": 32, "load": "+x", "kind": "octree"}
        | {"surface_cells": "crossings", "refused": "no memory"},
    ]
    found = budget_lines(rows, references, record, given)
    return {line["label"]: line for line in found}, references


def test_each_part_is_between_two_runs_that_differ_in_it_alone(lines):
    full, coarse = lines[0]["full volume"], lines[0]["aggregate x2"]
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
    assert coarse["percent"] == pytest.approx(100 * 0.7 / 9.9, rel=0.02)
    assert coarse["by_load"]["+x"]["whole"]["times_s"] == [30, 60]


def test_points_that_the_reference_lost_count_for_no_one(lines):
    # One of the hundred others is lost by this structure under one load.
    assert lines[0]["aggregate x2"]["lost_fraction"] == pytest.approx(0.01)
    assert lines[0]["full volume"]["lost_fraction"] == 0


def test_voxels_of_the_reference_are_marked_and_have_no_full_volume(lines):
    own = lines[0]["aggregate x4"]
    assert own["shares_voxels"] and not lines[0]["aggregate x2"]["shares_voxels"]
    assert "structure_kelvin" not in own and "discretisation_kelvin" not in own
    assert own["whole_kelvin"] == pytest.approx(0.3)


def test_the_page_has_kelvin_first_goals_and_the_references_own_error(
    lines, tmp_path, capsys
):
    goals = [{"nodes": 40, "error_percent": 2.5}, {"nodes": 9, "error_percent": 1}]
    write_budget(
        [*lines[0].values()], lines[1], config(tmp_path, goals=goals), tmp_path
    )
    said = capsys.readouterr().out
    assert said.index("error K") < said.index("%")
    assert "itself off by about 0.0200 K" in said and "no memory" in said
    assert "same voxels" in said and "none" in said
    page = (tmp_path / "report.html").read_text()
    assert "0.700, 0.00" in page and "full volume, 32 high" in page


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reference_voxels_high": 40}, "voxels_high: must be at most half of the"),
        ({"body": "figurin"}, "there is no 'figurin'; did you mean 'figurine'?"),
        ({"structures": [{"label": "one"}, {"label": "one"}]}, "'one' is there twice"),
        (
            {"structures": [{"label": "fine", "voxels_high": [64, 48]}]},
            "budget.structures.0.voxels_high: must be at most half of the reference's",
        ),
    ],
)
def test_a_mistake_in_the_budget_names_its_place(tmp_path, changes, message):
    with pytest.raises(InputError) as caught:
        config(tmp_path, **changes)
    assert message in str(caught.value)


def small(folder: Path) -> Path:
    """A budget of a ball: full volume, octree and blocks of 8 and of 16 voxels."""
    data = read_yaml(SHIPPED)
    ball = {"kind": "sphere", "radius": "5 cm"}
    data |= {"bodies": [{"shape": ball}], "claims": {}, "loads": ["+x", "-y"]}
    data["time"] = {"end": 60, "save_at": [20, 60]}
    data["picture"] = {"load": "+x", "time": 60}
    blocks = {"kind": "aggregate", "factor": 2}
    entries = [
        {"label": "full volume"},
        {"label": "octree", "structure": "octree"},
        {"label": "blocks", "structure": blocks, "voxels_high": [16]},
    ]
    data["budget"] = {"voxels_high": [8], "reference_voxels_high": 16}
    data["budget"] |= {"structures": entries, "points": 1000}
    path = folder / "small.yaml"
    path.write_text(write_yaml(data))
    return path


@pytest.mark.slow
@pytest.mark.slice
@pytest.mark.filterwarnings("ignore:body 0 represents")
def test_a_whole_budget_has_the_errors_of_its_runs_and_goes_on(tmp_path, monkeypatch):
    """The full volume's error is `truth_error` of the same two runs by hand."""
    path = small(tmp_path)
    lines = {line["label"]: line for line in budget.run(tmp_path, path)["table"]}
    found = lines["full volume"]["by_load"]["-y"]["whole"]
    given = load_comparison(path)
    expected = jt.truth_error(*(solved(given, high) for high in (8, 16)), count=1000)
    np.testing.assert_allclose(found["rms_kelvin"], expected.rms_kelvin, rtol=1e-5)
    np.testing.assert_allclose(found["rms_percent"], expected.rms_percent, rtol=1e-5)
    for line in lines.values():
        assert line["time_kelvin"] < 0.01 < line["whole_kelvin"] < 1
        assert line["reading_kelvin"] > 0.05
    # A ball of 8 voxels has no cores: its octree is its full volume.
    assert lines["octree"]["structure_kelvin"] < 1e-4
    assert lines["blocks"]["shares_voxels"]
    before = (tmp_path / "rows.jsonl").read_text()
    monkeypatch.setattr(budget, "run_plan", None)
    monkeypatch.setattr(budget, "refined_reference", None)
    again = budget.run(tmp_path, path)["table"]
    assert [line["label"] for line in again] == [*lines]
    assert (tmp_path / "rows.jsonl").read_text() == before


def solved(given, voxels_high: int) -> jt.Solution:
    """The ball under the sun from -y, by hand."""
    mesh = given.bodies[0].shape.build()
    ball = jt.voxelize(mesh, float(np.ptp(mesh.bounds[:, 2])) / voxels_high)
    body = jt.Body(
        jt.FullVolume(ball), given.material.build(), temperature=given.temperature
    )
    sun = jt.Sun((0.0, 1.0, 0.0), irradiance=jt.Until(5000.0, 90.0))
    scene = jt.Scene((body,), (sun, *(term.build() for term in given.terms)))
    return jt.simulate(scene, 60.0, [20.0, 60.0])


def test_a_config_without_a_budget_says_what_to_give(tmp_path):
    data = read_yaml(SHIPPED)
    del data["budget"]
    path = tmp_path / "none.yaml"
    path.write_text(write_yaml(data))
    with pytest.raises(InputError, match="no `budget`: give its voxels_high"):
        budget.run(tmp_path, path)
