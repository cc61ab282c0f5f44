"""`simulate`: from a scene to its solution, as one compiled program."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import device_array, is_traced, precision
from ...errors import require
from ...network.network import Address, precise_sum
from ...parallel.lattice import own_copies, replicated
from ...scene.compile.on_devices import on_devices
from ...scene.compile.program import Program, State
from ...scene.scene import Scene
from ..implicit.newton_stage import SolverStatistics
from ..ledger import Energy, Ledger, energies, in_order
from ..solvers import AbstractSolver
from ..stepper import AbstractStepper, RunState, advance, run_in_place
from .plan import (
    Plan,
    StepTable,
    initial_state,
    observation_time,
    plan_once,
    save_intervals,
    step_table,
)
from .solution import (
    RESULTS,
    Observation,
    RunSummary,
    Solution,
    finished,
    observe,
    run_result,
)
from .time_error import Passes, TimeError, of_pass


def simulate(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None = None,
    *,
    solver: AbstractSolver | None = None,
    throw: bool = True,
    reverse_memory: int | None = None,
    devices: int = 1,
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
    with precision(scene.dtype):
        scene = on_devices(scene, devices)
        plan = plan_once(
            scene, t1=t1, save_at=save_at, solver=solver, reverse_memory=reverse_memory
        )
        for warning in plan.compiled.receipt.warnings:
            warnings.warn(warning, stacklevel=2)
        solution = run_plan(plan)
    return finished(solution, throw)


def run_plan(plan: Plan) -> Solution:
    """Run a plan from its start to its solution."""
    if not plan.intervals:
        return make_solution(plan, None)
    if plan.control is not None:
        passes = Passes()
        while not passes.finished:
            now = of_pass(plan, passes.number)
            rows = integrate(now, initial_state(now))
            passes = passes.after(rows, plan.control)
        now = of_pass(plan, passes.number)
        return make_solution(now, passes.rows, passes.error)
    rows = integrate(plan, initial_state(plan), is_traced(plan.scene))
    return make_solution(plan, rows)


def take_steps(
    stepper: AbstractStepper, program: Program, state: RunState, table: StepTable
) -> tuple[RunState, Observation]:
    """Take all steps of a table; observe the end of each save interval.

    Returns:
        The state at the end, and the observations, one per row.
    """

    def interval(carry, row: StepTable):
        state, time = carry
        # Unused columns of the table leave the time of the last step as it is.
        time = jnp.where(row.steps > 0, row.observation_time, time)
        state = advance(
            stepper,
            program=program,
            state=state,
            start=row.start,
            dt=row.dt,
            steps=row.steps,
        )
        return (state, time), None

    def save_interval(state, row: StepTable):
        begin = jnp.zeros((), row.start.dtype)
        (state, time), _ = jax.lax.scan(interval, (state, begin), row)
        return state, observe(program, state, time)

    return jax.lax.scan(save_interval, state, table)


def take_steps_in_place(
    stepper: AbstractStepper, program: Program, state: RunState, table: StepTable
) -> tuple[RunState, Observation]:
    """`take_steps` in one program, which overwrites the temperatures of the state."""
    constants = RunConstants(
        stepper=stepper,
        program=program,
        ledger=state.ledger,
        solver_state=state.solver_state,
        table=table,
    )
    return run_in_place(take_all_steps, constants, state.theta)


class RunConstants(NamedTuple):
    """Arguments of a run that are not overwritten: all but the temperatures."""

    stepper: AbstractStepper
    program: Program
    ledger: Ledger
    solver_state: Any
    table: StepTable


def take_all_steps(
    constants: RunConstants, theta: State
) -> tuple[RunState, Observation]:
    """Take all steps of a table, as `take_steps`; compiled by `take_steps_in_place`."""
    # Only the temperatures are donated: they are large, and the other arrays shared.
    return take_steps(
        constants.stepper,
        program=constants.program,
        state=RunState(theta, constants.ledger, constants.solver_state),
        table=constants.table,
    )


def compile_plan(plan: Plan) -> None:
    """Compile all programs of a run, by a run without steps."""
    if not plan.intervals or is_traced(plan.scene):
        return
    first = of_pass(plan, 0)
    rows = integrate(first, initial_state(first), takes_steps=False)
    make_solution(first, rows)


def integrate(
    plan: Plan, state: RunState, traced: bool = False, takes_steps: bool = True
) -> Observation:
    """Take every step of a plan and return the observations at the save times.

    The temperatures of the state are overwritten, except where values are traced.
    Without `takes_steps` the programs are compiled and nothing is integrated.
    """
    index = [plan.compiled.number_at(i.start) for i in plan.intervals]
    numbers = sorted(set(index))
    pairs = list(zip(plan.intervals, index, strict=True))
    groups = [save_intervals(tuple(i for i, m in pairs if m == n)) for n in numbers]
    # One shape for all programs, which differ in numbers only: compiled once.
    rows = max((len(program_groups) for program_groups in groups), default=0)
    columns = max(
        (len(group) for program_groups in groups for group in program_groups), default=0
    )
    observations_by_program = []
    saved = []
    for number, program_groups in zip(numbers, groups, strict=True):
        program = plan.compiled.programs[number]
        if traced:
            state, observations = _take_fixed_steps(
                plan, program=program, state=state, groups=program_groups
            )
        else:
            table = step_table(
                plan, groups=program_groups, min_rows=rows, min_columns=columns
            )
            if not takes_steps:
                table = table._replace(steps=jnp.zeros_like(table.steps))
            state, observations = take_steps_in_place(
                plan.stepper, program=program, state=state, table=table
            )
        observations_by_program.append(observations)
        # The last interval before a motion snapshot may not be saved.
        saved.append(np.flatnonzero([g[-1].saved for g in program_groups]))
    if len(observations_by_program) == 1 and len(saved[0]) == len(
        observations_by_program[0].is_finite
    ):
        return observations_by_program[0]
    return _saved_rows(tuple(observations_by_program), tuple(map(device_array, saved)))


def _take_fixed_steps(
    plan: Plan, program: Program, state: RunState, groups
) -> tuple[RunState, Observation]:
    # `take_steps` with lengths that are Python numbers, for reverse mode.
    rows = []
    dtype = plan.dtype
    for group in groups:
        for i in group:
            state = advance(
                plan.stepper,
                program=program,
                state=state,
                start=jnp.asarray(i.start, dtype),
                dt=jnp.asarray(i.dt, dtype),
                steps=i.steps,
                steps_before=0,
                checkpoints=plan.checkpoints,
            )
        time = jnp.asarray(observation_time(plan, group[-1]), dtype)
        rows.append(observe(program, state, time))
    return state, jax.tree.map(lambda *rows: jnp.stack(rows), *rows)


@eqx.filter_jit
def _saved_rows(
    observations_by_program: tuple[Observation, ...],
    saved: tuple[Int[Array, " _"], ...],
) -> Observation:
    picked = [
        jax.tree.map(lambda a, rows=rows: a[rows], observations)
        for observations, rows in zip(observations_by_program, saved, strict=True)
    ]
    return _joined(*picked)


def _joined(*rows: Observation) -> Observation:
    return jax.tree.map(lambda *columns: jnp.concatenate(columns), *rows)


def make_solution(
    plan: Plan,
    observations: Observation | None,
    error: TimeError | None = None,
) -> Solution:
    """Assemble the solution of a finished run; None for a run of 0 s.

    `error` is the estimate of its error in time, if there is one.
    """
    program = plan.compiled.program
    state = initial_state(plan)
    uneven = tuple(
        tuple(map(device_array, b.structure.node_address()))
        if callable(b.temperature)
        else None
        for b in plan.scene.bodies
    )
    from_start = plan.save_times[0] == 0.0
    # Rows that enter the solution unchanged do not pass through the program, which
    # would copy them; on several devices it also gathers them.
    observed = None if from_start or program.mesh is not None else observations
    rows_to_balance = observations
    if observed is not None:
        rows_to_balance = observed._replace(
            surface_temperature=None, fragment_outputs={}
        )
    balance = own_copies(
        _balance(
            program,
            state=state,
            saved=rows_to_balance,
            uneven=uneven,
            from_start=from_start,
        )
    )
    energy = balance.energy
    saved: Observation = balance.rows if observed is None else observed
    receipt = plan.compiled.receipt
    if error is not None:
        receipt = replace(receipt, notes=(*receipt.notes, error.text()))
    return Solution(
        times=device_array(np.asarray(plan.save_times, energy.stored_J.dtype)),
        surface_temperature=saved.surface_temperature,
        mean_temperature=saved.mean_temperature,
        energy=in_order(energy, program.entries),
        result=balance.result,
        run=RunSummary(
            steps=plan.steps,
            dt=max((i.dt for i in plan.intervals), default=None),
            stable_step=plan.stable_step,
            solver=type(plan.solver).__name__,
            statistics=balance.statistics,
            time_error=None if error is None else error.kelvin,
            time_error_limit=None if error is None else error.limit,
        ),
        surfaces=plan.compiled.surfaces,
        terms=plan.scene.terms,
        radiation=plan.compiled.radiation,
        receipt=receipt,
        probes=plan.scene.probes,
        probe_temperature=saved.probe_temperature,
        **saved.fragment_outputs,
    )


class _Balance(NamedTuple):
    rows: Observation
    """Saved observations, with that of the start if it is saved."""
    energy: Energy
    statistics: SolverStatistics | None
    """Totals at the end of the run; None for explicit solvers."""
    result: RESULTS


@eqx.filter_jit
def _balance(
    program: Program,
    state: RunState,
    saved: Observation | None,
    uneven: tuple[Address | None, ...],
    from_start: bool,
) -> _Balance:
    """Complete the saved rows of a run, and draw up their energies.

    `uneven` are the nodes of the bodies whose initial temperature is not uniform.
    """
    rows = saved
    if from_start or rows is None:
        # The row of the start; cut to length 0, it has the shapes.
        initial = observe(program, state, None)
        start = jax.tree.map(lambda a: a[None][: int(from_start)], initial)
        rows = start if rows is None else _joined(start, rows)
    # The ledger starts at 0, stored heat at that of the initial state.
    stored = rows.stored_heat - program.stored_heat(state.theta)[None]
    energy = energies(
        program.entries,
        stored=stored,
        heat=rows.ledger.heat,
        moved=rows.ledger.moved,
        equalization=_equalization_heat(program, state.theta, uneven),
    )
    statistics = None
    if saved is not None:
        statistics = jax.tree.map(lambda a: a[-1], saved.statistics)
    result = run_result(rows.is_finite.all(), rows.is_physical.all(), statistics)
    balance = _Balance(rows=rows, energy=energy, statistics=statistics, result=result)
    return replicated(program.mesh, balance)


def _equalization_heat(
    program: Program, states: State, uneven: tuple[Address | None, ...]
) -> Float[Array, " b"]:
    # The heat that conduction moves to make each body uniform [J]. It scales the
    # ledger's error where a body starts unevenly and no mechanism acts.
    heat = []
    for body, state, address in zip(program.bodies, states, uneven, strict=True):
        if address is None:
            heat.append(jnp.zeros((), state.dtype))
            continue
        mean = body.network.stored(state) / body.network.total_capacity()
        excess = jnp.abs(state[address] - mean) * body.network.capacity_at(address)
        heat.append(precise_sum(excess) / 2)
    return jnp.stack(heat)
