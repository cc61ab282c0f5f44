"""The same program in segments: for progress, checkpoints and a clean Ctrl-C.

A segment is about a second of wall time or what is left up to the next save time, and
takes exactly the steps that one long run would take.
"""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...atomic import replacing
from ...scene.compile.program import Program, State
from ...scene.scene import Scene
from .observe import Observation, observe
from .schedule import Interval
from .simulate import Plan, assemble_solution, imbalance, last_load, start, uneven_nodes
from .solution import Solution
from .state import AbstractStepper, RunState
from .time_loop import advance


class Progress(NamedTuple):
    """Where a run stands: all that is needed to go on."""

    interval: int
    done: int
    """Steps taken in this interval."""
    state: RunState
    first: Observation
    even: jax.Array
    """Heat that conduction must move to even out the start [J]."""
    seen: tuple[Observation, ...]
    """At the end of each finished leg."""


@eqx.filter_jit(donate="all-except-first")
def _segment(keep: tuple[AbstractStepper, Program, Any, tuple], theta: State):
    """Steps in place; what else is in a state is small and shared, so it stays."""
    stepper, program, (ledger, work), (begin, dt, steps, done) = keep
    state = RunState(theta, ledger, work)
    return advance(stepper, program, state, begin, dt, steps, done)


def begin(scene: Scene, plan: Plan) -> Progress:
    """The progress of a run that has not started."""
    program, fresh = plan.compiled.program, start(plan)
    # A copy, since segments are taken in place and the plan must stay whole.
    theta = jax.tree.map(jnp.array, fresh.theta)
    state = RunState(theta, fresh.ledger, fresh.work)
    even = imbalance(program, state.theta, uneven_nodes(plan.scene))
    return Progress(0, 0, state, observe(program, state, None), even, ())


def steps_done(plan: Plan, progress: Progress) -> int:
    """Steps taken in all."""
    return sum(i.steps for i in plan.intervals[: progress.interval]) + progress.done


def time_reached(plan: Plan, progress: Progress) -> float:
    """Simulated time [s]."""
    if progress.interval == len(plan.intervals):
        return plan.intervals[-1].end if plan.intervals else 0.0
    interval = plan.intervals[progress.interval]
    return interval.start + progress.done * interval.dt


def _take(plan: Plan, progress: Progress, steps: int) -> RunState:
    interval = plan.intervals[progress.interval]
    span = (
        jnp.asarray(interval.start, plan.dtype),
        jnp.asarray(interval.dt, plan.dtype),
        jnp.asarray(steps, jnp.int32),
        jnp.asarray(progress.done, jnp.int32),
    )
    program, state = _program(plan, interval), progress.state
    keep = (plan.stepper, program, (state.ledger, state.work), span)
    return jax.block_until_ready(_segment(keep, state.theta))


def _program(plan: Plan, interval: Interval) -> Program:
    return plan.compiled.programs[plan.compiled.number_at(interval.start)]


def compile_segments(plan: Plan, progress: Progress) -> Progress:
    """Take no step: the compilation happens now. Uses up the progress given."""
    if progress.interval == len(plan.intervals):
        return progress
    return progress._replace(state=_take(plan, progress, 0))


def segments(
    plan: Plan, progress: Progress, seconds: float = 1.0
) -> Iterator[Progress]:
    """Take segments of about `seconds` of wall time until the end.

    The state of a progress is used up when the next one is asked for.
    """
    length = 2
    while progress.interval < len(plan.intervals):
        interval = plan.intervals[progress.interval]
        steps = min(length, interval.steps - progress.done)
        clock = time.perf_counter()
        state = _take(plan, progress, steps)
        spent = max(time.perf_counter() - clock, 1e-6)
        # Even lengths keep the two-step loop; growth is held back, since the first
        # segment's time is mostly compilation.
        length = max(2, 2 * int(min(8 * steps, steps * seconds / spent) / 2))
        done = progress.done + steps
        if done < interval.steps:
            progress = progress._replace(done=done, state=state)
        else:
            progress = progress._replace(
                interval=progress.interval + 1, done=0, state=state
            )
            if interval.saved:
                loads = last_load(plan, interval)
                row = observe(_program(plan, interval), state, loads)
                progress = progress._replace(seen=(*progress.seen, row))
        yield progress


def finish(scene: Scene, plan: Plan, progress: Progress) -> Solution:
    """The solution of a run that has reached its end."""
    if not progress.seen:
        nothing = jax.tree.map(lambda a: a[None][:0], progress.first)
        return assemble_solution(scene, plan, progress.first, nothing, progress.even)
    seen = jax.tree.map(lambda *rows: jnp.stack(rows), *progress.seen)
    return assemble_solution(scene, plan, progress.first, seen, progress.even)


def save_checkpoint(path: Path, progress: Progress, key: str) -> None:
    """Write a progress, marked with the `key` of its configuration, in one step."""
    leaves = jax.tree.leaves((progress.state, progress.first, progress.even))
    rows = [jax.tree.leaves(row) for row in progress.seen]
    arrays: dict[str, Any] = {
        f"leaf{i}": np.asarray(leaf) for i, leaf in enumerate(leaves)
    }
    for k, row in enumerate(rows):
        arrays |= {f"seen{k}_{i}": np.asarray(leaf) for i, leaf in enumerate(row)}
    position = np.array([progress.interval, progress.done, len(rows)])
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, key=np.array(key), position=position, **arrays)


def load_checkpoint(path: Path, fresh: Progress, key: str) -> Progress | None:
    """The progress kept at `path`; None if there is none of this configuration."""
    try:
        # Opened here, since np.load leaves a damaged file that it opened itself open.
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as kept:
            if str(kept["key"]) != key:
                return None
            interval, done, rows = (int(n) for n in kept["position"])
            template = (fresh.state, fresh.first, fresh.even)
            leaves, tree = jax.tree.flatten(template)
            loaded = [jnp.asarray(kept[f"leaf{i}"]) for i in range(len(leaves))]
            old, row_tree = jax.tree.flatten(fresh.first)
            seen = [
                [jnp.asarray(kept[f"seen{k}_{i}"]) for i in range(len(old))]
                for k in range(rows)
            ]
    except Exception:  # numpy and zipfile raise whatever a damaged file leads them to
        return None
    if any(a.shape != b.shape for a, b in zip(leaves, loaded, strict=True)):
        return None
    state, first, even = jax.tree.unflatten(tree, loaded)
    observed = tuple(jax.tree.unflatten(row_tree, row) for row in seen)
    return Progress(interval, done, state, first, even, observed)
