"""Steps and solver of a run."""

import equinox as eqx
from equinox import Module

from ..solver_statistics import SolverStatistics


class RunSummary(Module):
    """Steps and solver of a run."""

    steps: int = eqx.field(static=True)
    dt: float | None = eqx.field(static=True)
    """Largest step taken [s]."""
    stable_step: float | None = eqx.field(static=True)
    """Largest stable explicit step [s]; None where it could not be known, and in a
    steady state."""
    solver: str = eqx.field(static=True, default="ForwardEuler")
    statistics: SolverStatistics | None = None
    """Totals at the end of the run; None for explicit solvers."""
    time_error: float | None = eqx.field(static=True, default=None)
    """Estimate of the largest error in time of any fragment at any saved time [K], not
    below the energy residual; None without `ErrorControl`, or in a traced scene."""
    time_error_limit: float | None = eqx.field(static=True, default=None)
    """Limit up to which steps were divided [K]."""
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    """Limits that the run missed, each with its cause and what to do."""
