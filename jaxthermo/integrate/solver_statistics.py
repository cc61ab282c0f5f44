"""Cost and failures of an implicit solver."""

import jax
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Bool, Float, Int

from ..physics.flux_law import Values


class SolverStatistics(Module):
    """Cost and failures of an implicit solver since the start of the run."""

    newton_iterations: Int[Values, ""] | int
    linear_iterations: Int[Values, ""] | int
    accepted_steps: Int[Values, ""] | int
    """Steps under error control."""
    rejected_steps: Int[Values, ""] | int
    """Steps under error control that were repeated shorter."""
    largest_linear_residual: Float[Values, ""] | float
    """Largest final residual of a linear solve over capacity, or its correction where
    the residual is rounding [K]."""
    linear_failed: Bool[Values, ""] | bool
    newton_failed: Bool[Values, ""] | bool
    step_limit_reached: Bool[Values, ""] | bool
    """True if the error control gave up on an interval."""

    def plus(self, later: "SolverStatistics") -> "SolverStatistics":
        """Return the statistics of two parts of a run together."""

        # Counts add up, failures stay, and residuals are compared.
        def combine(a: Array, b: Array) -> Array:
            if jnp.issubdtype(a.dtype, jnp.floating):
                return jnp.maximum(a, b)
            return a | b if a.dtype == bool else a + b

        return jax.tree.map(combine, self, later)


def zero_statistics(dtype) -> SolverStatistics:
    """Return the statistics of a run that has not started."""
    zero = jnp.zeros((), jnp.int32)
    false = jnp.zeros((), bool)
    return SolverStatistics(
        newton_iterations=zero,
        linear_iterations=zero,
        accepted_steps=zero,
        rejected_steps=zero,
        largest_linear_residual=jnp.zeros((), dtype),
        linear_failed=false,
        newton_failed=false,
        step_limit_reached=false,
    )
