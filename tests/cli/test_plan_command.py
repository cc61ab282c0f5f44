"""`calibrate plan`: refusals, and one plan from its search to its simulation."""

import json
from pathlib import Path

import pytest
from cli_runs import SCENE, run

from calibrate.__main__ import main
from jaxthermo.config.loader import load_config


SCENES = Path(__file__).resolve().parents[2] / "configs/scenes"


@pytest.mark.parametrize(
    "options, message",
    [
        ((), "give a --tolerance such as 1%"),
        (("--tolerance", "1"), "in percent"),
        (("--tolerance=-1%",), "above 0"),
        (("--tolerance", "one%"), "expected a number"),
        (("--kelvin", "0.2 m"), "--kelvin"),
        (("--tolerance", "1%", "--time-budget", "10 kg"), "--time-budget"),
        (("--tolerance", "1%", "--memory", "0 GB"), "above 0"),
        (("--tolerance", "1%", "--search-time", "2 kg"), "--search-time"),
        (("--tolerance", "1%", "--search-time", "0 s"), "above 0"),
    ],
)
def test_a_wrong_option_is_one_line(options, message, tmp_path):
    scene = SCENES / "figurine.yaml"
    code, _, err = run("plan", scene, "--out", tmp_path / "p", *options, main=main)
    assert code == 2 and message in err and len(err.splitlines()) == 1
    assert not (tmp_path / "p").exists()


@pytest.mark.slow
def test_a_plan_is_a_scene_within_the_tolerance_and_is_kept(
    tmp_path, scene, monkeypatch
):
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / "cache"))
    out = tmp_path / "plan"

    def plan(*options):
        return run("plan", scene, "--out", out, "--tolerance", *options, main=main)

    code, words, err = plan("4%", "--run")
    assert code == 0, err
    record = json.loads((out / "plan.json").read_text())
    reference = record["reference"]
    assert record["chosen"]["error_percent"] + reference["error_percent"] <= 4
    assert record["chosen"]["excess"] + reference["excess"] <= 1
    # Times of a millisecond depend on what else runs: none is compared here.
    allowed = 1 - reference["excess"]
    within = [t["candidate"] for t in record["trials"] if t["excess"] <= allowed]
    assert record["chosen"]["candidate"] in within
    text = (out / "scene.yaml").read_text()
    assert text.startswith("# Made by `calibrate plan block.yaml`, tolerance 4 %.")
    config = load_config(out / "scene.yaml")
    family = config.bodies[0].structure.kind
    assert family == record["chosen"]["candidate"]["family"]
    summary = json.loads((out / "run/summary.json").read_text())
    assert summary["nodes"] == record["chosen"]["nodes"]
    # Again without a run: kept by the scene, the tolerance and the program.
    code, words, err = plan("4%")
    assert code == 0 and "as planned before" in words
    assert json.loads((out / "plan.json").read_text()) == record
    # A search that is cut off takes the candidates that are known.
    code, words, err = plan("4.1%", "--search-time", "1m")
    assert code == 0 and words.count("(run before)") > 3
    # What nothing meets has its own exit status, and leaves no scene.
    monkeypatch.setattr("calibrate.plan.references._MOST_NODES", 3e4)
    code, words, err = plan("0.01%")
    assert code == 3 and "no model is within 0.01 %" in err
    assert "the finest reference is itself off by" in err
    assert not (out / "scene.yaml").exists()


def test_a_plan_does_not_replace_its_scene(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    code, _, err = run("plan", path, "--tolerance", "1%", "--out", tmp_path, main=main)
    assert code == 2 and "would replace" in err and path.read_text() == SCENE
