"""`jaxthermo reduce`: the model, its summary and its check; refusals in one line."""

import json

import pytest
from cli_runs import SCENE, files, run, scene_file, succeed

import jaxthermo as jt
from experiments.__main__ import main as experiments
from experiments.results.read import read_result
from jaxthermo.config.loader import load_config


LINEAR = SCENE.replace("  - {kind: surroundings, temperature: 280}\n", "")
COARSE = ("--set", "bodies.0.voxels_high=6")


@pytest.fixture(scope="module")
def reduced(tmp_path_factory):
    """The folder of a model and what the command said."""
    folder = tmp_path_factory.mktemp("reduced")
    scene = scene_file(folder, LINEAR)
    out = folder / "out"
    said = succeed("reduce", scene, *COARSE, "--size", 4, "--out", out)
    return out, said


def test_a_model_is_written_with_its_summary(reduced):
    out, said = reduced
    assert files(out) == {"model.npz", "summary.json", "config.yaml"}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["kind"] == "reduced model" and summary["size"] == 4
    assert summary["offline_s"] > summary["online_s"] > 0
    assert summary["truth_error"] is None
    assert [load["name"] for load in summary["inputs"]] == ["sun", "convection"]
    assert "4 vectors for " in said and "processor" in summary
    model = jt.load_reduced(out / "model.npz")
    assert model.times == (5.0, 12.0, 20.0)
    assert model.about.size == 4
    assert load_config(out / "config.yaml").bodies[0].voxels_high == 6


def test_it_is_a_result_that_can_be_compared_and_listed(reduced, tmp_path):
    out, _ = reduced
    assert read_result(out).kind == "reduced model"
    code, said, _ = run("compare", out, out, main=experiments)
    assert (code, said) == (0, "nothing changed\n")
    code, said, _ = run("report", out.parent, main=experiments)
    assert code == 0 and "1 result in" in said
    page = (out.parent / "index.html").read_text()
    assert "Reduced models" in page and "4 vectors, " in page


def test_no_run_and_no_config_is_written_over(tmp_path, finished):
    scene = scene_file(tmp_path, LINEAR)
    (tmp_path / "config.yaml").write_text(LINEAR)
    for config, out in ((scene, finished), (tmp_path / "config.yaml", tmp_path)):
        files_before = files(out)
        code, _, err = run("reduce", config, *COARSE, "--out", out)
        assert code == 2 and "name another folder" in err and files(out) == files_before


@pytest.mark.slow
def test_a_check_gives_the_error_and_the_times_of_both(tmp_path, out):
    scene = scene_file(tmp_path, LINEAR)
    said = succeed(
        "reduce", scene, *COARSE, "--check", "--tolerance", "0.5%", "--out", out
    )
    summary = json.loads((out / "summary.json").read_text())
    error = summary["truth_error"]
    assert 0 < error["worst_rms_percent"] < 1
    assert error["worst_rms_percent"] < 2 * summary["estimate_percent"] + 0.1
    spans = summary["full"]["loop_s"]
    assert len(spans) == len(summary["online_loop_s"]) and min(spans) > 0
    assert "against the full run: " in said


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (SCENE, (), "emission is not linear in the temperature"),
        (LINEAR, ("--size", 3, "--tolerance", "1%"), "not both"),
        (LINEAR, ("--tolerance", "some"), "--tolerance"),
        (LINEAR, ("--tolerance", "200%"), "--tolerance 200%"),
        (LINEAR, ("--method", "dmd"), "'krylov' or 'pod'"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(tmp_path, text, options, words):
    scene = scene_file(tmp_path, text)
    out = tmp_path / "new" / "out"
    code, _, err = run("reduce", scene, *COARSE, *options, "--out", out)
    assert code == 2 and words in err and err.count("\n") == 1
    assert not out.parent.exists()
