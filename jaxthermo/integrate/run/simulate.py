"""`simulate`: from a scene to its solution, as one compiled program."""

import warnings
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import NamedTuple

import jax

from ...alike_lines import grouped_lines
from ...errors import require
from ...progress import Progress
from ...scene.compile.on_devices import on_devices
from ...scene.compile.program import State
from ...scene.scene import Scene
from ..solvers import AbstractSolver
from ..stepper import LoopArguments, RunState, in_place
from . import segments
from .fixed_steps import take_fixed_steps
from .made_solution import make_solution
from .part_values import PartNumbers
from .plan import (
    Plan,
    StepTable,
    initial_state,
    plan_run,
    step_blocks,
    step_table,
)
from .solution import (
    Observation,
    Solution,
    finished,
    saved_rows,
)
from .step_loop import steps_of, take_row
from .time_error import Passes


def simulate(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None = None,
    *,
    solver: AbstractSolver | None = None,
    throw: bool = True,
    reverse_memory: int | None = None,
    devices: int = 1,
    progress: Callable[[], AbstractContextManager[Progress]] | None = None,
) -> Solution:
    """Integrate the temperatures of a scene in time and return those of its surface.

    At every node i, with heat rates positive into the node,

        C_i dT_i/dt = sum_j G_ij (T_j - T_i) + sum_terms q_i(T_i, t)    [W],

    C the heat capacity [J/K], G the conductance of each link [W/K], q the heat rates
    of surface and volume terms, contacts and mutual radiation [W].

    The run is one jitted program. It may itself be jitted, mapped or differentiated
    with respect to anything in the scene that is a number; then give the step in
    `solver` and, for long runs in reverse mode, a `reverse_memory`.

    Args:
        scene: bodies and terms.
        t1: end of the run [s]; it stops at the last of `save_at`, since nothing that
            happens later would be in the solution.
        save_at: increasing times to save [s]; None for the end.
        solver: one of `jaxthermo.integrate.solvers`; None for `ErrorControl()`, as
            many steps as an error in time of 0.1 % of the surface's range asks for.
            Where values are traced the run cannot be repeated: None then selects a
            solver from the number of stable steps.
        throw: raise if the run failed; otherwise `Solution.result` says so.
        reverse_memory: memory for the states that reverse mode stores [bytes]; steps
            are recomputed from the nearest stored state. None stores all.
        devices: number of devices to spread full volumes over, one section on each.
            The run is the same to rounding; other structures run on one device.
        progress: `progress_bar`, or another context of a receiver of the progress. The
            run then takes the same steps in segments of about a second. None, and a run
            of traced values, show nothing.

    Returns:
        Surface temperatures [K], energies [J] and the outcome at the save times.

    Raises:
        InputError: for times out of order, a step above the stable one, too little
            memory, or a scene that cannot be spread over the devices.
        RuntimeError: if the run failed and `throw` is set.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
        >>> body = jt.Body(jt.FullVolume(grid), steel, temperature=350.0)
        >>> scene = jt.Scene((body,), (jt.Convection(10.0, 290.0),))
        >>> solution = jt.simulate(scene, 60.0, save_at=[30.0, 60.0])
        >>> solution.surface_temperature.shape  # times, fragments
        (2, 96)
    """
    require(scene, classes=Scene, argument="simulate(scene=)", give="a Scene")
    with scene.precision:
        scene = on_devices(scene, devices)
        plan = plan_run(
            scene,
            t1=t1,
            save_at=save_at,
            solver=solver,
            reverse_memory=reverse_memory,
            control_error=True,
        )
        for warning in grouped_lines(plan.compiled.receipt.warnings):
            warnings.warn(warning, stacklevel=2)
        if progress is None or scene.is_traced:
            solution = run_plan(plan)
        else:
            solution = _run_shown(plan, progress)
    for warning in grouped_lines(solution.run.warnings):
        warnings.warn(warning, stacklevel=2)
    return finished(solution, throw)


def _run_shown(
    plan: Plan, progress: Callable[[], AbstractContextManager[Progress]]
) -> Solution:
    start = segments.begin_run(plan)
    last = deque([start], maxlen=1)
    with progress() as shown:
        last.extend(segments.shown_segments(plan, start, shown))
    return segments.finish_run(plan, last[0])


def run_plan(plan: Plan, takes_steps: bool = True) -> Solution:
    """Run a plan from its start to its solution.

    Without `takes_steps` the programs of the first pass are compiled, and nothing is
    integrated.
    """
    if not plan.intervals:
        return make_solution(plan, None)
    if plan.scene.is_traced:
        return make_solution(plan, take_fixed_steps(plan, initial_state(plan)))
    passes = Passes()
    # One pass, or under error control passes of shorter and shorter steps.
    while not passes.finished:
        running = passes.running(plan)
        state = initial_state(running)
        blocks = step_blocks(running, takes_steps)
        observations = []
        # One block, or one for each snapshot of bodies and sources that move.
        for block in blocks:
            arguments = LoopArguments(
                stepper=running.stepper,
                program=block.program,
                ledger=state.ledger,
                solver_state=state.solver_state,
                steps=block.table,
            )
            state, rows = in_place(take_steps, state.theta)(arguments, state.theta)
            observations.append(rows)
        rows = saved_rows(observations, [block.saved_rows for block in blocks])
        if plan.control is None or not takes_steps:
            return make_solution(running, rows)
        passes = passes.after(rows, plan.control, PartNumbers.of(plan))
    return make_solution(passes.running(plan), passes.rows, passes.error)


def take_steps(arguments: LoopArguments, theta: State) -> tuple[RunState, Observation]:
    """Take all steps of a table; observe the end of each save interval.

    A run compiles it as one program that overwrites the temperatures `theta`, see
    `in_place`.

    Returns:
        The state at the end, and the observations, one per row.
    """
    take_interval = steps_of(arguments.stepper, arguments.program)

    def save_interval(state: RunState, row: StepTable):
        return take_row(take_interval, arguments.program, state, row)

    return jax.lax.scan(save_interval, arguments.start(theta), arguments.steps)


class FirstLoop(NamedTuple):
    """Arguments and temperatures of `take_steps` at the start of a run."""

    arguments: LoopArguments
    theta: State


def first_loop(plan: Plan, table: StepTable | None = None) -> FirstLoop:
    """Return what `take_steps` is called with at the start of a run.

    `table` has its steps; None for those of a plan with one program.
    """
    state = initial_state(plan)
    arguments = LoopArguments(
        stepper=plan.stepper,
        program=plan.compiled.program,
        ledger=state.ledger,
        solver_state=state.solver_state,
        steps=step_table(plan) if table is None else table,
    )
    return FirstLoop(arguments, state.theta)


def compile_plan(plan: Plan) -> None:
    """Compile all programs of a run, by a run without steps."""
    if plan.intervals and not plan.scene.is_traced:
        run_plan(plan, takes_steps=False)
