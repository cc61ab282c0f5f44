"""Solutions of `simulate` and `steady`, and how a run can end."""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from ...arrays import (
    device_array,
    is_traced,
)
from ...network.self_adjoint_primitive import computed_once
from ...parallel.lattice import replicated
from ...physics.radiation.irradiation import (
    SceneRadiation,
)
from ...physics.term import AbstractTerm
from ...physics.windows import Window, over
from ...scene.compile.program import Program
from ...scene.named import Probe
from ...scene.receipt_model import Receipt
from ...scene.scene import SolvedSurface
from ..energy import Energy, HeatRates
from ..heat_rates import pair_nodes
from ..ledger import Ledger
from ..solver_statistics import SolverStatistics
from ..stepper import RunState
from .abstract_solution import AbstractComputedSolution
from .run_summary import RunSummary


class RESULTS(eqx.Enumeration):
    """Outcome of a run; the message of each failure says what to do."""

    successful = ""
    nonfinite = (
        "A temperature is no longer finite: a heat flux, coefficient or function of "
        "time gives values that are too large or not finite, or a step was given for "
        "traced values and is above the stable one; check the terms and the step."
    )
    linear_not_converged = (
        "A linear solve stopped short of its tolerance, in the precision at hand or in "
        "its iterations: use dtype float64, a shorter step, or a larger tolerance."
    )
    newton_not_converged = (
        "Newton's method did not converge: give a shorter step, or a smaller error to "
        "a solver that chooses its own."
    )
    steady_not_converged = (
        "The steady state was not found to its tolerance: give steady() a larger "
        "tolerance, in kelvin, or initial temperatures closer to the steady ones; in "
        "a float32 scene, dtype float64 reaches further."
    )
    step_limit = (
        "The error stayed above its limit however short the step: give a larger error, "
        "or dtype float64, and check that every term is finite."
    )
    below_zero = (
        "A temperature fell below 0 K: a negative heat flux takes out more heat than "
        "the body has; check its sign and unit."
    )


# An equinox enumeration does not list its names in public.
_RESULT_NAMES = (
    "successful",
    "nonfinite",
    "linear_not_converged",
    "newton_not_converged",
    "steady_not_converged",
    "step_limit",
    "below_zero",
)


def result_name(result: RESULTS) -> str:
    """Return the name of an outcome, such as "successful"."""
    return next(name for name in _RESULT_NAMES if result == getattr(RESULTS, name))


class Solution(AbstractComputedSolution):
    """Surface temperatures over time [K] and the energy ledger [J], from `simulate`."""

    times: Float[Array | np.ndarray, " t"]
    surface_temperature: Float[Array, "t s"]
    """Temperature of every fragment, bodies one after the other [K]."""
    mean_temperature: Float[Array, "t b"]
    """Capacity-weighted mean of each body [K]."""
    energy: Energy
    result: RESULTS
    run: RunSummary
    surfaces: tuple[SolvedSurface, ...]
    terms: tuple[AbstractTerm, ...]
    radiation: SceneRadiation
    """Irradiation of the surfaces, absorbed or not."""
    receipt: Receipt = eqx.field(static=True)
    probes: tuple[Probe, ...] = eqx.field(static=True, default=())
    probe_temperature: Float[Array, "t p"] | None = None
    """At the scene's probes [K]; None without any. See `probe`."""
    heat_flux: Float[Array, "t s"] | None = None
    """Into every fragment, by all mechanisms and contacts [W/m^2]; 0 at time 0, where
    none has acted. None unless in the scene's `surface_outputs`."""
    heat_transfer_coefficient: Float[Array, "t s"] | None = None
    """h of every fragment, summed over all convection [W/(m^2 K)]; 0 at time 0. None
    unless in the scene's `surface_outputs`."""
    heat_rates: None = eqx.field(static=True, default=None)
    """None: `energy` has the heat of a run."""


class SteadySolution(AbstractComputedSolution):
    """Steady surface temperatures [K], and the heat rates [W], from `steady`."""

    times: Float[Array, " 1"]
    """Time of the poses and loads of the steady state [s]."""
    surface_temperature: Float[Array, "1 s"]
    """Temperature of every fragment, bodies one after the other [K]."""
    mean_temperature: Float[Array, "1 b"]
    """Capacity-weighted mean of each body [K]."""
    heat_rates: HeatRates
    isolated_components: int = eqx.field(static=True)
    """Number of parts without heat exchange, which keep their initial mean."""
    isolated_bodies: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the bodies with such parts."""
    node_temperature: tuple[Float[Array, " _"], ...]
    """Temperature of every node of each body [K]."""
    result: RESULTS
    run: RunSummary
    surfaces: tuple[SolvedSurface, ...]
    terms: tuple[AbstractTerm, ...]
    radiation: SceneRadiation
    """Irradiation of the surfaces, absorbed or not."""
    receipt: Receipt = eqx.field(static=True)
    probes: tuple[Probe, ...] = eqx.field(static=True, default=())
    probe_temperature: Float[Array, "1 p"] | None = None
    """At the scene's probes [K]; None without any. See `probe`."""
    heat_flux: Float[Array, "1 s"] | None = None
    """Into every fragment, by all mechanisms and contacts [W/m^2]; 0 at time 0, where
    none has acted. None unless in the scene's `surface_outputs`."""
    heat_transfer_coefficient: Float[Array, "1 s"] | None = None
    """h of every fragment, summed over all convection [W/(m^2 K)]; 0 at time 0. None
    unless in the scene's `surface_outputs`."""
    energy: None = eqx.field(static=True, default=None)
    """None: bodies in a steady state store no heat."""

    @override
    def load_time(self, index: int) -> Float[Array, ""]:
        return jnp.asarray(self.times[index])


def run_result(
    is_finite: Bool[Array, ""],
    is_physical: Bool[Array, ""],
    statistics: SolverStatistics | None,
    steady: bool = False,
) -> RESULTS:
    """Return the outcome of a run or steady state: its worst failure, if any."""
    outcome = RESULTS.where(is_physical, RESULTS.successful, RESULTS.below_zero)
    # Later ones replace earlier ones, so the order is from mild to severe.
    if statistics is not None:
        linear = RESULTS.linear_not_converged
        newton = RESULTS.newton_not_converged
        # A steady state has no step to shorten: the remedies of a run do not fit.
        if steady:
            linear = RESULTS.steady_not_converged
            newton = RESULTS.steady_not_converged
        for failed, failure in (
            (statistics.linear_failed, linear),
            (statistics.newton_failed, newton),
            (statistics.step_limit_reached, RESULTS.step_limit),
        ):
            outcome = RESULTS.where(failed, failure, outcome)
    return RESULTS.where(is_finite, outcome, RESULTS.nonfinite)


_SolutionT = TypeVar("_SolutionT", Solution, SteadySolution)


def finished(solution: _SolutionT, throw: bool) -> _SolutionT:
    """Return a solution with float64 as numpy arrays; raise its failure if `throw`.

    The failure of a traced run is raised when its program runs.
    """
    is_known = not is_traced(solution.result)
    has_failed = solution.result != RESULTS.successful
    if throw and not is_known:
        traced, known = eqx.partition(solution, is_traced)
        solution = eqx.combine(solution.result.error_if(traced, has_failed), known)
    elif throw and has_failed:
        raise RuntimeError(RESULTS[solution.result])
    # Where JAX is not set to 64 bits, every later use of a float64 array warns and
    # rounds to float32.
    is_known = is_known and solution.receipt.dtype == "float64"
    if not is_known or jnp.result_type(float) == jnp.float64 or is_traced(solution):
        return solution

    def on_host(leaf):
        is_double = isinstance(leaf, jax.Array) and leaf.dtype == jnp.float64
        return np.asarray(leaf) if is_double else leaf

    return jax.tree.map(on_host, solution)


class Observation(NamedTuple):
    """The part of a state that a solution stores."""

    surface_temperature: Float[Array, " s"]
    """Temperature of each fragment, bodies one after the other [K]."""
    mean_temperature: Float[Array, " b"]
    """Capacity-weighted mean of each body [K]."""
    stored_heat: Float[Array, " b"]
    """Heat of each body above its reference temperature [J]."""
    is_finite: Bool[Array, ""]
    is_physical: Bool[Array, ""]
    """True if no surface temperature is below 0 K by more than rounding."""
    ledger: Ledger
    statistics: SolverStatistics | None
    """Totals of an implicit solver; None for explicit ones."""
    probe_temperature: Float[Array, " p"] | None
    """At the scene's probes [K]; None without any."""
    fragment_outputs: dict[str, Float[Array, " s"]]
    """Values of the scene's `surface_outputs` at each fragment."""


@eqx.filter_jit
def observe(
    program: Program,
    state: RunState,
    time: Float[Array, ""] | None,
    window: Window | None = None,
) -> Observation:
    """Observe a state.

    `time` is that of the loads that act on the surface [s], within the last step, so
    that a load that is switched now still counts as it was; None at the start, where
    none has acted yet. It counts from the start of `window`; None for that of the run.
    """
    if window is not None:
        program = over(program, window)
    # Excess of each group's fragments over their nodes by contacts [K], and heat [W].
    by_contacts: list = [None] * len(program.bodies)
    contact_heat: list = [None] * len(program.bodies)
    for contact in program.contacts:
        if time is None:
            break
        paired = contact.heat(time, pair_nodes(program, contact, state.theta))
        for side, body in enumerate(contact.bodies):
            fragments = program.bodies[body].node.shape[0]
            excess = contact.fragment_excess(paired.excess, side, fragments)
            _add_to_body(by_contacts, body, excess)
            if program.surface_heat is not None:
                heat = contact.fragment_heat(paired.rate, side, fragments)
                _add_to_body(contact_heat, body, heat)
    above = program.surface_temperatures(state.theta, time, by_contacts)
    surface = []
    mean = []
    for body, theta, excess in zip(program.bodies, state.theta, above, strict=True):
        # The reference is added last: differences keep their digits in float32.
        surface.append(body.fragment_reference + excess)
        heat = body.stored(body.network.temperature(theta)) / body.total_capacity()
        mean.append(body.reference + heat)
    # Stored, and its minimum is that of what was stored.
    temperature = computed_once(program.in_scene(surface))
    heat = program.stored_heat(state.theta)
    # The adaptive stepper stores its statistics together with the controller's memory.
    solver_state = state.solver_state
    if not isinstance(solver_state, SolverStatistics | None):
        solver_state = solver_state.statistics
    observation = Observation(
        surface_temperature=temperature,
        mean_temperature=program.by_body(mean),
        stored_heat=heat,
        is_finite=jnp.isfinite(heat).all(),
        # Rounding and the solver's tolerance may lead below 0 K by this much.
        is_physical=temperature.min() > -1e-3,
        ledger=state.ledger,
        statistics=solver_state,
        probe_temperature=program.probe_temperatures(
            state.theta, above, is_limited=time is not None
        ),
        fragment_outputs=program.fragment_outputs(state.theta, time, contact_heat),
    )
    # Every process reads it.
    return replicated(program.mesh, observation)


def _add_to_body(values: list, body: int, contribution: Float[Array, " _"]) -> None:
    # None stands for 0, which costs no addition.
    total = values[body]
    values[body] = contribution if total is None else total + contribution


def saved_rows(
    observations: Sequence[Observation], saved: Sequence[Int[np.ndarray, " _"]]
) -> Observation:
    """Return the rows of all programs at save times, by their numbers in each."""
    # The last interval before a motion snapshot may not be saved.
    if len(observations) == 1 and len(saved[0]) == len(observations[0].is_finite):
        return observations[0]
    return _picked(tuple(observations), tuple(map(device_array, saved)))


@eqx.filter_jit
def _picked(
    observations: tuple[Observation, ...], saved: tuple[Int[Array, " _"], ...]
) -> Observation:
    rows = [
        jax.tree.map(lambda a, numbers=numbers: a[numbers], observed)
        for observed, numbers in zip(observations, saved, strict=True)
    ]
    return joined(*rows)


def joined(*rows: Observation) -> Observation:
    """Return the rows of several observations, one after the other."""
    return jax.tree.map(lambda *columns: jnp.concatenate(columns), *rows)
