"""Diagonally implicit Runge-Kutta steps: one implicit coefficient, any tableau.

    eta_i = eta_n + dt sum_{j<i} a_ij f_j + d dt f_i,    eta_{n+1} = the last eta_i.

Of a stage that was solved f_i = (eta_i - base_i) / (d dt), which does not amplify what
the solve left over. The heat that the ledger enters is the same sum of the mechanisms'
rates; what rounding and the solver's tolerance leave between the two, `closing` evens
out, so that energy closes whatever the tolerance.

A method whose first stage is explicit takes the start's rates for a part of the step. A
body far hotter than what is around would lose more heat by that than it holds: nodes
would fall below 0 K, from where no implicit part brings them back; a far colder one
would get hotter than anything there is. Where laws are not linear, such a step is
backward Euler's instead, in the same stages.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...scene.compile.program import Program, State
from ..run.schedule import END_FRACTION, END_ROUNDINGS
from ..stepper import AbstractStepper, RunState
from .context import ImplicitContext
from .energy_correction import correct_energy
from .newton_stage import SolverStatistics, Stage, solve_stage, zero_statistics
from .residual import rates


class Tableau(NamedTuple):
    """Of a stiffly accurate method: its last stage is its result."""

    explicit: bool
    """Whether the first stage is the start itself."""
    weights: tuple[tuple[float, ...], ...]
    """Row by row, of the stages that are solved, the implicit one last."""
    times: tuple[float, ...]
    """At which each stage takes its loads, in steps."""


SQRT2 = float(np.sqrt(2.0))

BACKWARD_EULER = Tableau(False, ((1.0,),), (0.5,))
"""Loads at the middle of the step: the heat of a ramp is exact."""

CRANK_NICOLSON = Tableau(True, ((0.5, 0.5),), (0.0, 1.0))

TR_BDF2 = Tableau(
    True,
    ((1 - SQRT2 / 2, 1 - SQRT2 / 2), (SQRT2 / 4, SQRT2 / 4, 1 - SQRT2 / 2)),
    (0.0, 2 - SQRT2, 1.0),
)
"""Source: Hosea and Shampine, Applied Numerical Mathematics 20 (1996) 21-37."""

FALLBACKS = {
    CRANK_NICOLSON: Tableau(True, ((0.0, 1.0),), (0.0, 0.5)),
    TR_BDF2: Tableau(True, ((0.0, 0.5), (0.0, 0.5, 0.5)), (0.0, 0.25, 0.75)),
}
"""Steps of backward Euler, of the same stages as another method."""

LEAST_LEFT = 0.5
"""Of a node's absolute temperature, after the explicit part of a step: with less even
the next stage of TR-BDF2, which goes 1.2 times as far, might start from below 0 K."""

MOST_REACHED = 2.0
"""Of the hottest that a body can get, if that is known."""


class StepResult(NamedTuple):
    """A step, before it is accepted."""

    states: State
    heat: Float[Array, " c"]
    """That each entry of the ledger brings [J]."""
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
    retreat: Tableau | None = None,
) -> StepResult:
    """One step.

    Args:
        program: of the scene.
        context: for it.
        tableau: of the method.
        states: at the start.
        start: [s].
        dt: the step [s].
        retreat: method where an explicit first stage goes too far.
    """
    slopes: list[State] = []
    entries: list[Float[Array, " c"]] = []
    statistics, weights = zero_statistics(states[0].dtype), tableau.weights
    times: Any = tableau.times
    if tableau.explicit:
        first = rates(program, states, _within(start, dt, times[0]))
        slopes.append(first.change)
        entries.append(first.entries)
        if retreat is not None:
            ahead = _sum(states, dt, weights[0][:1], slopes)
            kept = _in_reach(program, context, states, ahead)
            # The same numbers in the same places, or the step would be compiled twice.
            weights, times = jax.tree.map(
                lambda own, other: jnp.where(kept, jnp.asarray(own, dt.dtype), other),
                (weights, times),
                (retreat.weights, retreat.times),
            )
        times = times[1:]
    guess = states
    for row, share in zip(weights, times, strict=True):
        base = _sum(states, dt, row[:-1], slopes)
        g = row[-1] * dt
        solved: Stage = solve_stage(
            program, context, base, g, _within(start, dt, share), guess
        )
        guess, statistics = solved.states, statistics.plus(solved.statistics)
        slopes.append(jax.tree.map(lambda e, b, g=g: (e - b) / g, guess, base))
        entries.append(solved.entries)
    last = weights[-1]
    heat = dt * sum(w * e for w, e in zip(last, entries, strict=True))
    end = _within(start, dt, times[-1])
    after, heat = correct_energy(program, states, guess, heat, last[-1] * dt, end)
    return StepResult(after, heat, tuple(slopes), statistics)


def _in_reach(
    program: Program, context: ImplicitContext, states: State, ahead: State
) -> Bool[Array, ""]:
    """Whether no node is taken far below its temperature, or above any there can be."""
    found = []
    bodies = zip(program.bodies, context.ceilings, states, ahead, strict=True)
    for body, ceiling, now, then in bodies:
        known = jnp.isfinite(ceiling)
        above = (
            body.network.temperature(x)
            for x in (now, then, jnp.where(known, ceiling, 0))
        )
        before, after, most = (body.reference + each for each in above)
        most = MOST_REACHED * jnp.maximum(most, before)
        low = after < LEAST_LEFT * before
        found.append(~(low | (known & (after > most))).any())
    return jnp.stack(found).all()


def _sum(states: State, dt, weights, slopes) -> State:
    for weight, slope in zip(weights, slopes, strict=True):
        states = jax.tree.map(lambda s, f, w=weight: s + w * dt * f, states, slope)
    return states


def _within(start, dt, share) -> Float[Array, ""]:
    """A time in the step; its end is just before whatever is switched there."""
    end = start + dt
    rounding = END_ROUNDINGS * jnp.finfo(end.dtype).eps * jnp.abs(end)
    last = end - jnp.maximum(rounding, END_FRACTION * dt)
    return jnp.where(share < 1, start + dt * share, last)


class ImplicitStepper(AbstractStepper):
    """Steps of a given length."""

    context: ImplicitContext
    tableau: Tableau = eqx.field(static=True)

    def begin(self, state: RunState) -> RunState:
        """With an account of the statistics."""
        return RunState(
            state.theta, state.ledger, zero_statistics(state.theta[0].dtype)
        )

    def step(
        self,
        program: Program,
        state: RunState,
        start: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> RunState:
        """One step of the method."""
        retreat = None if self.context.linear else FALLBACKS.get(self.tableau)
        taken = runge_kutta_step(
            program, self.context, self.tableau, state.theta, start, dt, retreat
        )
        ledger = state.ledger.add(taken.heat)
        return RunState(taken.states, ledger, state.solver_state.plus(taken.statistics))
