"""`experiments sweep`: rows, results, resuming, and mistakes in one line."""

import json
import re
import time
from pathlib import Path

import jax
import pytest
from typing_extensions import override

from calibrate.study.sweep import Options, run_sweep
from experiments.__main__ import main
from jaxthermo.errors import InputError
from jaxthermo.progress import _SilentProgress
from tests.cli.cli_runs import files, run
from tests.cli.killing import kill, start
from tests.cli.test_full_disk import largest_file
from tests.sweeping import FIT, SWEEP, TUNED, sweep_file


COMMAND = "import sys; from experiments.__main__ import main; main(sys.argv[1:])"


SERIAL = ("--no-times", "--workers", 1)


def sweep(*arguments: object) -> tuple[object, str, str]:
    return run("sweep", *arguments, "--workers", 1, main=main)


def rows(folder: Path, name: str = "rows.jsonl") -> dict[str, dict]:
    row_list = [json.loads(line) for line in (folder / name).read_text().splitlines()]
    assert len({row["id"] for row in row_list}) == len(row_list)
    return {row["id"]: row for row in row_list}


def errors(folder: Path) -> dict[str, dict]:
    """Rows but for times."""
    return {
        key: {k: v for k, v in row.items() if k != "took_s"}
        for key, row in rows(folder).items()
    }


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Path:
    """A sweep of six cases, with times, that was left alone."""
    folder = tmp_path_factory.mktemp("alone")
    code, out, err = sweep(sweep_file(folder), "--out", folder / "out")
    assert code == 0 and err == "", err
    assert "error %" in out and "full volume" in out
    return folder / "out"


def test_a_sweep_leaves_rows_times_pictures_and_a_result(alone):
    cases = rows(alone)
    timed = rows(alone, "times.jsonl")
    assert len(cases) == 6 and set(timed) == set(cases)
    for row in cases.values():
        assert row["error"]["worst_rms_percent"] > 0 and row["together"] == 3
        assert row["own_error"]["worst_rms_kelvin"] > 0
        assert row["energy_residual"] < 1e-12
        assert (alone / row["picture"]).read_bytes().startswith(b"\x89PNG")
    result = json.loads((alone / "result.json").read_text())
    assert result["cases"] == {"all": 6, "finished": 6, "failed": 0, "timed": 6}
    # Both loads of a choice take the same: one is timed.
    copied = [row for row in timed.values() if "timed_as" in row]
    assert len(copied) == 3
    for row in copied:
        source = timed[row["timed_as"]]
        assert source["loop_s"] == row["loop_s"] and "timed_as" not in source
        assert source["choice"] == row["choice"] and source["load"] != row["load"]
    first = result["choices"][0]
    loads = [r for r in cases.values() if r["choice"] == first["choice"]]
    assert first["rms_percent"] == max(r["error"]["worst_rms_percent"] for r in loads)
    assert first["loop_s"] > 0 and result["processor"]
    text = (alone / "report.html").read_text()
    assert "within" in text and not re.search(r"(src|href)=.(?!data:)|url\(", text)
    # A point of each choice, which tells its error and shows its picture.
    assert text.count('data-tip="') == 3
    (table,) = map(json.loads, re.findall(r"const tips = (.*);\n", text))
    assert all(" % (" in words and picture for words, picture in table)
    assert not [name for name in files(alone) if "tmp" in name]


@pytest.mark.slow
def test_a_sweep_that_was_killed_goes_on_with_the_same_rows(alone, tmp_path, out):
    config = sweep_file(tmp_path)
    process = start(COMMAND, "sweep", config, "--out", out, *SERIAL)
    path = out / "rows.jsonl"
    assert kill(process, 0, lambda: path.exists() and path.stat().st_size > 0)
    rows_before = path.read_text().splitlines()
    assert 0 < len(rows_before) < 6
    code, _, err = sweep(config, "--out", out, "--no-times")
    assert code == 0, err
    rows_after = path.read_text().splitlines()
    assert rows_after[: len(rows_before)] == rows_before
    assert errors(out) == errors(alone)


def test_a_finished_sweep_repeats_nothing_and_another_config_is_refused(
    alone, tmp_path
):
    stamp = (alone / "rows.jsonl").stat().st_mtime_ns
    code, out, _ = sweep(sweep_file(tmp_path), "--out", alone)
    assert code == 0 and "error %" in out
    assert (alone / "rows.jsonl").stat().st_mtime_ns == stamp
    code, _, err = sweep(sweep_file(tmp_path), "--out", alone, "--set", "truth.seed=5")
    assert code == 2 and err.count("\n") == 1 and "rows of another config" in err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("weights.within,", "weights.withn,", "did you mean 'within'"),
        ("bodies.0.structure.w", "bodies.3.structure.w", "has 1 entries"),
        ("ball.yaml", "bell.yaml", "bell.yaml"),
    ],
)
def test_an_axis_that_names_nothing_is_one_line(tmp_path, old, new, message):
    path = sweep_file(tmp_path, SWEEP.replace(old, new))
    code, _, err = sweep(path, "--out", tmp_path / "out")
    assert code == 2 and message in err and "Traceback" not in err
    assert len(set(err.splitlines())) == 1
    assert not (tmp_path / "out").exists()


def test_a_failed_case_is_a_row_that_is_run_again_on_request(tmp_path, out):
    text = SWEEP.replace("[0.8, 1, 1.25]", "[1]").replace(
        "\ntruth", "\n  step: {key: solver.dt, values: [auto, 1000 s]}\ntruth"
    )
    path = sweep_file(tmp_path, text)
    code, said, _ = sweep(path, "--out", out, "--no-times")
    assert code == 0 and "2 cases failed" in said and "too long" in said
    failed = [row for row in rows(out).values() if "failed" in row]
    assert len(failed) == 2 and len(rows(out)) == 4
    time.sleep(0.01)
    stamp = (out / "rows.jsonl").stat().st_mtime_ns
    sweep(path, "--out", out, "--no-times")
    assert (out / "rows.jsonl").stat().st_mtime_ns == stamp
    _, said, _ = sweep(path, "--out", out, "--no-times", "--retry")
    assert "2 failed cases are run again" in said
    assert (out / "rows.jsonl").stat().st_mtime_ns > stamp and len(rows(out)) == 4


def test_devices_are_of_one_process_and_share_cases_of_one_shape(
    tmp_path, out, monkeypatch
):
    path = sweep_file(tmp_path)
    code, _, err = run(
        "sweep", path, "--out", out, "--workers", 2, "--devices", 2, main=main
    )
    assert code == 2 and err.count("\n") == 1 and "leave --workers" in err
    for device_count, devices, message in (
        (1, 4, "there is 1 cpu device; give at most 1"),
        (8, 4, "this sweep has at most 3 together; give at most 3"),
    ):
        monkeypatch.setattr(jax, "device_count", lambda count=device_count: count)
        with pytest.raises(InputError, match=f"^devices={devices}: .*{message}"):
            run_sweep(path, out, (), Options(devices=devices), _SilentProgress())
    assert not out.exists()


def test_an_unreachable_scheduler_is_one_line(tmp_path, out, monkeypatch):
    monkeypatch.setattr("calibrate.study.pool._WAIT_S", 1.0)
    path = sweep_file(tmp_path)
    address = "tcp://127.0.0.1:9"
    code, _, err = sweep(path, "--out", out, "--no-times", "--scheduler", address)
    assert code == 2 and err.count("\n") == 1 and "cannot be reached" in err


def test_a_full_disk_is_one_line_and_rows_are_kept(alone, tmp_path, out):
    """Files may not grow beyond the rows of all cases but the last ones."""
    path = sweep_file(tmp_path)
    with largest_file((alone / "rows.jsonl").stat().st_size - 100):
        code, _, err = sweep(path, "--out", out, "--no-times")
    assert code == 2 and err.count("\n") == 1, err
    assert "cannot write" in err and "rows before are kept" in err
    assert len(rows(out)) == 3 and "error" in next(iter(rows(out).values()))
    assert sweep(path, "--out", out, "--no-times")[0] == 0
    assert errors(out) == errors(alone)


@pytest.mark.slow
def test_tuning_by_hand_stands_beside_a_fit(tmp_path, out):
    (tmp_path / "fit.yaml").write_text(FIT)
    path = sweep_file(tmp_path, TUNED)
    code, said, err = sweep(path, "--out", out, "--no-times")
    assert (code, err) == (0, "") and "best by fit: within" in said
    comparison = json.loads((out / "result.json").read_text())["fit"]
    # The fit lowers the mean over all times, the sweep shows the worst of them.
    assert comparison["fit"]["rms_percent"] < comparison["start"]["rms_percent"]
    assert comparison["sweep"]["rms_percent"] < comparison["start"]["rms_percent"]
    assert comparison["sweep"]["runs"] == 25
    assert comparison["times_fewer_runs"] == 25 / comparison["fit"]["runs"]
    text = (out / "report.html").read_text()
    assert "Error over both" in text and text.count("<svg") == 3
    stamp = (out / "fit" / "fit.json").stat().st_mtime_ns
    assert sweep(path, "--out", out, "--no-times")[0] == 0
    assert (out / "fit" / "fit.json").stat().st_mtime_ns == stamp


def test_a_fit_of_something_else_is_one_line(tmp_path, out):
    (tmp_path / "fit.yaml").write_text(FIT.replace(", {name: weights.between}", ""))
    text = TUNED.replace("count: 5", "count: 2")
    path = sweep_file(tmp_path, text)
    code, _, err = sweep(path, "--out", out, "--no-times")
    assert code == 2 and err.count("\n") == 1
    assert "the axis between is no range of a value that is fitted" in err


class _Counting(_SilentProgress):
    """Counts finished cases of each stage of errors."""

    def __init__(self) -> None:
        self.done = 0
        self.total = 0

    @override
    def stage(self, name, total=None, done=0):
        if name == "errors":
            assert done == self.done
            self.total = total

    @override
    def advance(self, count=1):
        self.done += count


def test_a_study_tells_how_many_cases_are_done(tmp_path):
    """Of two loads each; a study that is finished asks the same choices again."""
    text = SWEEP.replace("values: [0.8, 1, 1.25]", "between: [0.5, 2], log: true")
    study = "\nsampling: {kind: optuna, count: 3, batch: 2, seed: 1}\ntruth"
    config = sweep_file(tmp_path, text.replace("\ntruth", study))
    progress = _Counting()
    options = Options(times=False)
    result = run_sweep(config, tmp_path / "out", (), options, progress)
    assert progress.done == progress.total == len(result.rows) == 6
    again = run_sweep(config, tmp_path / "out", (), options, _SilentProgress())
    assert again.rows == result.rows
