"""`experiments run structures`: the coarse shipped comparison, cut short, whole."""

import json
import re
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cli_runs import run
from PIL import Image

from experiments.__main__ import main
from experiments.structures import study as study_module
from jaxthermo.config.strict_yaml import read_yaml, write_yaml


SHIPPED = Path(__file__).parents[2] / "configs/experiments/structures-figurine.yaml"
LABELS = ["full volume", "aggregate x4"]


command = partial(run, main=main)


def short_config(folder: Path) -> Path:
    """The shipped config with one structure and small claims, of the same rows."""
    config = read_yaml(SHIPPED)
    chosen = [e for e in config["structures"] if e["label"] in LABELS]
    chosen[0]["expect"] = {"error_percent": 1e-6, "nodes": 100000}
    config |= {
        "structures": chosen,
        "full_volume_as_links": False,
        "repeats": 2,
        "truth": {"points": 500},
        "camera": {"width": 60, "height": 80},
        "claims": {
            "limb": {
                "shape": config["bodies"][0]["shape"],
                "voxels_high": 24,
                "structures": [{k: chosen[0][k] for k in ("label", "structure")}],
            },
        },
    }
    path = folder / "short.yaml"
    path.write_text(write_yaml(config))
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The config, the folder of a finished run and what it said."""
    folder = tmp_path_factory.mktemp("comparison")
    config, out = short_config(folder), folder / "out"
    code, said, err = command("run", "structures", config, "--height", 24, "--out", out)
    assert (code, err) == (0, "")
    return config, out, said


@pytest.fixture(scope="module")
def result(finished):
    return json.loads((finished[1] / "result.json").read_text())


@pytest.mark.slow
def test_every_structure_has_a_row_that_says_what_it_costs(result):
    found = result["result"]
    assert found["config"]["voxels_high"] == 24
    assert [line["label"] for line in found["table"]] == LABELS
    for row in found["rows"]:
        assert "refused" not in row
        for name in ("nodes", "links", "held_bytes", "steps", "setup_time_s"):
            assert row[name] > 0
        time, ratio = row["run_time_s"], row["times_faster"]
        assert row["timed_runs"] == 2
        assert 0 < time["fastest"] <= time["median"] <= time["slowest"]
        assert 0 < ratio["least"] <= ratio["median"] <= ratio["most"]
        assert row["error"]["times"] == [30, 60, 90, 135, 180]
        assert len(row["frame"]["ssim"]) == 5 and max(row["frame"]["ssim"]) <= 1
        assert row["energy_residual"] < 1e-4
    assert {"versions", "host", "device"} <= set(result)


@pytest.mark.slow
def test_errors_against_finer_voxels_are_in_every_row_and_at_the_terminal(
    finished, result
):
    found = result["result"]
    for row in found["rows"][: len(LABELS)]:
        error, own = row["truth"]["error"], row["truth"]["own_error"]
        assert error["times_s"] == own["times_s"] == [30, 60, 90, 135, 180]
        assert 0 < error["worst_rms_kelvin"] < 5 and error["remarks"] == []
        assert 0 < own["worst_rms_kelvin"] < 10
    (reference,) = found["truth_references"]
    assert [cost["refinement"] for cost in reference["costs"]] == [2, 1, 0.5]
    pitches = [cost["pitch_m"][0] for cost in reference["costs"]]
    np.testing.assert_allclose(pitches, [0.5 / 48, 0.5 / 24, 0.5 / 12], rtol=1e-6)
    line = found["table"][-1]["truth"]
    assert line["worst_rms_kelvin"] == error["worst_rms_kelvin"]
    assert "truth K" in finished[2] and "truth: against finer voxels" in finished[2]
    page = (finished[1] / "report.html").read_text()
    assert "truth RMS K by load" in page and "Runs of finer voxels" in page
    # Those of the limb have none: they are not part of the table.
    assert all(row.get("truth") is None for row in found["rows"][len(LABELS) :])


@pytest.mark.slow
def test_the_full_volume_is_off_by_its_step_only_and_the_source_is_the_same(result):
    full, row = result["result"]["rows"][: len(LABELS)]
    assert full["label"] == "full volume" and full["lattice_voxels_per_s"] > 0
    assert full["times_faster"]["median"] == 1
    assert row["error"]["worst_rms_percent"] > full["error"]["worst_rms_percent"]
    assert row["frame"]["worst_ssim"] < full["frame"]["worst_ssim"]
    assert row["sun_J"] == pytest.approx(full["sun_J"], rel=1e-5)


@pytest.mark.slow
def test_what_is_expected_and_not_met_is_told(finished, result):
    line = result["result"]["table"][-1]
    assert {c["what"]: c["met"] for c in line["expected"]} == {
        "error_percent": False,
        "nodes": True,
    }
    assert "aggregate x4: error %" in finished[2]
    assert "not met" in finished[2]


@pytest.mark.slow
def test_the_page_needs_nothing_but_itself(finished, result):
    page = (finished[1] / "report.html").read_text()
    links = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert links and all(link.startswith(("data:", "#")) for link in links)
    assert "<script" not in page and "@import" not in page
    assert page.count("<svg") == 3 and "<title>aggregate x4, sun on +x" in page
    for label in LABELS:
        assert label in page


@pytest.mark.slow
def test_files_named_in_the_result_are_there_and_not_empty(finished, result):
    names = set(result["result"]["files"])
    assert {
        "report.html",
        "error_against_time_figurine.svg",
        "error_against_time_figurine.png",
        "error_over_time_figurine.png",
        "differences_figurine.png",
        "frames_figurine.png",
        "limb_differences_figurine.png",
        "error_by_thickness.png",
    } <= names
    for name in names:
        path = finished[1] / name
        assert path.stat().st_size > 500
        if path.suffix == ".png":
            with Image.open(path) as image:
                assert len(np.unique(np.asarray(image.convert("L")))) > 5


@pytest.mark.slow
def test_the_same_command_measures_nothing_again(finished, monkeypatch):
    def fail(*arguments):
        raise AssertionError("measured again")

    config, out, _ = finished
    before = (out / "rows.jsonl").read_text()
    monkeypatch.setattr(study_module.Study, "_row", fail)
    monkeypatch.setattr(study_module.Study, "baseline", fail)
    code, said, err = command("run", "structures", config, "--height=24", "--out", out)
    assert (code, err) == (0, "")
    assert "rows were there from an earlier run" in said
    assert (out / "rows.jsonl").read_text() == before


@pytest.fixture
def cut_off(finished, tmp_path):
    """A copy of the folder of the run as it was after the full volume's row."""
    out = shutil.copytree(finished[1], tmp_path / "out")
    (out / "result.json").unlink()
    rows = (out / "rows.jsonl").read_text().splitlines(keepends=True)
    (out / "rows.jsonl").write_text("".join(rows[:2]))
    return out


@pytest.mark.slow
def test_a_run_that_is_interrupted_keeps_its_rows(finished, cut_off, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(study_module.Study, "_row", interrupt)
    again = ("run", "structures", finished[0], "--height=24", "--out", cut_off)
    code, _, err = command(*again)
    assert code == 130 and err.startswith("experiments: stopped with 2 rows in ")
    text = (cut_off / "rows.jsonl").read_text()
    assert [json.loads(x)["what"] for x in text.splitlines()] == [
        "reference",
        "structure",
    ]
    assert not (cut_off / "result.json").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("structures", "no.yaml"), "no.yaml: cannot be read"),
        (("structures", SHIPPED, "--height", "4"), "--height: must be at least 8"),
        (("structures", SHIPPED, "--height", "tall"), "--height"),
        (("stencil", "--height", "40"), "height: stencil takes no options"),
        (("voxelize", SHIPPED), "config: voxelize takes no options"),
        (("structure",), "did you mean structures?"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(tmp_path, arguments, message):
    code, out, err = command("run", *arguments, "--out", tmp_path / "out")
    assert (code, out) == (2, "")
    assert err.startswith("experiments: ") and err.count("\n") == 1
    assert message in err


def test_meshes_that_are_missing_say_where_to_put_them(tmp_path, monkeypatch):
    monkeypatch.delenv("JAXTHERMO_MESHES", raising=False)
    code, out, err = command("run", "structures", "--out", tmp_path / "out")
    assert (code, out) == (2, "")
    lines = err.splitlines()
    assert len(lines) == 2 and all("JAXTHERMO_MESHES" in line for line in lines)
    assert "happy-buddha.obj" in lines[0] and "max-planck.obj" in lines[1]


@pytest.mark.slow
def test_a_structure_that_is_refused_says_why_in_its_row(finished, cut_off):
    config = read_yaml(finished[0])
    folder = cut_off.parent
    (folder / "labels.npy").write_bytes(b"no labels")
    partition = {"kind": "partition", "labels": "labels.npy"}
    entry = {"label": "own parts", "structure": partition}
    config |= {"structures": [entry], "claims": {}}
    path = folder / "short.yaml"
    path.write_text(write_yaml(config))
    again = ("run", "structures", path, "--height=24", "--out", cut_off)
    code, said, err = command(*again)
    assert (code, err) == (0, "")
    assert "own parts: " in said and "labels.npy: not an array" in said
    rows = json.loads((cut_off / "result.json").read_text())["result"]["rows"]
    assert "labels.npy" in rows[-1]["refused"] and "error" in rows[0]
    assert "labels.npy" in (cut_off / "report.html").read_text()


@pytest.mark.slow
@pytest.mark.slice
def test_the_whole_coarse_comparison(tmp_path):
    """As it is shipped: every kind, and every claim."""
    code, _, err = command("run", "structures", SHIPPED, "--out", tmp_path)
    assert (code, err) == (0, "")
    found = json.loads((tmp_path / "result.json").read_text())["result"]
    assert not any("refused" in row for row in found["rows"])
    errors = {line["label"]: line["worst_rms_percent"] for line in found["table"]}
    assert errors["octree"] < errors["aggregate x2"] < errors["aggregate x4"]
    one, *_, everything = found["level_rows"][:4]
    assert everything["nodes"] == found["table"][0]["nodes"] > one["nodes"]
    same = lambda row: row["from_full_volume_at_the_same_step"]["worst_rms_percent"]
    assert same(everything) < 1e-3 < same(one)
    claims = {claim["id"]: claim["holds"] for claim in found["claims"]}
    assert claims == {
        "C07, C08": None,
        "C11": True,
        "C12": True,
        "C13": True,
        "C14": True,
        "C15": True,
    }
