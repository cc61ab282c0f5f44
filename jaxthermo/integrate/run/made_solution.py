"""Assembles the solution of a finished run, with its energies and its outcome."""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import device_array, is_traced, taken
from ...network.network import Address, precise_sum
from ...parallel.lattice import own_copies, replicated
from ...scene.compile.program import Program, State
from ..ledger import EnergyTable, energies, energy_table
from ..solver_statistics import SolverStatistics
from ..stepper import RunState
from .missed_limits import EnergyResidual, energy_residual, judged_run
from .plan import Plan, initial_state
from .solution import (
    RESULTS,
    Observation,
    RunSummary,
    Solution,
    joined,
    observe,
    run_result,
)
from .time_error import TimeError


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
    saved: Observation = balance.rows if observed is None else observed
    receipt = plan.compiled.receipt
    energy = energies(program.entries, balance.energy, receipt.body_names)
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
        heat_rates=None,
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
    residual = energy_residual(program, energy)
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
