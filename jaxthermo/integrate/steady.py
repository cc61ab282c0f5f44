"""`steady`: the temperatures at which a scene no longer changes.

    sum_j G_ij (T_j - T_i) + sum_terms q_i(T_i) = 0  [W] at every node i,

by Newton's method; every iteration is a linear solve preconditioned by multigrid.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..alike_lines import grouped_lines
from ..arrays import stop_gradient
from ..errors import InputError, require
from ..network.network import inverse
from ..scene.compile.compile import compile_scene
from ..scene.compile.groups import BodyGroup, body_groups
from ..scene.compile.program import LedgerEntries, Program, State
from ..scene.motion import Motion
from ..scene.scene import Scene
from .energy import Energy, HeatRates
from .heat_rates import evaluate_rates
from .implicit.conjugate_gradient import ConjugateGradient, CorrectionNorm, max_abs
from .implicit.jacobian import (
    ImplicitContext,
    Linearization,
    arranged_for_solves,
    implicit_context,
    linearize,
)
from .implicit.newton_stage import (
    after_solve,
    derivative_solver,
    moved,
    shortened,
    solve_linear,
)
from .isolated_components import (
    IsolatedComponents,
    ProjectedPreconditioner,
    find_isolated_components,
)
from .ledger import (
    EnergyTable,
    empty_ledger,
    energies,
    energy_table,
)
from .run.solution import (
    Observation,
    RunSummary,
    SteadySolution,
    finished,
    observe,
    run_result,
)
from .solver_statistics import SolverStatistics, zero_statistics
from .stepper import RunState


STEADY_TOLERANCE = {"float32": 1e-3, "float64": 1e-8}
"""Default distance of a node from its steady temperature [K]."""

_MAX_NEWTON_ITERATIONS = 100
"""Mutual radiation converges by one reflection per iteration."""

_IRREGULAR = 0.1
"""Tolerance of linear solves without symmetry, over that of the temperatures."""

_SETTLING_ITERATIONS = 10
"""Iterations in which a nonlinear scene may change more than in the one before."""


def steady(
    scene: Scene,
    *,
    at: float | None = None,
    tolerance: float | None = None,
    throw: bool = True,
) -> SteadySolution:
    """Find the steady temperatures of a scene, where all heat that enters leaves.

    At every node i, with conductances G [W/K] and the heat rates q of all terms [W],

        sum_j G_ij (T_j - T_i) + sum_terms q_i(T_i) = 0    [W].

    It may be jitted, mapped or differentiated with respect to anything in the scene
    that is a number, by the implicit function theorem. A part that exchanges heat with
    nothing keeps the mean that it starts with.

    Args:
        scene: bodies and terms; Newton's method starts at the bodies' temperatures.
        at: time of the poses and values that stay [s]; needed where something varies
            with time.
        tolerance: largest distance of a node from its steady temperature [K]; None for
            1e-3 K in float32 and 1e-8 K in float64.
        throw: raise if the solve failed; otherwise `SteadySolution.result` says so.

    Returns:
        Surface temperatures [K], and the heat rate of every mechanism [W].

    Raises:
        InputError: where something varies with time and `at` is not given, or where a
            heat source acts on a part that nothing cools: there is no steady state.
        RuntimeError: if the solve did not converge and `throw` is set.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> copper = jt.materials["copper"]
        >>> body = jt.Body(jt.FullVolume(grid), copper, temperature=350.0)
        >>> terms = (jt.HeatFlux(100.0), jt.Convection(10.0, 290.0))
        >>> warm = jt.steady(jt.Scene((body,), terms))
        >>> f"{warm.mean_temperature.item():.3f}"
        '300.000'
    """
    require(scene, classes=Scene, argument="steady(scene=)", give="a Scene")
    if tolerance is not None and not tolerance > 0:
        raise InputError(f"steady(tolerance={tolerance!r}): give a positive one [K]")
    with scene.precision:
        solution = steady_solution(static_scene(scene, at), at or 0.0, tolerance)
    for warning in grouped_lines(solution.receipt.warnings):
        warnings.warn(warning, stacklevel=2)
    return finished(solution, throw)


def static_scene(scene: Scene, at: float | None) -> Scene:
    """Return the scene with its poses and sources as they are at a time [s].

    Raises:
        InputError: where something varies with time and there is none.
    """
    varies = any(callable(value) for term in scene.terms for value in term.values)
    moves = any(term.moves for term in scene.terms) or any(
        isinstance(body.pose, Motion) for body in scene.bodies
    )
    if at is None and (varies or moves):
        raise InputError(
            "steady: the scene varies with time; give the time whose values last, as "
            "in steady(scene, at=0.0)"
        )
    if not moves:
        return scene
    time = 0.0 if at is None else at
    bodies = tuple(replace(b, pose=b.pose.at(time)) for b in scene.bodies)
    return replace(scene, bodies=bodies, terms=tuple(t.at(time) for t in scene.terms))


def steady_solution(scene: Scene, at: float, tolerance: float | None) -> SteadySolution:
    """Find the steady state of a scene in which nothing moves, see `steady`."""
    scene = arranged_for_solves(scene)
    compiled = compile_scene(scene, 1, at, method="implicit", duration=math.inf)
    traced = scene.is_traced
    program = compiled.program
    groups = body_groups(scene, compiled.classes)
    dtype = jnp.dtype(scene.dtype)
    kelvin = STEADY_TOLERANCE[scene.dtype] if tolerance is None else tolerance
    context = implicit_context(
        scene,
        compiled=compiled,
        stable_step=None,
        max_dt=math.inf,
        tolerance=kelvin,
        traced=traced,
    )
    time = jnp.asarray(at, dtype)
    isolated = None
    # Host code, which traced values cannot enter.
    if not traced:
        isolated = find_isolated_components(
            groups, program=program, context=context, states=compiled.state, time=time
        )
    states, statistics = _solve(
        program, context=context, start=compiled.state, time=time, isolated=isolated
    )
    observation, rates = _observe(program, states, time)
    return SteadySolution(
        times=time[None],
        surface_temperature=observation.surface_temperature[None],
        mean_temperature=observation.mean_temperature[None],
        heat_rates=_heat_rates(program.entries, rates, compiled.receipt.body_names),
        isolated_components=0 if isolated is None else isolated.count,
        isolated_bodies=() if isolated is None else isolated.bodies,
        node_temperature=_node_temperatures(groups, program, states),
        result=run_result(
            observation.is_finite, observation.is_physical, statistics, steady=True
        ),
        run=RunSummary(
            steps=0,
            dt=None,
            stable_step=None,
            solver="steady",
            statistics=statistics,
        ),
        surfaces=compiled.surfaces,
        terms=scene.terms,
        radiation=compiled.radiation,
        receipt=compiled.receipt,
        probes=scene.probes,
        probe_temperature=_with_time_axis(observation.probe_temperature),
        **_with_time_axis(observation.fragment_outputs),
    )


def _node_temperatures(
    groups: tuple[BodyGroup, ...], program: Program, states: State
) -> tuple[Float[Array, " _"], ...]:
    """Temperature of every node of each body [K], in the order of the scene."""
    by_number = {}
    for group, body, state in zip(groups, program.bodies, states, strict=True):
        theta = body.network.temperature(state)[group.structure.node_address()]
        kelvin = theta + body.node_reference
        for number, nodes in zip(group.numbers, group.nodes, strict=True):
            by_number[number] = kelvin[nodes]
    return tuple(by_number[number] for number in sorted(by_number))


def _with_time_axis(values: Any) -> Any:
    return jax.tree.map(lambda leaf: leaf[None], values)


@eqx.filter_jit
def _observe(
    program: Program, states: State, time: Float[Array, ""]
) -> tuple[Observation, EnergyTable]:
    ledger = empty_ledger(len(program.entries), states[0].dtype)
    observation = observe(program, RunState(states, ledger), time)
    _, rates = evaluate_rates(program, states, time)
    zero = jnp.zeros((1, program.body_count), rates.dtype)
    table = energy_table(
        program.entries,
        stored=zero,
        heat=rates[None],
        moved=jnp.abs(rates)[None],
        equalization=zero[0],
    )
    return observation, table


def _heat_rates(
    entries: LedgerEntries, table: EnergyTable, body_names: Sequence[str]
) -> HeatRates:
    """Group heat rates, those of one second, by mechanism, by body and by pair."""

    def first(energy: Energy) -> HeatRates:
        mechanisms = {
            name: heat.reshape(()) for name, heat in energy.mechanisms.items()
        }
        contacts = {name: heat.reshape(()) for name, heat in energy.contacts.items()}
        return HeatRates(
            mechanisms=mechanisms,
            contacts=contacts,
            bodies=tuple(map(first, energy.bodies)),
            residual_relative=(-energy.residual_relative).reshape(()),
        )

    return first(energies(entries, table, body_names))


@eqx.filter_jit
def _solve(
    program: Program, context: ImplicitContext, start: State, time, isolated
) -> tuple[State, SolverStatistics]:
    constants = stop_gradient((program, context, start, time))
    states, statistics = _newton(*constants, isolated=isolated)
    if not context.differentiable:
        return states, statistics
    # Implicit function theorem: one more solve, of rates whose value is 0 and whose
    # derivative is that of the balance.
    change, _ = evaluate_rates(program, states, time)
    zero = jax.tree.map(lambda f: f - jax.lax.stop_gradient(f), change)
    program, context, _, time = constants
    at = _linearize(
        program, context=context, states=stop_gradient(states), time=time, isolated=None
    )
    solver = replace(derivative_solver(states), norm=CorrectionNorm())
    heat = jax.tree.map(jnp.multiply, zero, at.capacity)
    solve = solve_linear(at, heat, solver)
    return jax.tree.map(jnp.add, states, solve.change), statistics


def _linearize(program, context, states: State, time, isolated) -> Linearization:
    # 1 / g = 0: a steady state is a backward Euler step of infinite length.
    rate = jnp.zeros((), states[0].dtype)
    if isolated is None:
        return linearize(program, context=context, states=states, rate=rate, time=time)
    at = linearize(
        program,
        context=context,
        states=states,
        rate=rate,
        time=time,
        regularization=isolated.regularization,
    )
    projected = ProjectedPreconditioner(at.preconditioner, isolated)
    return at._replace(preconditioner=projected)


class _Balance(NamedTuple):
    states: State
    heat: State
    """Net heat rate of every node [W]."""


class _Iterate(NamedTuple):
    states: State
    heat: State
    """Net heat rate of every node [W]."""
    change: Float[Array, ""]
    """Largest change of a node by the last iteration [K]."""
    previous_change: Float[Array, ""]
    """Largest change of a node by the second to last iteration [K]."""
    statistics: SolverStatistics


def _balance(
    program: Program, states: State, time, isolated: IsolatedComponents | None
) -> _Balance:
    change, _ = evaluate_rates(program, states, time)
    capacity = (body.network.capacity() for body in program.bodies)
    heat = tuple(f * c for f, c in zip(change, capacity, strict=True))
    if isolated is not None:
        heat = isolated.without_net_heat(heat)
    return _Balance(states, heat)


def _imbalance(heat: State, conductance: State) -> Float[Array, ""]:
    """Largest net heat rate of a node over its conductances [K]."""
    pairs = zip(heat, conductance, strict=True)
    return max_abs(tuple(rate * inverse(g) for rate, g in pairs))


def _temperatures(program: Program, states: State) -> State:
    return tuple(
        body.network.temperature(state)
        for body, state in zip(program.bodies, states, strict=True)
    )


def _largest_change(program: Program, before: State, after: State):
    """Largest change of the temperature of a node [K]."""
    changes = jax.tree.map(
        jnp.subtract, _temperatures(program, after), _temperatures(program, before)
    )
    return max_abs(changes)


def _newton(
    program: Program,
    context: ImplicitContext,
    start: State,
    time,
    isolated: IsolatedComponents | None,
) -> tuple[State, SolverStatistics]:
    dtype = start[0].dtype
    tolerance = context.tolerance
    endless = jnp.asarray(jnp.inf, dtype)

    def iterate(now: _Iterate) -> _Iterate:
        at = _linearize(
            program, context=context, states=now.states, time=time, isolated=isolated
        )
        # There is no time step to measure a residual by. The preconditioner is close
        # to the inverse, so that its corrections are close to the error.
        accuracy = tolerance
        # The corrections of BiCGStab do not shrink evenly: one may be small by chance.
        if not at.operator.is_symmetric:
            accuracy = _IRREGULAR * tolerance
        solver = ConjugateGradient(CorrectionNorm(), accuracy)
        solve = solve_linear(at, now.heat, solver)

        def advanced(fraction: Float[Array, ""] | float) -> _Balance:
            step = jax.tree.map(lambda u: fraction * u, solve.potential)
            states = moved(program, now.states, step, jnp.zeros((), dtype))
            # By the maximum principle; it prevents a first iterate from going far
            # beyond.
            if not context.linear:
                states = jax.tree.map(
                    jnp.clip, states, context.floors, context.ceilings
                )
            if isolated is not None:
                states = isolated.with_initial_means(states)
            return _balance(program, states, time, isolated)

        end = advanced(1.0)
        size = _largest_change(program, now.states, end.states)
        previous_change = now.change
        if context.varies:
            conductance = at.node_conductance()

            step = shortened(
                advanced,
                end,
                norm=lambda balance: _imbalance(balance.heat, conductance),
                before=now,
                tolerance=tolerance,
            )
            end = step.end
            # Steps grow again after short ones.
            previous_change = jnp.where(step.is_shortened, jnp.inf, previous_change)
        return _Iterate(
            states=end.states,
            heat=end.heat,
            change=size,
            previous_change=previous_change,
            statistics=after_solve(now.statistics, solve),
        )

    def unfinished(now: _Iterate) -> Bool[Array, ""]:
        # In a linear scene later iterations only remove rounding.
        count = now.statistics.newton_iterations
        settled = context.linear | (count >= _SETTLING_ITERATIONS)
        stagnates = (now.change >= now.previous_change) & settled
        return (
            (now.change > tolerance)
            & ~stagnates
            & (count < _MAX_NEWTON_ITERATIONS)
            & jnp.isfinite(now.change)
        ) | (count == 0)

    first = _Iterate(
        states=start,
        heat=_balance(program, start, time, isolated).heat,
        change=endless,
        previous_change=endless,
        statistics=zero_statistics(dtype),
    )
    last = jax.lax.while_loop(unfinished, iterate, first)
    # A tolerance below the last digit of the temperatures cannot be reached.
    digit = jnp.finfo(dtype).eps * max_abs(_temperatures(program, last.states))
    failed = ~(jnp.maximum(last.change, digit) <= tolerance)
    return last.states, replace(
        last.statistics,
        linear_failed=last.statistics.linear_failed | (failed & context.linear),
        newton_failed=failed & (not context.linear),
    )
