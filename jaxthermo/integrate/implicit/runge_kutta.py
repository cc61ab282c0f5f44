"""Diagonally implicit Runge-Kutta steps: one implicit coefficient, any tableau.

    eta_i = eta_n + dt sum_{j<i} a_ij f_j + d dt f_i,    eta_{n+1} = the last eta_i.

For a solved stage f_i = (eta_i - base_i) / (d dt), which does not amplify the residual
of the solve. The ledger adds the same sum of the mechanisms' heat rates; the difference
by rounding and the solver's tolerance is removed by a correction, so that energy closes
whatever the tolerance.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from ...network.network import inverse
from ...scene.compile.memory import Method
from ...scene.compile.program import Program, State
from ..heat_rates import evaluate_rates, load_slopes, pair_conductance
from ..ledger import EntryEnds
from ..solver_statistics import SolverStatistics, zero_statistics
from ..stepper import AbstractStepper, RunState
from .jacobian import ImplicitContext
from .newton_stage import solve_stage


class Tableau(NamedTuple):
    """Coefficients of a stiffly accurate method: its last stage is its result."""

    explicit_first_stage: bool
    """True if the first stage is the start itself."""
    weights: tuple[tuple[float, ...], ...]
    """a_i of each solved stage, the implicit coefficient last."""
    times: tuple[float, ...]
    """Time of each stage's loads, in steps."""


SQRT2 = float(np.sqrt(2.0))

# Loads at the middle of the step: the heat of a ramp is exact.
BACKWARD_EULER = Tableau(False, ((1.0,),), (0.5,))

CRANK_NICOLSON = Tableau(True, ((0.5, 0.5),), (0.0, 1.0))

# Source: Hosea and Shampine, Applied Numerical Mathematics 20 (1996) 21-37.
TR_BDF2 = Tableau(
    True,
    ((1 - SQRT2 / 2, 1 - SQRT2 / 2), (SQRT2 / 4, SQRT2 / 4, 1 - SQRT2 / 2)),
    (0.0, 2 - SQRT2, 1.0),
)

# An explicit first stage takes the start's rates for a part of the step. A body far
# hotter than its surroundings would lose more heat by that than it has: nodes would
# fall below 0 K, from where no implicit part brings them back; a far colder body would
# exceed every temperature of the scene. In a nonlinear scene such a step is taken by
# backward Euler instead, in the same number of stages, so that nothing is recompiled.
_FALLBACKS = {
    CRANK_NICOLSON: Tableau(True, ((0.0, 1.0),), (0.0, 0.5)),
    TR_BDF2: Tableau(True, ((0.0, 0.5), (0.0, 0.5, 0.5)), (0.0, 0.25, 0.75)),
}

_MIN_TEMPERATURE_RATIO = 0.5
"""Smallest ratio of a node's absolute temperature after the explicit part to that
before: with less, the next stage of TR-BDF2, which goes 1.2 times as far, might start
below 0 K."""

_MAX_TEMPERATURE_RATIO = 2.0
"""Largest ratio of a node's temperature to the upper bound of its body, if known."""


class StepResult(NamedTuple):
    """A step, before it is accepted."""

    states: State
    heat: Float[Array, " c"]
    """Heat of each ledger entry [J]."""
    slopes: tuple[State, ...]
    """f of every stage [K/s]."""
    statistics: SolverStatistics


def runge_kutta_step(
    program: Program,
    context: ImplicitContext,
    tableau: Tableau,
    states: State,
    start: Float[Array, ""],
    dt: Float[Array, ""],
    fallback: Tableau | None = None,
) -> StepResult:
    """Take one step of a method, or of `fallback` if its first stage goes too far."""
    slopes: list[State] = []
    entries: list[Float[Array, " c"]] = []
    statistics = zero_statistics(states[0].dtype)
    weights = tableau.weights
    times: Any = tableau.times
    if tableau.explicit_first_stage:
        first_slope, first_entries = evaluate_rates(
            program, states, start + dt * times[0]
        )
        slopes.append(first_slope)
        entries.append(first_entries)
        if fallback is not None:
            ahead = _add_slopes(states, dt=dt, weights=weights[0][:1], slopes=slopes)
            accepted = _within_bounds(
                program, context=context, states=states, ahead=ahead
            )
            # Coefficients are selected, not methods: the step is compiled once.
            weights, times = jax.tree.map(
                lambda a, b: jnp.where(accepted, jnp.asarray(a, dt.dtype), b),
                (weights, times),
                (fallback.weights, fallback.times),
            )
        times = times[1:]
    stage = states
    for row, fraction in zip(weights, times, strict=True):
        base = _add_slopes(states, dt=dt, weights=row[:-1], slopes=slopes)
        g = row[-1] * dt
        time = start + dt * fraction
        solved = solve_stage(
            program, context=context, base=base, g=g, time=time, guess=stage
        )
        stage = solved.states
        statistics = statistics.plus(solved.statistics)
        slopes.append(jax.tree.map(lambda e, b, g=g: (e - b) / g, stage, base))
        entries.append(solved.entries)
    last = weights[-1]
    heat = dt * sum(w * e for w, e in zip(last, entries, strict=True))
    end = start + dt * times[-1]
    end_states, heat = _correct_energy(
        program,
        start_states=states,
        end_states=stage,
        heat=heat,
        g=last[-1] * dt,
        time=end,
    )
    return StepResult(
        states=end_states, heat=heat, slopes=tuple(slopes), statistics=statistics
    )


def _within_bounds(
    program: Program, context: ImplicitContext, states: State, ahead: State
) -> Bool[Array, ""]:
    """Return False if a node falls far below its temperature, or above any bound."""
    accepted = []
    bodies = zip(program.bodies, context.ceilings, states, ahead, strict=True)
    for body, ceiling, now, then in bodies:
        is_bounded = jnp.isfinite(ceiling)
        temperature = body.network.temperature
        reference = body.node_reference
        start = reference + temperature(now)
        end = reference + temperature(then)
        bound = reference + temperature(jnp.where(is_bounded, ceiling, 0))
        bound = _MAX_TEMPERATURE_RATIO * jnp.maximum(bound, start)
        too_low = end < _MIN_TEMPERATURE_RATIO * start
        accepted.append(~(too_low | (is_bounded & (end > bound))).any())
    return jnp.stack(accepted).all()


def _add_slopes(states: State, dt, weights, slopes) -> State:
    for weight, slope in zip(weights, slopes, strict=True):
        states = jax.tree.map(lambda s, f, w=weight: s + w * dt * f, states, slope)
    return states


class ImplicitStepper(AbstractStepper):
    """Diagonally implicit Runge-Kutta method with given steps."""

    context: ImplicitContext
    tableau: Tableau = eqx.field(static=True)

    @property
    @override
    def method(self) -> Method:
        return self.context.method

    @override
    def begin(self, state: RunState) -> RunState:
        statistics = zero_statistics(state.theta[0].dtype)
        return RunState(state.theta, state.ledger, statistics)

    @override
    def step(self, program: Program, state: RunState, start, dt) -> RunState:
        fallback = None if self.context.linear else _FALLBACKS.get(self.tableau)
        result = runge_kutta_step(
            program,
            context=self.context,
            tableau=self.tableau,
            states=state.theta,
            start=start,
            dt=dt,
            fallback=fallback,
        )
        ledger = state.ledger.add(result.heat)
        statistics = state.solver_state.plus(result.statistics)
        return RunState(result.states, ledger, statistics)


def _correct_energy(
    program: Program,
    start_states: State,
    end_states: State,
    heat: Float[Array, " c"],
    g: Float[Array, ""],
    time: Float[Array, ""],
) -> tuple[State, Float[Array, " c"]]:
    """Return states that hold exactly the heat of the ledger, and that heat [J].

    Every body b is made lambda_b warmer, and every mechanism brings what it then would:
    the balance of the step with one temperature per body,

        (C_b + g sum_e s_e) lambda_b - g sum_{e to c} s_e lambda_c = missing_b,

    s_e the slopes of loads and contacts [W/K], g the step of the last stage. The
    tolerance of a solve is in kelvin, and no lambda is larger: the maximum principle
    holds as far as the solve satisfies it.
    """
    # States and heat are computed separately: they differ by what the linear solve
    # leaves, and by rounding of the rates, which a long step multiplies.
    # Slopes -d(entry)/d(state) of loads and of contacts [W/K].
    _, loads = load_slopes(program, end_states, time)
    contacts = jnp.zeros_like(loads)
    for contact in program.contacts:
        conductance = contact.sums(pair_conductance(contact, time))
        contacts = contacts.at[np.array(contact.entries)].set(conductance)
    # They only distribute a remainder of the size of rounding: what their derivatives
    # would add is as small.
    loads, contacts = jax.lax.stop_gradient((loads, contacts))
    difference = jax.tree.map(jnp.subtract, end_states, start_states)
    # Nodes that have not changed at all stay as they are, bit by bit.
    changed = tuple((change != 0).astype(heat.dtype) for change in difference)

    ends = EntryEnds.of(program.entries)

    def missing(heat: Float[Array, " c"], states: State) -> Float[Array, " b"]:
        gained = ends.into_bodies(heat, program.body_count)
        change = jax.tree.map(jnp.subtract, states, start_states)
        return gained - program.stored_heat(change)

    holding = program.stored_heat(changed)
    # Where nothing changed nothing will; only a division by zero must be avoided.
    holding = jnp.where(holding > 0, holding, program.total_capacity())
    # Sums of the slopes of each body's loads, and of each pair's contacts [W/K].
    loss = jnp.zeros_like(holding).at[ends.heated].add(loads[ends.load])
    right = missing(heat, end_states)
    if len(ends.pair):
        links = jnp.zeros((len(loss), len(loss)), loads.dtype)
        links = links.at[ends.first, ends.second].add(contacts[ends.pair])
        warmer = _solve_dominant(holding + g * loss, g * (links + links.T), right)
    else:
        warmer = right / (holding + g * loss)
    heat = heat - g * _response(ends, loads, contacts, warmer)
    states = tuple(
        new + body.at_nodes(warmer) * m
        for body, new, m in zip(program.bodies, end_states, changed, strict=True)
    )
    # What remains is rounding; loads that depend on temperature take it.
    remainder = missing(heat, states) * inverse(loss)
    return states, heat - _response(ends, loads, 0 * contacts, remainder)


def _response(
    ends: EntryEnds,
    loads: Float[Array, " c"],
    contacts: Float[Array, " c"],
    warmer: Float[Array, " b"],
) -> Float[Array, " c"]:
    """Decrease of the heat rate of each entry for warmer bodies [W]."""
    response = jnp.zeros(loads.shape, warmer.dtype)
    response = response.at[ends.load].set(loads[ends.load] * warmer[ends.heated])
    rise = warmer[ends.second] - warmer[ends.first]
    return response.at[ends.pair].set(contacts[ends.pair] * rise)


def _solve_dominant(
    excess: Float[Array, " b"], links: Float[Array, "b b"], right: Float[Array, " b"]
) -> Float[Array, " b"]:
    """Solve (excess_i + sum_j links_ij) x_i - sum_j links_ij x_j = right_i.

    Gaussian elimination in which each diagonal is stored as what it exceeds the sum of
    its row by, so that strong links lose no digit.

    Source: Grassmann, Taksar, Heyman, Operations Research 33 (1985) 1107-1116.
    """
    # No difference occurs: `excess` is positive, `links` is symmetric, 0 or more, and 0
    # on the diagonal.
    count = len(excess)
    index = jnp.arange(count)

    def eliminate(k, system):
        excess, right, links = system
        later = (index > k).astype(excess.dtype)
        pivot = excess[k] + (links[k] * later).sum()
        factor = later * links[:, k] / pivot
        excess = excess + factor * excess[k]
        right = right + factor * right[k]
        links = links + factor[:, None] * (links[k] * later)[None]
        return excess, right, links * (1 - jnp.eye(count, dtype=excess.dtype))

    excess, right, links = jax.lax.fori_loop(
        0, count, eliminate, (excess, right, links)
    )

    def substitute(n, x):
        k = count - 1 - n
        later = (index > k).astype(excess.dtype)
        pivot = excess[k] + (links[k] * later).sum()
        return x.at[k].set((right[k] + (links[k] * later * x).sum()) / pivot)

    return jax.lax.fori_loop(0, count, substitute, jnp.zeros_like(right))
