"""Steps in time of a fit's runs, which follow the values that are tried.

Explicit steps are stable up to a length that the values determine. All runs of a case
divide the same intervals, in tables of one shape: other steps are other arguments of
one compiled program.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.integrate.run.plan import StepTable


STEP_MARGIN = 1.25
"""Stable step over the step: room to become stiffer before steps are added."""
_MAX_SLACK = 2.5
"""Stable step over the step, above which runs take more steps than they need."""
_SETTLED_SLACK = 1.1
"""Change of the stable step that leaves the steps at the end of a fit as they are."""
MAX_STIFFENING = 100.0
"""Stable step at the start over that of a trial, above which its runs are too long."""
_ROUNDING = 1e-4
"""Excess of a step over the stable one that is rounding."""

StepTables = tuple[StepTable, ...]
"""Step sizes and counts of each case."""
Limits = Float[np.ndarray, " c"]
"""Longest stable step of each case [s]; infinite for schemes that are always stable."""


class TimeSteps(NamedTuple):
    """Steps of the runs of all cases, by the longest that are stable."""

    runs: tuple[ParametricRun, ...]
    fewest: StepTables
    """Fewest steps of each case."""

    def at(self, limits: Limits) -> StepTables:
        """Steps for values with these limits, and for somewhat stiffer ones."""
        return self._replaced(self.fewest, limits, shortest=math.inf, longest=0.0)

    def followed(self, tables: StepTables, limits: Limits) -> StepTables:
        """Make those steps again that are too long or needlessly short.

        Others stay, since each change moves the residuals a little.
        """
        return self._replaced(tables, limits, shortest=1.0, longest=_MAX_SLACK)

    def settled(self, tables: StepTables, limits: Limits) -> StepTables:
        """Make those steps again that depend on the values tried before."""
        return self._replaced(
            tables,
            limits,
            shortest=STEP_MARGIN / _SETTLED_SLACK,
            longest=STEP_MARGIN * _SETTLED_SLACK,
        )

    def _replaced(
        self, tables: StepTables, limits: Limits, shortest: float, longest: float
    ) -> StepTables:
        """Replace tables whose steps are out of a range below the limits."""
        new_tables = []
        for run, fewest, table, limit in zip(
            self.runs, self.fewest, tables, np.asarray(limits, float), strict=True
        ):
            slack = limit / _longest_step(table)
            # Values that are not finite have no limit, nor residuals.
            if slack > 0 and (slack < shortest or slack > longest):
                table = run.divided(fewest, limit / STEP_MARGIN)
            new_tables.append(table)
        return tuple(new_tables)


def is_beyond(trial: Limits, first: Limits) -> bool:
    """True if a trial is too stiff to be run, compared with the start, or undefined."""
    return not bool((trial * MAX_STIFFENING >= first).all())


def _longest_step(table: StepTable) -> float:
    sizes = np.asarray(table.dt)
    counts = np.asarray(table.steps)
    return float(sizes[counts > 0].max())


def is_stable(table: StepTable, longest: Float[Array, ""]) -> Bool[Array, ""]:
    """True if no step of a table is longer than is stable [s]; both may be traced."""
    steps = jnp.where(table.steps > 0, table.dt, 0)
    return (steps <= longest * (1 + _ROUNDING)).all()
