"""`calibrate`: fit, show, identify and check, in this process, of a small sphere."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from cli_runs import run, sets
from killing import kill, start

from calibrate.__main__ import main
from calibrate.report import pictures
from tests.calibrating import SPHERE
from tests.shallow import SHALLOW


# The fit's reference has coarse voxels, too.
pytestmark = SHALLOW

SCENE = SPHERE.replace("end: 60, save_at: [30, 60]", "end: 200, save_at: [100, 200]")
FIT = """
scene: scene.yaml
train: [{name: "+x"}]
held_out: [{name: "+y", set: {terms.0.direction: [0, -1, 0]}}]
candidates: [{name: longer, set: {time.save_at: [100, 200, 400], time.end: 400}}]
parameters: [{name: weights.within}, {name: weights.surface_distance}]
"""
ROOT = Path(__file__).resolve().parents[2]
FILES = {"card.yaml", "config.yaml", "fit.json", "report.html"}


def _write(folder: Path, fit: str = FIT) -> Path:
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "fit.yaml").write_text(fit)
    return folder / "fit.yaml"


def _calibrate(*arguments):
    return run(*arguments, main=main)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A folder with a finished fit in `out`, and what was said."""
    folder = tmp_path_factory.mktemp("fitted")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "SIDE", 60)
        code, out, err = _calibrate("fit", _write(folder), "--out", folder / "out")
    assert code == 0, err
    return folder, out + err


def test_a_fit_leaves_its_files_and_says_what_it_found(fitted):
    folder, said = fitted
    assert {path.name for path in (folder / "out").iterdir()} == FILES
    for words in (
        "weights.within",
        "fitted to",
        "held out",
        "longer",
        "further experiment",
        "error at every saved time",
        "Verdict: the fit ",
    ):
        assert words in said
    result = json.loads((folder / "out" / "fit.json").read_text())
    error = result["error_percent"]
    assert error["train"]["fitted"] < error["train"]["default"]
    assert result["verdict"]["times"] == 4


def test_show_says_the_same_again(fitted):
    folder, said = fitted
    code, out, err = _calibrate("show", folder / "out")
    assert code == 0
    for line in (out + err).splitlines():
        assert line in said


def test_identify_judges_the_start_and_fits_nothing(fitted):
    folder, _ = fitted
    files = sorted(folder.rglob("*"))
    code, out, err = _calibrate("identify", folder / "fit.yaml")
    assert code == 0
    assert "how well the data determine" in out + err
    assert "at the start" in out + err
    assert sorted(folder.rglob("*")) == files


def test_check_holds_where_it_was_fitted_and_warns_outside(fitted):
    folder, _ = fitted
    card = folder / "out" / "card.yaml"

    def check(*options: str):
        return _calibrate("check", card, "--scene", folder / "scene.yaml", *options)

    code, out, err = check()
    assert code == 0
    assert "the card is valid here" in out + err
    assert "warning" not in out + err
    code, out, err = check("--set", "bodies.0.material.conductivity=1")
    assert code == 0
    assert "warning: " in out + err


def test_a_simulation_warns_outside_the_range_of_its_card(fitted, tmp_path):
    folder, _ = fitted
    structure = (
        "bodies.0.structure={kind: aggregate, factor: 2, weights: out/card.yaml}"
    )

    def simulated(*changes: str):
        options = sets(structure, *changes)
        return run("simulate", folder / "scene.yaml", *options, "--out", tmp_path)

    assert "beyond" not in "".join(map(str, simulated()))
    code, out, err = simulated("bodies.0.material.conductivity=1")
    assert code == 0
    assert f"beyond the range of {folder / 'out' / 'card.yaml'}: heating" in out + err
    warnings = json.loads((tmp_path / "summary.json").read_text())["warnings"]
    assert len(warnings) >= 1
    assert all(
        f"warning: {words}" in " ".join((out + err).split()) for words in warnings
    )


def test_a_shipped_card_on_another_body_is_told(fitted):
    """The folder's scene is of a sphere."""
    folder, _ = fitted
    card = "{kind: octree, weights: card://figurine/octree}"
    change = f"bodies.0.structure={card}"
    scene = folder / "scene.yaml"
    code, out, err = run("simulate", scene, "--explain", "--set", change)
    assert code == 0, err
    words = " ".join((out + err).split())
    assert "beyond the range of card://figurine/octree: geometry sphere" in words
    difference = "surface_cells dominant_axis: the card was fitted with crossings"
    assert f"beyond the range of card://figurine/octree: {difference}" in words


def test_show_lists_the_shipped_cards_and_needs_a_folder_otherwise():
    code, out, err = _calibrate("show", "--shipped")
    assert code == 0, err
    assert "card://buddha/octree" in out and "happy-buddha.obj" in out
    code, out, err = _calibrate("show")
    assert code == 2 and "--shipped" in err
    code, out, err = _calibrate("show", "results", "--shipped")
    assert code == 2 and "folder" in err


@pytest.mark.slow
def test_values_too_many_to_judge_are_told_as_one(fitted, tmp_path):
    folder, _ = fitted
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "SIDE", 60)
        for module in ("fit", "optimality"):
            patch.setattr(f"calibrate.solvers.{module}.MAX_JUDGED", 0)
        code, out, err = _calibrate("fit", folder / "fit.yaml", "--out", tmp_path)
    assert code == 0
    assert "not judged" in out + err
    result = json.loads((tmp_path / "fit.json").read_text())
    assert result["correlation"] == [] and result["advice"] == []
    assert all(row["count"] >= 1 for row in result["parameters"].values())
    assert "too many values" in (tmp_path / "report.html").read_text()
    first = (folder / "out" / "card.yaml").read_text()
    assert (tmp_path / "card.yaml").read_text() == first


@pytest.mark.slow
def test_the_quick_one_of_the_readme(tmp_path):
    """In double precision, as all tests are."""
    config = ROOT / "configs" / "calibration" / "figurine-quick.yaml"
    double = "set.dtype=float64"
    code, out, err = _calibrate("fit", config, "--set", double, "--out", tmp_path)
    assert code == 0, out + err
    result = json.loads((tmp_path / "fit.json").read_text())
    # It pays: no error is larger, with a tenth of the nodes and fewer steps.
    assert result["verdict"]["worse"] == 0 and result["verdict"]["times"] == 15
    for errors in result["error_percent"].values():
        assert errors["default"] > 1.05 * errors["fitted"] > 1
    nodes = result["speedup"]["nodes"]
    steps = result["speedup"]["steps"]
    assert nodes["full_volume"] > 10 * nodes["fitted"]
    assert steps["full_volume"] > 2 * steps["fitted"]
    verdicts = {row["verdict"] for row in result["parameters"].values()}
    assert verdicts == {"fine"}


@pytest.mark.slow
def test_the_same_config_makes_the_same_card(fitted, tmp_path):
    folder, _ = fitted
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "SIDE", 60)
        code, _, _ = _calibrate("fit", folder / "fit.yaml", "--out", tmp_path)
    assert code == 0
    first = (folder / "out" / "card.yaml").read_text()
    assert (tmp_path / "card.yaml").read_text() == first


KILLED = """
import sys
from calibrate.__main__ import main
from calibrate.report import pictures

pictures.SIDE = 60
main(sys.argv[1:])
"""


def _numbers(out: Path) -> dict:
    """Results of a fit, without what it took to get them."""
    timed = ("run_time_s", "speedup", "verdict", "checksum", "date")
    result = json.loads((out / "fit.json").read_text())
    return {key: value for key, value in result.items() if key not in timed}


def _write_empty_report(folder: Path, **_: object) -> None:
    (folder / "report.html").touch()


def _fit_words(folder: Path, out: Path) -> tuple[object, ...]:
    return ("fit", folder / "fit.yaml", "--out", out)


def _goes_on_to_the_same(folder: Path, out: Path) -> None:
    uninterrupted = folder / "out"
    speedup = json.loads((uninterrupted / "fit.json").read_text())["speedup"]
    with pytest.MonkeyPatch.context() as patch:
        # Neither times nor drawings are compared.
        patch.setattr("calibrate.run.measure_speed", lambda *_, **__: speedup)
        patch.setattr("calibrate.run.write_report", _write_empty_report)
        code, _, err = _calibrate(*_fit_words(folder, out))
    assert code == 0, err
    assert {path.name for path in out.iterdir()} == FILES
    card = (uninterrupted / "card.yaml").read_bytes()
    assert (out / "card.yaml").read_bytes() == card
    assert _numbers(out) == _numbers(uninterrupted)


# A run that is killed goes on in the default suite, in test_resume; a fit that is
# stopped in the slice, in test_fits_on_devices.
@pytest.mark.slow
def test_a_fit_that_is_killed_goes_on_to_the_same_card(fitted, tmp_path):
    folder, _ = fitted
    process = start(KILLED, *_fit_words(folder, tmp_path))
    delay = np.random.default_rng(3).uniform(0, 0.2)
    assert kill(process, delay, (tmp_path / "state.npz").exists)
    assert not (tmp_path / "card.yaml").exists()
    _goes_on_to_the_same(folder, tmp_path)


@pytest.fixture(scope="module")
def seconds(fitted, tmp_path_factory):
    """Time that the fit takes in a process of its own."""
    out = tmp_path_factory.mktemp("timed")
    clock = time.monotonic()
    assert start(KILLED, *_fit_words(fitted[0], out)).wait() == 0
    return time.monotonic() - clock


@pytest.mark.slow
@pytest.mark.parametrize("moment", range(20))
def test_a_fit_that_is_killed_at_any_moment(fitted, seconds, tmp_path, moment):
    folder, _ = fitted
    process = start(KILLED, *_fit_words(folder, tmp_path))
    delay = np.random.default_rng(moment).uniform(0, seconds)
    kill(process, delay, lambda: True)
    _goes_on_to_the_same(folder, tmp_path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fit", "nowhere.yaml"), "nowhere.yaml"),
        (("identify", "nowhere.yaml"), "nowhere.yaml"),
        (("show", "nowhere"), "`calibrate fit` makes it"),
        (
            ("fit", "fit.yaml", "--set", "parameters.0.name=weights.witin"),
            "did you mean",
        ),
        (
            ("fit", "fit.yaml", "--set", "parameters.0.bounds=[2, 3]"),
            "between its bounds",
        ),
        (("fit", "fit.yaml", "--set", "fit.metod=bfgs"), "unknown key"),
        (
            ("fit", "fit.yaml", "--set", "parameters.0.name=material.mass"),
            "has no 'mass'",
        ),
        (("check", "scene.yaml", "--scene", "scene.yaml"), "scene.yaml"),
        (("fit",), "Try `calibrate --help`"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, arguments, message
):
    _write(tmp_path)
    monkeypatch.chdir(tmp_path)
    files = sorted(tmp_path.rglob("*"))
    code, out, err = _calibrate(*arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("calibrate: ")
    assert err.count("\n") == 1
    assert message in err
    assert sorted(tmp_path.rglob("*")) == files
