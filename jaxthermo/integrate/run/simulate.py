"""`simulate`: from a scene to its solution, as one compiled program."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import device_array, is_traced, taken
from ...errors import require
from ...network.network import Address, precise_sum
from ...parallel.lattice import own_copies, replicated
from ...scene.compile.on_devices import on_devices
from ...scene.compile.program import Program, State
from ...scene.scene import Scene
from ..implicit.newton_stage import SolverStatistics
from ..ledger import EnergyTable, energies, energy_table
from ..solvers import AbstractSolver
from ..stepper import LoopArguments, RunState, in_place
from .fixed_steps import take_fixed_steps
from .missed_limits import EnergyResidual, energy_residual, judged_run
from .plan import (
    Plan,
    StepTable,
    initial_state,
    plan_run,
    step_blocks,
    step_table,
)
from .solution import (
    RESULTS,
    Observation,
    RunSummary,
    Solution,
    finished,
    joined,
    observe,
    run_result,
    saved_rows,
)
from .step_loop import steps_of, take_row
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
    with scene.precision():
        scene = on_devices(scene, devices)
        plan = plan_run(
            scene,
            t1=t1,
            save_at=save_at,
            solver=solver,
            reverse_memory=reverse_memory,
            control_error=True,
        )
        for warning in plan.compiled.receipt.warnings:
            warnings.warn(warning, stacklevel=2)
        solution = run_plan(plan)
    for warning in solution.run.warnings:
        warnings.warn(warning, stacklevel=2)
    return finished(solution, throw)


def run_plan(plan: Plan, takes_steps: bool = True) -> Solution:
    """Run a plan from its start to its solution.

    Without `takes_steps` the programs of the first pass are compiled, and nothing is
    integrated.
    """
    if not plan.intervals:
        return make_solution(plan, None)
    if is_traced(plan.scene):
        return make_solution(plan, take_fixed_steps(plan, initial_state(plan)))
    passes = Passes()
    # One pass, or under error control passes of shorter and shorter steps.
    while not passes.finished:
        running = of_pass(plan, passes.number)
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
        passes = passes.after(rows, plan.control)
    return make_solution(of_pass(plan, passes.number), passes.rows, passes.error)


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
    if plan.intervals and not is_traced(plan.scene):
        run_plan(plan, takes_steps=False)


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
    uneven = _uneven_nodes(plan)
    from_start = plan.save_times[0] == 0.0
    # Rows that enter the solution unchanged do not pass through the program, which
    # would copy them; on several devices it also gathers them.
    observed = None if from_start or program.mesh is not None else observations
    rows_to_balance = observations
    if observed is not None:
        rows_to_balance = observed._replace(
            surface_temperature=None, fragment_outputs={}
        )
    balance: _Balance = own_copies(
        _balance(
            program,
            state=state,
            saved=rows_to_balance,
            uneven=uneven,
            from_start=from_start,
        )
    )
    energy = energies(program.entries, balance.energy)
    saved: Observation = balance.rows if observed is None else observed
    receipt = plan.compiled.receipt
    missed: tuple[str, ...] = ()
    if not is_traced(balance.residual):
        error, missed = judged_run(error, balance.residual, receipt.dtype)
        receipt = replace(receipt, warnings=(*receipt.warnings, *missed))
    if error is not None:
        receipt = replace(receipt, notes=(*receipt.notes, error.text()))
    return Solution(
        # In float64: late in a run float32 does not tell close times apart.
        times=np.asarray(plan.save_times, float),
        surface_temperature=saved.surface_temperature,
        mean_temperature=saved.mean_temperature,
        energy=energy,
        result=balance.result,
        run=RunSummary(
            steps=plan.steps,
            dt=max((i.dt for i in plan.intervals), default=None),
            stable_step=plan.stable_step,
            solver=type(plan.solver).__name__,
            statistics=balance.statistics,
            time_error=None if error is None else error.kelvin,
            time_error_limit=None if error is None else error.limit,
            warnings=missed,
        ),
        surfaces=plan.compiled.surfaces,
        terms=plan.scene.terms,
        radiation=plan.compiled.radiation,
        receipt=receipt,
        probes=plan.scene.probes,
        probe_temperature=saved.probe_temperature,
        **saved.fragment_outputs,
    )


def _uneven_nodes(plan: Plan) -> tuple[Address | None, ...]:
    """Nodes of the groups of bodies whose initial temperature is not uniform."""
    if not any(callable(body.temperature) for body in plan.scene.bodies):
        return (None,) * len(plan.compiled.program.bodies)
    return tuple(
        tuple(map(device_array, group.structure.node_address()))
        if any(callable(body.temperature) for body in group.bodies)
        else None
        for group in plan.groups
    )


class _Balance(NamedTuple):
    rows: Observation
    """Saved observations, with that of the start if it is saved."""
    energy: EnergyTable
    statistics: SolverStatistics | None
    """Totals at the end of the run; None for explicit solvers."""
    result: RESULTS
    residual: EnergyResidual


@eqx.filter_jit
def _balance(
    program: Program,
    state: RunState,
    saved: Observation | None,
    uneven: tuple[Address | None, ...],
    from_start: bool,
) -> _Balance:
    """Complete the saved rows of a run, and draw up their energies.

    `uneven` are the nodes of the groups of bodies whose initial temperature is not
    uniform.
    """
    rows = saved
    if from_start or rows is None:
        # The row of the start; cut to length 0, it has the shapes.
        initial = observe(program, state, None)
        start = jax.tree.map(lambda a: a[None][: int(from_start)], initial)
        rows = start if rows is None else joined(start, rows)
    # The ledger starts at 0, stored heat at that of the initial state.
    stored = rows.stored_heat - program.stored_heat(state.theta)[None]
    energy = energy_table(
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
    residual = energy_residual(
        program,
        stored=stored,
        heat=rows.ledger.heat,
        relative=energy.relative,
    )
    balance = _Balance(
        rows=rows,
        energy=energy,
        statistics=statistics,
        result=result,
        residual=residual,
    )
    return replicated(program.mesh, balance)


def _equalization_heat(
    program: Program, states: State, uneven: tuple[Address | None, ...]
) -> Float[Array, " b"]:
    # The heat that conduction moves to make each body uniform [J]. It scales the
    # ledger's error where a body starts unevenly and no mechanism acts.
    heat = []
    for body, state, address in zip(program.bodies, states, uneven, strict=True):
        if address is None:
            heat.append(jnp.zeros(len(body.numbers), state.dtype))
            continue
        mean = body.stored(state) / body.total_capacity()
        if body.members is None:
            excess = jnp.abs(state[address] - mean) * body.network.capacity_at(address)
            heat.append(precise_sum(excess)[None] / 2)
        else:
            excess = jnp.abs(state - taken(mean, body.members.of_node))
            heat.append(body.stored(excess) / 2)
    return program.by_body(heat)
