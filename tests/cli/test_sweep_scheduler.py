"""Sweeps in several processes: killed at any moment, and on a real dask scheduler."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.cli.killing import ROOT, kill, start
from tests.cli.test_sweep_command import COMMAND, SERIAL, errors, rows, sweep
from tests.sweeping import SWEEP, sweep_file


FORTY = SWEEP.replace(
    "within: {key: bodies.0.structure.weights.within, values: [0.8, 1, 1.25]}",
    """factor: {key: bodies.0.structure.factor, values: [2, 3]}
  high: {key: bodies.0.voxels_high, values: [8, 9]}
  within: {key: bodies.0.structure.weights.within, values: [0.8, 0.9, 1, 1.1, 1.25]}""",
)
"""Twenty choices under two loads."""
LOCAL = ("--host", "127.0.0.1", "--no-dashboard")
LIMITS = ("--nthreads", 1, "--memory-limit", "2GiB")


def same_errors(actual: dict[str, dict], expected_rows: dict[str, dict]) -> None:
    """Rows of the same cases and the same errors, to rounding."""
    assert set(actual) == set(expected_rows)
    for key, row in actual.items():
        for name in ("rms_kelvin", "p99_kelvin", "bias_kelvin"):
            expected = expected_rows[key]["error"][name]
            np.testing.assert_allclose(
                row["error"][name], expected, rtol=1e-9, atol=1e-12
            )
        assert row["picture"] and row["steps"] == expected_rows[key]["steps"]


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("forty")
    out = folder / "out"
    code, _, err = sweep(sweep_file(folder, FORTY), "--out", out, "--no-times")
    assert (code, err) == (0, "") and len(rows(out)) == 40
    return out


def start_sweep(path: Path, out: Path, *options: object):
    """A process with a sweep, by default without times and with one worker."""
    return start(COMMAND, "sweep", path, "--out", out, *(options or SERIAL))


def without_failures(out: Path) -> bool:
    return all("failed" not in row for row in rows(out).values())


@pytest.mark.slow
def test_forty_cases_killed_at_ten_random_moments(alone, tmp_path, out):
    path = sweep_file(tmp_path, FORTY)
    # The duration of a whole sweep here, on a busy machine or on an idle one.
    clock = time.monotonic()
    assert start_sweep(path, tmp_path / "timed").wait(300) == 0
    seconds = time.monotonic() - clock
    generator = np.random.default_rng(7)
    killed = 0
    for _ in range(10):
        delay = float(generator.uniform(0.2, 0.9)) * seconds
        killed += kill(start_sweep(path, out), delay, lambda: True)
    assert killed >= 3
    rows_before = rows(out) if (out / "rows.jsonl").exists() else {}
    code, _, err = sweep(path, "--out", out, "--no-times")
    assert (code, err) == (0, "")
    rows_after = rows(out)
    assert {key: rows_after[key] for key in rows_before} == rows_before
    same_errors(errors(out), errors(alone))


@pytest.mark.slow
def test_two_local_processes_give_the_rows_of_one(alone, tmp_path, out):
    path = sweep_file(tmp_path, FORTY)
    process = start_sweep(path, out, "--no-times", "--workers", 2)
    assert process.wait(300) == 0
    same_errors(errors(out), errors(alone))


@pytest.mark.slow
def test_an_interrupt_keeps_rows_and_says_how_to_go_on(tmp_path, out):
    path = sweep_file(tmp_path, FORTY)
    words = ["sweep", str(path), "--out", str(out), "--no-times", "--workers", "2"]
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *words],
        env=os.environ | {"JAX_ENABLE_X64": "1"},
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    wait_for(lambda: (out / "rows.jsonl").exists() and len(rows(out)) > 0)
    # As a terminal does: to all processes of the group.
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.fullmatch(
        r"experiments: stopped: \d+ of 40 cases are in .*rows.jsonl, and the same "
        r"command goes on from there\n",
        err,
    ), err


def wait_for(condition) -> None:
    limit = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < limit, "nothing happened for 120 s"
        time.sleep(0.02)


@contextlib.contextmanager
def dask_process(*words: object):
    """A command of dask in a process group of its own, killed at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *map(str, words)],
        # Workers import this program, in the precision of the tests.
        env=os.environ | {"JAX_ENABLE_X64": "1", "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@contextlib.contextmanager
def cluster(folder: Path):
    """A scheduler and two workers; yields its address and the three processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    with contextlib.ExitStack() as stack:

        def begin(*words: object):
            return stack.enter_context(dask_process(*words))

        scheduler = begin("scheduler", "--port", port, *LOCAL)
        wait_for(lambda: is_open(port))
        workers = [
            begin("worker", address, *LIMITS, "--local-directory", folder)
            for _ in range(2)
        ]
        yield address, scheduler, workers


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def sweep_on(address: str, path: Path, out: Path) -> subprocess.Popen:
    words = "sweep", path, "--out", out, "--no-times", "--scheduler", address
    return subprocess.Popen(
        [sys.executable, "-c", COMMAND, *map(str, words)],
        env=os.environ | {"JAX_ENABLE_X64": "1"},
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("is_killed", [False, True])
def test_a_scheduler_with_two_workers_even_if_one_dies(alone, tmp_path, out, is_killed):
    path = sweep_file(tmp_path, FORTY)
    with cluster(tmp_path) as (address, _, workers):
        process = sweep_on(address, path, out)
        if is_killed:
            wait_for(lambda: (out / "rows.jsonl").exists() and len(rows(out)) > 0)
            os.killpg(workers[0].pid, signal.SIGKILL)
        _, err = process.communicate(timeout=300)
    assert process.returncode == 0 and not err, err
    same_errors(errors(out), errors(alone))


@pytest.mark.slow
def test_a_scheduler_that_dies_is_one_line_and_rows_are_kept(alone, tmp_path, out):
    path = sweep_file(tmp_path, FORTY)
    with cluster(tmp_path) as (address, scheduler, _):
        process = sweep_on(address, path, out)
        wait_for(lambda: (out / "rows.jsonl").exists() and len(rows(out)) > 0)
        os.killpg(scheduler.pid, signal.SIGKILL)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 2 and err.count("\n") == 1, err
    assert "connection was lost; finished rows are kept" in err
    assert 0 < len(rows(out)) < 40 and without_failures(out)
    code, _, err = sweep(path, "--out", out, "--no-times")
    assert code == 0, err
    same_errors(errors(out), errors(alone))


@pytest.mark.slow
def test_two_folders_with_cold_caches_have_the_same_errors(tmp_path, monkeypatch):
    tables = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / name / "cache"))
        text = SWEEP.replace("dtype: float64", "dtype: float32")
        path = sweep_file(tmp_path / name, text)
        scene = path.parent / "ball.yaml"
        scene.write_text(scene.read_text().replace("dtype: float64\n", ""))
        out = tmp_path / name / "out"
        assert start_sweep(path, out).wait(300) == 0
        tables.append(errors(out))
    assert set(tables[0]) == set(tables[1])
    for key, row in tables[0].items():
        error = row["error"]["rms_kelvin"]
        expected = tables[1][key]["error"]["rms_kelvin"]
        # A rounding of a temperature of 300 K, 3e-5 K.
        np.testing.assert_allclose(error, expected, rtol=0, atol=3e-5)
