"""What a simulation gives back."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..physics.term import AbstractTerm
from ..scene.receipt import Receipt
from ..scene.surface import SolvedSurface
from .ledger import Energy
from .stage import Effort


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
        "Newton's method did not settle in 20 steps: give a shorter step, or a smaller "
        "error to a solver that chooses its own."
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


class Solution(eqx.Module):
    """Temperatures of the surface over time, and what they cost in energy.

    A float64 scene gives numpy arrays where JAX is not set to 64 bits.
    """

    times: Float[Array, " t"]
    """[s]"""
    surface_temperature: Float[Array, "t s"]
    """Of the node under every fragment, bodies one after the other [K]."""
    mean_temperature: Float[Array, "t b"]
    """Capacity-weighted, of each body [K]."""
    energy: Energy
    result: RESULTS
    run: Run
    surfaces: tuple[SolvedSurface, ...]
    terms: tuple[AbstractTerm, ...]
    receipt: Receipt = eqx.field(static=True)

    def of_body(self, index: int) -> Float[Array | np.ndarray, "t _"]:
        """Surface temperatures of one body [K]."""
        counts = [len(s.geometry.fragment_area) for s in self.surfaces]
        start = sum(counts[:index])
        return self.surface_temperature[:, start : start + counts[index]]
