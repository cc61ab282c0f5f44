"""`experiments run front`: a page from a sweep, rivals timed in turn, mistakes."""

import importlib
import json

import pytest

from calibrate.study.rows import append_rows
from experiments.__main__ import main
from tests.cli.cli_runs import run
from tests.front_rows import row
from tests.sweeping import SWEEP, sweep_file


# Finer voxels of the reference, so that rivals of 16 and 20 voxels can be judged.
FINE = SWEEP.replace("voxels_high: 16, points", "voxels_high: 40, points")


def front(*arguments: object) -> tuple[object, str, str]:
    return run("run", "front", *arguments, main=main)


@pytest.mark.slow
def test_a_front_has_rivals_that_are_not_measured_again(tmp_path, out):
    config = sweep_file(tmp_path, FINE)
    code, said, err = front(config, "--out", out)
    assert code == 0, err
    result = json.loads((out / "result.json").read_text())["result"]
    assert len(result["front"]) >= 1 and result["front"][0]["sentence"] in said
    assert result["comparisons"] and result["processors"]
    for comparison in result["comparisons"]:
        for side in ("choice", "rival"):
            error = comparison[side]["errors"]["rms_percent"]
            assert error <= comparison["tolerance_percent"]
        # The other load has arrays of the same shapes, and as many steps.
        assert set(comparison["spans_s"]) == {"+x"}
        assert all(len(spans["rival"]) >= 2 for spans in comparison["spans_s"].values())
    rows = (out / "rivals.jsonl").read_text()
    names = {json.loads(line)["name"] for line in rows.splitlines()}
    assert names == {"numba RKL2", "numba explicit", "scipy TR-BDF2"}
    # From the folder of the sweep: no case is run again, and no rival.
    code, _, err = front(out / "sweep", "--out", out)
    assert code == 0, err
    assert (out / "rivals.jsonl").read_text() == rows
    assert "http" not in (out / "report.html").read_text().replace("http://www.w3", "")


def test_a_sweep_without_times_has_no_front_but_a_page(tmp_path):
    sweep_file(tmp_path).rename(tmp_path / "config.yaml")
    changes = {"bodies.0.structure.weights.within": 1.25}
    rows = [row("1.25", load, 2.0, set=changes) for load in ("+x", "+z")]
    rows = [base_row | {"choice": {"within": "1.25"}} for base_row in rows]
    append_rows(tmp_path / "rows.jsonl", rows)
    code, _, err = front(tmp_path, "--out", tmp_path / "out")
    assert code == 0, err
    page = (tmp_path / "out" / "report.html").read_text()
    assert "there is no front" in page and "no rival was run" in page
    assert "2 % (1 K) not timed: blocks of 50 mm from 25 mm voxels, fitted" in page


def test_choices_of_several_materials_have_a_front_each(tmp_path, out):
    sweep_file(tmp_path).rename(tmp_path / "config.yaml")
    config = (tmp_path / "config.yaml").read_text()
    dense = "{label: dense, set: {bodies.0.material.density: 9000}}"
    axis = f"\n  made: [{{label: own}}, {dense}]\ntruth"
    (tmp_path / "config.yaml").write_text(config.replace("\ntruth", axis))
    rows = []
    for material, changes in (
        ("own", {}),
        ("dense", {"bodies.0.material.density": 9000}),
    ):
        for within in ("0.8", "1"):
            head = {"choice": {"within": within, "made": material}}
            named = material + within
            rows += [row(named, at, 2.0, set=changes) | head for at in ("+x", "+z")]
    append_rows(tmp_path / "rows.jsonl", rows)
    code, said, err = front(tmp_path, "--out", out)
    assert code == 0, err
    assert said.index("own:") < said.index("dense:")
    page = (out / "report.html").read_text()
    assert '<a href="own/report.html">' in page and "several problems" in page
    for name, other_name in (("own", "dense"), ("dense", "own")):
        page = (out / name / "report.html").read_text()
        assert f"1, {name}" in page and f"1, {other_name}" not in page


def test_mistakes_are_one_line(tmp_path):
    for words, message in (
        ((), "name the config of a sweep"),
        ((tmp_path,), "config.yaml"),
        ((tmp_path / "none.yaml",), "none.yaml"),
    ):
        code, _, err = front(*words, "--out", tmp_path / "out")
        assert code == 2 and message in err and err.count("\n") == 1, err
        assert "Traceback" not in err


def test_without_numba_there_are_no_rivals(tmp_path, monkeypatch):
    from experiments.front.rivals import Rivals
    from jaxthermo.errors import InputError

    def missing(name: str) -> None:
        raise ModuleNotFoundError("No module named 'numba'", name="numba")

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(
        InputError, match="need the package numba: run `make env EXTRAS=test`"
    ):
        Rivals({}, tmp_path / "rivals.jsonl", lambda text: None)


@pytest.mark.slow
def test_reduced_models_are_timed_beside_rivals(tmp_path):
    config = sweep_file(tmp_path, FINE)
    sweep = tmp_path / "sweep"
    # Blocks of so many voxels are within 3 %: the one choice that is reduced.
    ball = tmp_path / "ball.yaml"
    ball.write_text(ball.read_text().replace("voxels_high: 8", "voxels_high: 20"))
    code, _, err = run("sweep", config, "--out", sweep, main=main)
    assert code == 0, err
    code, said, err = run(
        "run", "reduction", sweep, "--out", tmp_path / "reduction", main=main
    )
    assert code == 0, err
    result = json.loads((tmp_path / "reduction" / "result.json").read_text())["result"]
    rows = [json.loads(s) for s in (sweep / "rivals.jsonl").read_text().splitlines()]
    assert rows == result["rows"] and {model["load"] for model in rows} == {"+x", "+z"}
    assert all(model["offline_s"] > min(model["loop_s"]) > 0 for model in rows)
    # No further from the reference than the structure and its reduction together.
    (base,) = result["choices"]
    finest = [r for r in rows if r["choice"]["of"].endswith("within 0.1 %")]
    limit = base["errors"]["rms_percent"]
    for model in finest:
        assert model["error"]["worst_rms_percent"] < limit + 0.2
    # Models that are in the folder are not made again.
    stamps = {path: path.stat().st_mtime_ns for path in (sweep / "models").iterdir()}
    code, again, err = run(
        "run", "reduction", sweep, "--out", tmp_path / "again", main=main
    )
    assert code == 0, err
    assert {p: p.stat().st_mtime_ns for p in (sweep / "models").iterdir()} == stamps
    repeated = json.loads((tmp_path / "again" / "result.json").read_text())["result"]
    assert repeated["rows"] == rows
    code, said, err = front(sweep, "--out", tmp_path / "front")
    assert code == 0, err
    assert "reduced model" in (tmp_path / "front" / "report.html").read_text()
    result = json.loads((tmp_path / "front" / "result.json").read_text())["result"]
    timed = [
        comparison
        for comparison in result["comparisons"]
        if comparison["choice"]["name"].startswith("reduced model")
    ]
    assert timed and all(
        set(comparison["spans_s"]) == {"+x", "+z"} for comparison in timed
    )
    code, _, err = run("run", "reduction", config, "--out", tmp_path / "x", main=main)
    assert code == 2 and "name the folder of a sweep" in err
