"""A run in segments of about a second: progress, and a clean Ctrl-C.

A segment ends after about a second of wall time or at the next save time. All segments
together take exactly the steps that `simulate` takes, in as many passes.
"""

import time
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...arrays import device_array
from ...parallel.processes import agreed
from ...progress import Progress, duration
from ...scene.compile.program import Program, State
from ..stepper import LoopArguments, RunState, in_place
from .made_solution import make_solution
from .part_values import PartNumbers
from .plan import Plan, initial_state, observation_time, window_of
from .schedule import Interval
from .solution import Observation, Solution, observe
from .step_loop import Span, advance
from .time_error import Passes


class RunProgress(NamedTuple):
    """State of a partly finished run: all that is needed to continue it."""

    interval: int
    """Index of the current interval of the plan."""
    steps_taken: int
    """Steps taken in this interval."""
    state: RunState
    initial: Observation
    """Observation at the start."""
    observations: tuple[Observation, ...]
    """Observations at the save times so far, of this pass."""
    passes: Passes = Passes()
    """Passes before this one, where the run controls its error in time."""

    def steps_done(self, plan: Plan) -> int:
        """Return the steps since the start of the pass, in steps of the plan."""
        running = _running(plan, self)
        finished = sum(i.steps for i in running.intervals[: self.interval])
        return (finished + self.steps_taken) * plan.steps // max(running.steps, 1)

    def time_reached(self, plan: Plan) -> float:
        """Return the simulated time [s]."""
        if self.interval == len(plan.intervals):
            return plan.intervals[-1].end if plan.intervals else 0.0
        interval = _running(plan, self).intervals[self.interval]
        return interval.start + self.steps_taken * interval.dt


def begin_run(plan: Plan, passes: Passes | None = None) -> RunProgress:
    """Return the progress of a pass, the first if None, that has not taken a step."""
    passes = Passes() if passes is None else passes
    state = initial_state(passes.running(plan))
    initial = observe(plan.compiled.program, state, None)
    return RunProgress(
        interval=0,
        steps_taken=0,
        state=state,
        initial=initial,
        observations=(),
        passes=passes,
    )


def _running(plan: Plan, progress: RunProgress) -> Plan:
    """Return the plan of the pass that is running."""
    return progress.passes.running(plan)


def _continued(plan: Plan, progress: RunProgress, steps: int) -> RunState:
    interval = plan.intervals[progress.interval]
    return take_segment(
        plan,
        interval=interval,
        state=progress.state,
        steps_taken=progress.steps_taken,
        steps=steps,
    )


def take_segment(
    plan: Plan, interval: Interval, state: RunState, steps_taken: int, steps: int
) -> RunState:
    """Take `steps` more steps of an interval, in place of the temperatures."""
    # Arrays, not Python numbers: the next segment must not compile again.
    arguments = LoopArguments(
        stepper=plan.stepper,
        program=_program_of(plan, interval),
        ledger=state.ledger,
        solver_state=state.solver_state,
        steps=Span(
            window=window_of(interval, plan.dtype),
            dt=device_array(np.asarray(interval.dt), plan.dtype),
            steps=device_array(np.int32(steps)),
            steps_before=device_array(np.int32(steps_taken)),
        ),
    )
    run = in_place(_advance_all, state.theta)
    return jax.block_until_ready(run(arguments, state.theta))


def _advance_all(arguments: LoopArguments, theta: State) -> RunState:
    return advance(
        arguments.stepper,
        program=arguments.program,
        state=arguments.start(theta),
        span=arguments.steps,
    )


def _program_of(plan: Plan, interval: Interval) -> Program:
    return plan.compiled.programs[plan.compiled.number_at(interval.start)]


def compile_segments(plan: Plan, progress: RunProgress) -> RunProgress:
    """Compile the program of all segments now, by a segment of 0 steps.

    The state of the argument `progress` is overwritten.
    """
    if progress.interval == len(plan.intervals):
        return progress
    state = _continued(_running(plan, progress), progress, 0)
    return progress._replace(state=state)


def run_segments(
    plan: Plan, progress: RunProgress, seconds: float = 1.0
) -> Iterator[RunProgress]:
    """Take segments of about `seconds` of wall time until the end of the run.

    The state of a progress is overwritten when the iterator goes on.
    """
    length = 2
    running = _running(plan, progress)
    while progress.interval < len(plan.intervals):
        interval = running.intervals[progress.interval]
        steps = agreed(min(length, interval.steps - progress.steps_taken))
        clock = time.perf_counter()
        state = _continued(running, progress, steps)
        # A clock of coarse resolution may show no time at all.
        spent = max(time.perf_counter() - clock, 1e-6)
        # Even lengths suit the loop of two steps; growth is limited to 8 times, since
        # the first segment's time is mostly compilation.
        length = max(2, 2 * int(min(8 * steps, steps * seconds / spent) / 2))
        steps_taken = progress.steps_taken + steps
        observations = progress.observations
        ended = steps_taken >= interval.steps
        if ended and interval.saved:
            load_time = jnp.asarray(observation_time(running, interval), plan.dtype)
            window = window_of(interval, plan.dtype)
            program = _program_of(plan, interval)
            row = observe(program, state, load_time, window)
            observations = (*observations, row)
        progress = progress._replace(
            interval=progress.interval + 1 if ended else progress.interval,
            steps_taken=0 if ended else steps_taken,
            state=state,
            observations=observations,
        )
        if plan.control is not None and progress.interval == len(plan.intervals):
            progress = _next_pass(plan, progress)
            running = _running(plan, progress)
        yield progress


def shown_segments(
    plan: Plan, start: RunProgress, shown: Progress
) -> Iterator[RunProgress]:
    """Take the segments of `run_segments` and tell each to a receiver of progress."""
    end = duration(plan.save_times[-1])
    passes = 0
    shown.stage("simulating", plan.steps)
    for progress in run_segments(plan, start):
        # The steps begin again with every pass of a run that controls its error.
        if progress.passes.number > passes:
            passes = progress.passes.number
            shown.stage(f"simulating, pass {passes + 1}", plan.steps)
        reached = duration(progress.time_reached(plan))
        shown.reach(progress.steps_done(plan), f"{reached} of {end}")
        yield progress


def _next_pass(plan: Plan, progress: RunProgress) -> RunProgress:
    """Return the start of the next pass, or the end of the run if there is none."""
    assert plan.control is not None
    rows = _stacked(progress.observations)
    passes = progress.passes.after(rows, plan.control, PartNumbers.of(plan))
    if passes.finished:
        return progress._replace(passes=passes, observations=())
    return begin_run(plan, passes)


# One program for all values.
@jax.jit
def _stacked(observations: tuple[Observation, ...]) -> Observation:
    return jax.tree.map(lambda *rows: jnp.stack(rows), *observations)


def finish_run(plan: Plan, progress: RunProgress) -> Solution:
    """Assemble the solution of a run that has reached its end."""
    passes = progress.passes
    if passes.finished:
        return make_solution(_running(plan, progress), passes.rows, passes.error)
    rows = _stacked(progress.observations) if progress.observations else None
    return make_solution(plan, rows)
