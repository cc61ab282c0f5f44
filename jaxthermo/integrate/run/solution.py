"""What a simulation gives back."""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...arrays import is_traced
from ...physics.term import AbstractTerm
from ...scene.receipt import Receipt
from ...scene.solved_surface import SolvedSurface
from ..implicit.newton_stage import Effort
from .ledger import Energy, HeatRates


class RESULTS(eqx.Enumeration):
    """How a run ended; each failure says what to do."""

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
        "Newton's method did not settle: give a shorter step, or a smaller error to a "
        "solver that chooses its own; a steady state, a larger tolerance, or float64."
    )
    step_limit = (
        "The error stayed above what was asked however short the step: ask for a "
        "larger error, or float64; a term may be not finite."
    )
    below_zero = (
        "A temperature fell below 0 K: a negative heat flux takes out more heat than "
        "the body has; check its sign and unit."
    )


class Run(eqx.Module):
    """How the run went."""

    steps: int = eqx.field(static=True)
    dt: float | None = eqx.field(static=True)
    """The largest step taken [s]."""
    stable_step: float | None = eqx.field(static=True)
    """The limit it was held against [s]; None where it could not be known."""
    solver: str = eqx.field(static=True, default="ForwardEuler")
    effort: Effort | None = None
    """At the end, of an implicit solver."""


class AbstractSolution(eqx.Module):
    """Temperatures of the surface, and what they belong to."""

    times: eqx.AbstractVar[Float[Array, " t"]]
    """[s]"""
    surface_temperature: eqx.AbstractVar[Float[Array, "t s"]]
    """Of every fragment, bodies one after the other [K]."""
    mean_temperature: eqx.AbstractVar[Float[Array, "t b"]]
    """Capacity-weighted, of each body [K]."""
    result: eqx.AbstractVar[RESULTS]
    run: eqx.AbstractVar[Run]
    surfaces: eqx.AbstractVar[tuple[SolvedSurface, ...]]
    terms: eqx.AbstractVar[tuple[AbstractTerm, ...]]
    receipt: eqx.AbstractVar[Receipt]

    def of_body(self, index: int) -> Float[Array | np.ndarray, "t _"]:
        """Surface temperatures of one body [K]."""
        counts = [len(s.geometry.fragment_area) for s in self.surfaces]
        start = sum(counts[:index])
        return self.surface_temperature[:, start : start + counts[index]]


class Solution(AbstractSolution):
    """Temperatures of the surface over time, and what they cost in energy.

    A float64 scene gives numpy arrays where JAX is not set to 64 bits.
    """

    times: Float[Array, " t"]
    surface_temperature: Float[Array, "t s"]
    mean_temperature: Float[Array, "t b"]
    energy: Energy
    result: RESULTS
    run: Run
    surfaces: tuple[SolvedSurface, ...]
    terms: tuple[AbstractTerm, ...]
    receipt: Receipt = eqx.field(static=True)


class SteadySolution(AbstractSolution):
    """Temperatures that stay, and the heat that passes through.

    A float64 scene gives numpy arrays where JAX is not set to 64 bits.
    """

    times: Float[Array, " 1"]
    """The moment whose poses and loads are taken to last [s]."""
    surface_temperature: Float[Array, "1 s"]
    mean_temperature: Float[Array, "1 b"]
    heat_rates: HeatRates
    islands: int = eqx.field(static=True)
    """Parts that exchange heat with nothing, and keep the mean that they start with."""
    result: RESULTS
    run: Run
    surfaces: tuple[SolvedSurface, ...]
    terms: tuple[AbstractTerm, ...]
    receipt: Receipt = eqx.field(static=True)


def outcome(
    finite: Bool[Array, ""], possible: Bool[Array, ""], effort: Effort | None
) -> RESULTS:
    """How a run ended: the first thing that went wrong, gravest first.

    Args:
        finite: whether all temperatures are.
        possible: whether none is below 0 K.
        effort: of an implicit solver.
    """
    found = RESULTS.where(possible, RESULTS.successful, RESULTS.below_zero)
    if effort is not None:
        for failed, told in (
            (effort.linear_failed, RESULTS.linear_not_converged),
            (effort.newton_failed, RESULTS.newton_not_converged),
            (effort.out_of_steps, RESULTS.step_limit),
        ):
            found = RESULTS.where(failed, told, found)
    return RESULTS.where(finite, found, RESULTS.nonfinite)


def raise_failure(result: RESULTS) -> None:
    """Raise what went wrong, with its remedy, unless nothing did."""
    if result != RESULTS.successful:
        raise RuntimeError(RESULTS[result])


Kept = TypeVar("Kept", bound=AbstractSolution)


def keeping_digits(solution: Kept) -> Kept:
    """A solution with its float64 in numpy arrays.

    Where JAX is not set to 64 bits it warns at every use of its own, and rounds.
    """
    if jnp.result_type(float) == jnp.float64 or is_traced(solution):
        return solution
    double = lambda leaf: isinstance(leaf, jax.Array) and leaf.dtype == jnp.float64
    keep = lambda leaf: np.asarray(leaf) if double(leaf) else leaf
    return jax.tree.map(keep, solution)
