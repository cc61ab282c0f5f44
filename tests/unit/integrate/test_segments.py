"""A run in segments is the run in one piece, whatever the segments and the breaks."""

from itertools import islice
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest
from bodies import bar

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.segments import (
    RunProgress,
    begin_run,
    compile_segments,
    finish_run,
    run_segments,
)


END = 20.0
SAVES = (4.0, 11.0)
METAL = jt.Material(conductivity=16.0, density=8000.0, specific_heat=500.0)
TERMS = (
    jt.HeatFlux(1e4, on=jt.Side(normal=(-1.0, 0.0, 0.0))),
    jt.Convection(50.0, 290.0),
    jt.Surroundings(temperature=280.0),
)


def scene(dtype="float32", cells=9):
    body = jt.Body(
        jt.FullVolume(bar(cells, 0.01)),
        METAL,
        temperature=lambda points: 300 + 100 * points[:, 0],
    )
    return jt.Scene((body,), TERMS, dtype=dtype)


def planned(run_scene):
    return plan_run(run_scene, t1=END, save_at=SAVES, solver=jt.ForwardEuler(dt=0.07))


def same(actual, expected):
    assert jax.tree.structure(actual) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True):
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)


def values(solution):
    """What was computed; the rest of a solution is the scene's."""
    return (
        solution.times,
        solution.surface_temperature,
        solution.mean_temperature,
        solution.energy,
    )


def run_on(todo, progress, seconds=1.0):
    """The last progress of a run."""
    return [progress, *run_segments(todo, progress, seconds)][-1]


@pytest.mark.parametrize(
    "dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "seconds",
    [0.0, pytest.param(1.0, marks=pytest.mark.slow)],
    ids=["two steps each", "long"],
)
def test_segments_are_one_long_run(dtype, seconds):
    run_scene = scene(dtype)
    expected = jt.simulate(run_scene, END, SAVES, solver=jt.ForwardEuler(dt=0.07))
    with precision(dtype):
        todo = planned(run_scene)
        progress = run_on(todo, compile_segments(todo, begin_run(todo)), seconds)
        solution = finish_run(todo, progress)
    assert progress.steps_done(todo) == todo.steps == expected.run.steps
    same(values(solution), values(expected))


def test_position_within_the_run():
    run_scene = scene()
    todo = planned(run_scene)
    fresh = begin_run(todo)
    at = [
        (progress.steps_done(todo), progress.time_reached(todo))
        for progress in (fresh, *run_segments(todo, fresh))
    ]
    assert at[0] == (0, 0.0)
    steps, times = np.array(at).T
    assert (np.diff(steps) > 0).all() and (np.diff(times) > 0).all()
    # After its last saved time a run would have nothing to show.
    assert at[-1] == (todo.steps, 11.0)
    assert 4.0 in times


def test_compiling_takes_no_step():
    run_scene = scene()
    todo = planned(run_scene)
    fresh = begin_run(todo)
    start = [np.array(theta) for theta in fresh.state.theta]
    compiled = compile_segments(todo, fresh)
    assert compiled.steps_done(todo) == 0
    same(list(compiled.state.theta), start)
    done = run_on(todo, compiled)
    assert compile_segments(todo, done) is done


# Checkpoints of float64 are written and read by default in test_time_error.
@pytest.mark.parametrize(
    "dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("stop", [1, 3, 5, None])
def test_a_checkpoint_goes_on_where_it_was(tmp_path, dtype, stop):
    run_scene = scene(dtype)
    path = tmp_path / "checkpoint.npz"
    with precision(dtype):
        todo = planned(run_scene)
        progress = [*islice(run_segments(todo, begin_run(todo)), stop)][-1]
        save_checkpoint(path, plan=todo, progress=progress, key="key")
        loaded = load_checkpoint(path, plan=todo, fresh=begin_run(todo), key="key")
        assert loaded is not None
        assert (loaded.interval, loaded.steps_taken) == (
            progress.interval,
            progress.steps_taken,
        )
        same(loaded, progress)
        straight = finish_run(todo, run_on(todo, begin_run(todo)))
        resumed = finish_run(todo, run_on(todo, loaded))
    same(values(resumed), values(straight))
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint.npz"]


class Checkpoint(NamedTuple):
    path: Path
    plan: Plan
    fresh: RunProgress


@pytest.fixture
def checkpoint(tmp_path):
    """A checkpoint, and the start of the run that it belongs to."""
    run_scene = scene()
    path = tmp_path / "checkpoint.npz"
    todo = planned(run_scene)
    progress = next(iter(run_segments(todo, begin_run(todo))))
    save_checkpoint(path, plan=todo, progress=progress, key="key")
    fresh = begin_run(todo)
    assert load_checkpoint(path, plan=todo, fresh=fresh, key="key") is not None
    return Checkpoint(path, todo, fresh)


def test_no_checkpoint(tmp_path, checkpoint):
    _, todo, fresh = checkpoint
    assert (
        load_checkpoint(tmp_path / "none.npz", plan=todo, fresh=fresh, key="key")
        is None
    )
    assert load_checkpoint(tmp_path, plan=todo, fresh=fresh, key="key") is None


def test_a_checkpoint_of_another_config(checkpoint):
    path, todo, fresh = checkpoint
    assert load_checkpoint(path, plan=todo, fresh=fresh, key="other") is None


def test_a_checkpoint_of_another_shape(checkpoint):
    path, *_ = checkpoint
    todo = planned(scene(cells=8))
    assert load_checkpoint(path, plan=todo, fresh=begin_run(todo), key="key") is None


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_checkpoint_cut_short(checkpoint, share):
    path, todo, fresh = checkpoint
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert load_checkpoint(path, plan=todo, fresh=fresh, key="key") is None


def test_a_checkpoint_with_a_flipped_bit_anywhere_is_refused_or_whole(checkpoint):
    path, todo, fresh = checkpoint
    intact = load_checkpoint(path, plan=todo, fresh=fresh, key="key")
    content = bytearray(path.read_bytes())
    for byte in np.random.default_rng(5).integers(0, len(content), 60):
        content[byte] ^= 16
        path.write_bytes(content)
        damaged = load_checkpoint(path, plan=todo, fresh=fresh, key="key")
        if damaged is not None:
            same(damaged, intact)
        content[byte] ^= 16


def test_a_checkpoint_of_something_else(tmp_path, checkpoint):
    _, todo, fresh = checkpoint
    np.savez(tmp_path / "other.npz", key=np.array("key"), position=np.zeros(3, int))
    assert (
        load_checkpoint(tmp_path / "other.npz", plan=todo, fresh=fresh, key="key")
        is None
    )
    np.save(tmp_path / "array.npy", np.zeros(3))
    assert (
        load_checkpoint(tmp_path / "array.npy", plan=todo, fresh=fresh, key="key")
        is None
    )


def test_a_failed_write_keeps_the_old_checkpoint(checkpoint, monkeypatch):
    path, todo, fresh = checkpoint
    content = path.read_bytes()

    def full(*arguments, **arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(jt.InputError, match="No space left"):
        save_checkpoint(path, plan=todo, progress=fresh, key="key")
    assert path.read_bytes() == content
    assert [p.name for p in path.parent.iterdir()] == [path.name]
