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
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.segments import (
    RunProgress,
    begin_run,
    compile_segments,
    finish_run,
    run_segments,
)
from tests.shallow import SHALLOW


END = 20.0
SAVES = (4.0, 11.0)
METAL = jt.Material(conductivity=16.0, density=8000.0, specific_heat=500.0)
TERMS = (
    jt.HeatFlux(1e4, on=jt.Side(normal=(-1.0, 0.0, 0.0))),
    jt.Convection(50.0, 290.0),
    jt.Surroundings(temperature=280.0),
)


def scene(dtype: Dtype = "float32", cells=9):
    body = jt.Body(
        jt.FullVolume(bar(cells, 0.01)),
        METAL,
        temperature=lambda points: 300 + 100 * points[:, 0],
    )
    return jt.Scene((body,), TERMS, dtype=dtype)


def planned(run_scene):
    return plan_run(run_scene, t1=END, save_at=SAVES, solver=jt.ForwardEuler(dt=0.07))


def assert_equal_trees(actual, expected):
    assert jax.tree.structure(actual) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True):
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)


def values(solution):
    """Computed quantities of a solution, without what belongs to the scene."""
    return (
        solution.times,
        solution.surface_temperature,
        solution.mean_temperature,
        solution.energy,
    )


def run_on(plan, progress, seconds=1.0):
    """The last progress of a run."""
    return [progress, *run_segments(plan, progress, seconds)][-1]


@SHALLOW
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
        plan = planned(run_scene)
        progress = run_on(plan, compile_segments(plan, begin_run(plan)), seconds)
        solution = finish_run(plan, progress)
    assert progress.steps_done(plan) == plan.steps == expected.run.steps
    assert_equal_trees(values(solution), values(expected))


def test_position_within_the_run():
    plan = planned(scene())
    fresh = begin_run(plan)
    at = [
        (progress.steps_done(plan), progress.time_reached(plan))
        for progress in (fresh, *run_segments(plan, fresh))
    ]
    assert at[0] == (0, 0.0)
    steps, times = np.array(at).T
    assert (np.diff(steps) > 0).all() and (np.diff(times) > 0).all()
    # After its last saved time a run would have nothing to show.
    assert at[-1] == (plan.steps, 11.0)
    assert 4.0 in times


def test_compiling_takes_no_step():
    plan = planned(scene())
    fresh = begin_run(plan)
    start = [np.array(theta) for theta in fresh.state.theta]
    compiled = compile_segments(plan, fresh)
    assert compiled.steps_done(plan) == 0
    assert_equal_trees(list(compiled.state.theta), start)
    done = run_on(plan, compiled)
    assert compile_segments(plan, done) is done


# Checkpoints of float64 are written and read by default in test_time_error.
@pytest.mark.parametrize(
    "dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("stop", [1, 3, 5, None])
def test_a_checkpoint_goes_on_where_it_was(tmp_path, dtype, stop):
    path = tmp_path / "checkpoint.npz"
    with precision(dtype):
        plan = planned(scene(dtype))
        progress = [*islice(run_segments(plan, begin_run(plan)), stop)][-1]
        save_checkpoint(path, plan=plan, progress=progress, key="key")
        loaded = load_checkpoint(path, plan=plan, fresh=begin_run(plan), key="key")
        assert loaded is not None
        assert (loaded.interval, loaded.steps_taken) == (
            progress.interval,
            progress.steps_taken,
        )
        assert_equal_trees(loaded, progress)
        straight = finish_run(plan, run_on(plan, begin_run(plan)))
        resumed = finish_run(plan, run_on(plan, loaded))
    assert_equal_trees(values(resumed), values(straight))
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint.npz"]


class Checkpoint(NamedTuple):
    path: Path
    plan: Plan
    fresh: RunProgress

    def load(self, name="checkpoint.npz", key="key"):
        """Progress in a file of the checkpoint's folder."""
        path = self.path.parent / name
        return load_checkpoint(path, plan=self.plan, fresh=self.fresh, key=key)


@pytest.fixture
def checkpoint(tmp_path):
    """A checkpoint, and the start of the run that it belongs to."""
    path = tmp_path / "checkpoint.npz"
    plan = planned(scene())
    progress = next(iter(run_segments(plan, begin_run(plan))))
    save_checkpoint(path, plan=plan, progress=progress, key="key")
    saved = Checkpoint(path=path, plan=plan, fresh=begin_run(plan))
    assert saved.load() is not None
    return saved


def test_no_checkpoint(checkpoint):
    assert checkpoint.load("none.npz") is None
    assert checkpoint.load(".") is None


def test_a_checkpoint_of_another_config(checkpoint):
    assert checkpoint.load(key="other") is None


def test_a_checkpoint_of_another_shape(checkpoint):
    plan = planned(scene(cells=8))
    shorter_bar = checkpoint._replace(plan=plan, fresh=begin_run(plan))
    assert shorter_bar.load() is None


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_checkpoint_cut_short(checkpoint, share):
    content = checkpoint.path.read_bytes()
    checkpoint.path.write_bytes(content[: int(share * len(content))])
    assert checkpoint.load() is None


def test_a_checkpoint_with_a_flipped_bit_anywhere_is_refused_or_whole(checkpoint):
    intact = checkpoint.load()
    content = bytearray(checkpoint.path.read_bytes())
    for byte in np.random.default_rng(5).integers(0, len(content), 60):
        content[byte] ^= 16
        checkpoint.path.write_bytes(content)
        damaged = checkpoint.load()
        if damaged is not None:
            assert_equal_trees(damaged, intact)
        content[byte] ^= 16


def test_a_checkpoint_of_something_else(tmp_path, checkpoint):
    np.savez(tmp_path / "other.npz", key=np.array("key"), position=np.zeros(3, int))
    assert checkpoint.load("other.npz") is None
    np.save(tmp_path / "array.npy", np.zeros(3))
    assert checkpoint.load("array.npy") is None


def test_a_failed_write_keeps_the_old_checkpoint(checkpoint, monkeypatch):
    path = checkpoint.path
    content = path.read_bytes()

    def full(*arguments, **arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(jt.InputError, match="No space left"):
        save_checkpoint(
            path, plan=checkpoint.plan, progress=checkpoint.fresh, key="key"
        )
    assert path.read_bytes() == content
    assert [p.name for p in path.parent.iterdir()] == [path.name]
