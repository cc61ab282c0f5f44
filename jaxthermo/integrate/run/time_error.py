"""The error in time of a run, and the number of steps that keeps it small.

A run of `ErrorControl` is made in passes k = 0, 1, ... of steps each half as long as
those before. With the largest difference of two passes

    d_k = max |T_k - T_(k-1)|    over all fragments and saved times,

and their ratio rho = d_(k-1) / d_k, which is 2^p for a method of order p, the error of
pass k is

    e_k = d_k / (rho - 1),    2 <= rho <= 4.

The second pass, which has no rho yet, takes that of first order, 2. Passes end where

    e_k <= max(relative_error x the largest range, error),

a range being max - min over the surface at one saved time, or where differences no
longer become smaller: what is left is rounding.

Passes differ in arrays only, the `StepTable` and the tolerance of a stepper, so that
all of them run in one compiled program.

Source: Aitken, Proc. Royal Society of Edinburgh 46 (1927) 289-305, for e_k.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..implicit.adaptive import AdaptiveStepper
from ..solvers import ErrorControl
from .plan import Plan
from .solution import Observation


_MAX_PASSES = 12
"""Passes after which something else than the step is wrong."""

_MIN_PROGRESS = 1.25
"""Ratio of successive differences below which shorter steps are of no use,"""

_FIRST_JUDGED = 4
"""from this pass on: the steps of the first ones may be too long to tell."""


class TimeError(NamedTuple):
    """Estimate of the error in time of any fragment at any saved time."""

    kelvin: float
    limit: float
    """[K]"""

    @property
    def holds(self) -> bool:
        """True if the estimate is within its limit."""
        return self.kelvin <= self.limit

    def text(self) -> str:
        """Return the estimate as a note of the receipt."""
        found, limit = f"error in time about {self.kelvin:.2g} K", f"{self.limit:.2g} K"
        if self.holds:
            return f"{found}, within {limit}"
        return (
            f"{found}, above the limit of {limit}, which shorter steps did not reach: "
            "use dtype float64, or give a solver with its step"
        )


class Passes(NamedTuple):
    """The passes of a run so far: all that the next one depends on."""

    number: int = 0
    """Number of the next pass, or of that of `rows` if `finished`."""
    rows: Observation | None = None
    """Observations of the last pass that succeeded."""
    difference: float | None = None
    """Its largest difference to the one before [K]."""
    error: TimeError | None = None
    """Estimate of its error; None before the second pass."""
    finished: bool = False

    def after(self, rows: Observation, control: ErrorControl) -> "Passes":
        """Return the passes after another one with these observations."""
        if not _succeeded(rows):
            # The longest steps may be too long where shorter ones are not.
            if self.number == 0:
                return Passes(1)
            # Shorter steps than good ones may be out of reach of a tolerance.
            if self.error is not None:
                return self._replace(number=self.number - 1, finished=True)
            return Passes(self.number, rows, finished=True)
        if self.rows is None:
            return Passes(self.number + 1, rows)
        one, other = (np.asarray(r.surface_temperature) for r in (self.rows, rows))
        # On the host: nothing to compile, and a fraction of the time of one pass.
        difference = float(np.abs(other - one).max())
        ratio, stagnates = 2.0, False
        if self.difference is not None:
            reduction = self.difference / max(difference, 1e-30)
            ratio = min(max(reduction, 2.0), 4.0)
            judged = self.number >= _FIRST_JUDGED
            stagnates = judged and reduction < _MIN_PROGRESS
        ranges = other.max(axis=1) - other.min(axis=1)
        limit = max(control.relative_error * float(ranges.max()), control.error)
        error = TimeError(difference / (ratio - 1), limit)
        finished = error.holds or stagnates or self.number + 1 >= _MAX_PASSES
        number = self.number + (not finished)
        return Passes(
            number=number,
            rows=rows,
            difference=difference,
            error=error,
            finished=finished,
        )


def _succeeded(rows: Observation) -> bool:
    # The same as `run_result`, on the host.
    if not all(np.asarray(each).all() for each in (rows.is_finite, rows.is_physical)):
        return False
    if rows.statistics is None:
        return True
    failures = ("linear_failed", "newton_failed", "step_limit_reached")
    return not any(np.asarray(getattr(rows.statistics, f))[-1] for f in failures)


def of_pass(plan: Plan, number: int) -> Plan:
    """Return the plan of a pass; the plan itself where the error is not controlled."""
    if plan.control is None:
        return plan
    factor, stepper = 2**number, plan.stepper
    if isinstance(stepper, AdaptiveStepper):
        # The error of a step is of third order in its length.
        tolerance = stepper.tolerance * float(factor) ** -3
        stepper = replace(stepper, tolerance=tolerance)
    # Also under error control, where these are the longest steps: two passes that both
    # take steps as long as they may would not differ.
    intervals = tuple(replace(i, steps=i.steps * factor) for i in plan.intervals)
    return plan._replace(intervals=intervals, stepper=stepper)
