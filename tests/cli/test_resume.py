"""A run that is cut off: what it leaves, and that it ends as if it had not been."""

import os
import signal
import time
from contextlib import nullcontext

import numpy as np
import pytest
from cli_runs import RESULTS, files, frame_files, run, scene_file, sets, succeed
from killing import kill, start

import jaxthermo.cli.simulate as command
from jaxthermo.console.results_folder import prepare_folder
from jaxthermo.progress import _SilentProgress


STEPS = ("--set", "solver.dt=0.02")
"""1000 steps, in many segments: they start with two steps and grow from there."""


def simulate(scene, out, *options):
    return run("simulate", scene, "--out", out, *STEPS, *options)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("uninterrupted")
    succeed("simulate", scene_file(folder), "--out", folder / "out", *STEPS)
    return folder / "out"


def call_at_each_segment(monkeypatch, reach):
    """Have a function called with the steps done at the end of each segment."""

    class Called(_SilentProgress):
        def reach(self, done, note=""):
            reach(done)

    monkeypatch.setattr(command, "terminal_progress", lambda _: nullcontext(Called()))


@pytest.fixture
def stop_at(monkeypatch):
    """A function that has Ctrl-C pressed once, after the given number of steps.

    It returns the list of what the next run has done at the end of each segment.
    """

    def arrange(step: int | None) -> list[int]:
        reached: list[int] = []

        def reach(done: int) -> None:
            if step is not None and done >= step > max(reached, default=0):
                signal.raise_signal(signal.SIGINT)
            reached.append(done)

        call_at_each_segment(monkeypatch, reach)
        return reached

    return arrange


def same_arrays(path, expected_path):
    with np.load(path) as a, np.load(expected_path) as b:
        assert set(a.files) == set(b.files)
        for name in a.files:
            assert a[name].dtype == b[name].dtype
            np.testing.assert_array_equal(a[name], b[name], name)


def test_an_interrupted_run_goes_on_and_ends_the_same(
    scene, out, stop_at, uninterrupted
):
    first_segments = stop_at(10)
    code, _, err = simulate(scene, out)
    assert code == 130
    assert err == (
        f"jaxthermo: stopped at t = {0.02 * first_segments[-1]:.4g} s; the same "
        "command goes on from there\n"
    )
    assert files(out) == {"config.yaml", "checkpoint.npz"}

    # In the second interval, so that an observation is kept too.
    middle = stop_at(251)
    code, text, err = simulate(scene, out)
    assert (code, err.count("\n")) == (130, 1)
    assert f"going on from t = {0.02 * first_segments[-1]:.4g} s" in text
    assert middle[0] > first_segments[-1]
    assert 250 < middle[-1] < 1000

    last_segments = stop_at(None)
    code, _, err = simulate(scene, out)
    assert (code, err) == (0, "")
    assert last_segments[0] > middle[-1]
    assert last_segments[-1] == 1000
    assert files(out) == RESULTS | frame_files()
    same_arrays(out / "solution.npz", uninterrupted / "solution.npz")
    energies = (folder / "energy.csv" for folder in (out, uninterrupted))
    assert next(energies).read_text() == next(energies).read_text()


def test_a_stop_at_the_last_step_loses_nothing(tmp_path, scene, stop_at, uninterrupted):
    stop_at(1000)
    assert simulate(scene, tmp_path / "out").status == 130
    segments = stop_at(None)
    assert simulate(scene, tmp_path / "out").status == 0
    assert segments == []
    same_arrays(tmp_path / "out/solution.npz", uninterrupted / "solution.npz")


OTHERS = {
    "start": "bodies.0.temperature=310",
    "structure": "bodies.0.structure={kind: octree, levels: 1}",
    # Of these the arrays have the shapes of the run that they must not pass for.
    "weights": "bodies.0.structure.weights.surface_distance=0.5",
    "surface map": "bodies.0.surface_map=constant",
}


@pytest.mark.parametrize("damage", [*OTHERS, "cut", "junk", "empty"])
def test_a_checkpoint_that_does_not_fit_is_ignored(
    scene, out, stop_at, uninterrupted, damage
):
    stop_at(1)
    changes = [OTHERS[damage]] if damage in OTHERS else []
    assert simulate(scene, out, *sets(*changes)).status == 130
    checkpoint = out / "checkpoint.npz"
    content = checkpoint.read_bytes()
    damaged = {"cut": content[: len(content) // 2], "junk": b"junk" * 99, "empty": b""}
    checkpoint.write_bytes(damaged.get(damage, content))

    # To the end after one of each kind: from the start it is the same run each time.
    ends = damage in ("weights", "junk")
    segments = stop_at(None if ends else 1)
    code, text, err = run("simulate", scene, "--out", out, *STEPS)
    assert (code, err.count("\n")) == ((0, 0) if ends else (130, 1))
    assert "going on" not in text and "starting again" in text
    assert segments[0] == 2
    if not ends:
        return
    assert files(out) == RESULTS | frame_files()
    same_arrays(out / "solution.npz", uninterrupted / "solution.npz")


WITH_WALLS = """
bodies:
  - shape: {kind: box, size: [30 cm, 20 cm, 15 cm]}
    sheet:
      layers:
        - {material: steel, thickness: 1 mm}
        - {material: mineral_wool, thickness: 1 cm}
      pitch: 10 cm
      cells: 3
    interior: {temperature: 40 degC, heat_transfer_coefficient: 4 W/(m^2 K)}
    temperature: 20 degC
  - shape: {kind: box, size: [10 cm, 10 cm, 10 cm]}
    pitch: 5 cm
    skin: {cells: 3}
    material: brick
    temperature: 20 degC
    pose: {translation: [0.6, 0, 0]}
terms:
  - {kind: sun, direction: [0.5, 0.2, -1], irradiance: 800}
  - {kind: radiative_exchange, temperature: 280}
time: {end: 20 s, save_at: [5 s, 12 s, 20 s]}
camera: {width: 40, height: 30}
"""


@pytest.mark.parametrize(
    "solver", ["forward_euler", pytest.param("trbdf2", marks=pytest.mark.slow)]
)
def test_a_run_with_walls_and_a_skin_goes_on_and_ends_the_same(
    tmp_path, stop_at, solver
):
    path = scene_file(tmp_path, WITH_WALLS)
    steps = sets(f"solver={{kind: {solver}, dt: 0.5 s}}")
    succeed("simulate", path, "--out", tmp_path / "whole", *steps)
    out = tmp_path / "parts"
    for step in (3, 25):
        stop_at(step)
        assert run("simulate", path, "--out", out, *steps).status == 130
    assert len(stop_at(None)) == 0
    assert "going on from" in succeed("simulate", path, "--out", out, *steps)
    same_arrays(out / "solution.npz", tmp_path / "whole/solution.npz")
    energies = [(tmp_path / name / "energy.csv") for name in ("whole", "parts")]
    assert energies[0].read_text() == energies[1].read_text()


# Checkpoints after every segment or second, and time to be killed between them.
KILLED = """
import sys, time
import jaxthermo.cli.simulate as command
from jaxthermo.__main__ import main

def save(*arguments, **named):
    written(*arguments, **named)
    time.sleep(float(sys.argv[2]))

command._CHECKPOINT_EVERY = float(sys.argv[1])
written, command.save_checkpoint = command.save_checkpoint, save
main(sys.argv[3:])
"""


def goes_on_to_the_same(scene, out, uninterrupted, steps=STEPS):
    """The same command again ends with the results of the run that was not killed."""
    succeed("simulate", scene, "--out", out, *steps)
    assert files(out) == RESULTS | frame_files()
    same_arrays(out / "solution.npz", uninterrupted / "solution.npz")
    for name in ("energy.csv", "config.yaml"):
        assert (out / name).read_bytes() == (uninterrupted / name).read_bytes()


def test_a_run_that_is_killed_goes_on_and_ends_the_same(scene, out, uninterrupted):
    delay = np.random.default_rng(7).uniform(0, 1)
    process = start(KILLED, 0.0, 0.3, "simulate", scene, "--out", out, *STEPS)
    assert kill(process, delay, (out / "checkpoint.npz").exists)
    assert "checkpoint.npz" in files(out) and "summary.json" not in files(out)
    goes_on_to_the_same(scene, out, uninterrupted)


MANY_STEPS = ("--set", "solver.dt=1e-4")


def start_long(scene, out):
    """A process that runs many steps, with a checkpoint every second."""
    return start(KILLED, 1.0, 0.0, "simulate", scene, "--out", out, *MANY_STEPS)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """The folder of a long run that is not killed, and its duration [s]."""
    folder = tmp_path_factory.mktemp("long")
    clock = time.monotonic()
    assert start_long(scene_file(folder), folder / "out").wait() == 0
    return folder / "out", time.monotonic() - clock


@pytest.mark.slow
@pytest.mark.parametrize("moment", range(20))
def test_killed_at_any_moment_it_ends_the_same(scene, out, long, moment):
    uninterrupted, seconds = long
    delay = np.random.default_rng(moment).uniform(0, seconds)
    kill(start_long(scene, out), delay, lambda: True)
    goes_on_to_the_same(scene, out, uninterrupted, steps=MANY_STEPS)


def test_what_a_killed_process_left_behind_is_removed(tmp_path):
    gone = tmp_path / ".solution.4194399-0123abcd.npz"
    running = tmp_path / f".energy.{os.getpid()}-0123abcd.csv"
    users = tmp_path / ".notes.2026-08-01.txt"
    for path in (gone, running, users):
        path.write_text("half")
    prepare_folder(tmp_path)
    assert files(tmp_path) == {running.name, users.name}


def test_a_second_interrupt_does_not_wait(scene, out, monkeypatch):
    def interrupt_twice(done: int) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    call_at_each_segment(monkeypatch, interrupt_twice)
    code, _, err = run("simulate", scene, "--out", out, *STEPS)
    assert (code, err) == (130, "jaxthermo: interrupted\n")
    assert files(out) == {"config.yaml"}


def test_checkpoints_are_written_on_the_way(scene, out, stop_at, monkeypatch):
    monkeypatch.setattr(command, "_CHECKPOINT_EVERY", 0.0)
    saved = []
    save = command.save_checkpoint

    def noted(path, plan, progress, key):
        save(path, plan=plan, progress=progress, key=key)
        saved.append(progress.steps_taken)

    monkeypatch.setattr(command, "save_checkpoint", noted)
    segments = stop_at(None)
    assert run("simulate", scene, "--out", out, *STEPS)[0] == 0
    assert len(saved) == len(segments) > 3
    assert files(out) == RESULTS | frame_files()
