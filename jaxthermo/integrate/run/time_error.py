"""The error in time of a run, and the number of steps that keeps it small.

A run of `ErrorControl` is made in passes k = 0, 1, ... of steps each half as long as
those before. With the largest difference of two passes

    d_k = max |T_k - T_(k-1)|    over all fragments and saved times,

and their ratio rho = d_(k-1) / d_k, which is 2^p for a method of order p, the error of
pass k is

    e_k = max(d_k, d_(k-1) / 16) / (rho - 1) + eps max |T_k|,    2 <= rho <= 2.5,

with the rounding eps of one number. Stiff modes that a jump excites fall by a factor of
4 or more from pass to pass at first, and by 2 later: rho is limited, and a difference
that vanishes at once is not believed. The second pass, which has no rho yet, takes that
of first order, 2. Passes end where

    e_k <= max(relative_error x the largest range, error),

a range being max - min over the surface at one saved time, or where differences no
longer become smaller: what is left is rounding.

Parts between which no heat flows have errors of their own, see `PartStepper`. The first
passes of all parts are the same. A part that has reached its end takes no steps in
later passes, and its values are those of its last one.

Passes differ in arrays only, the `StepTable`, the tolerance of a stepper and the parts
that take steps, so that all of them run in one compiled program.

Source: Aitken, Proc. Royal Society of Edinburgh 46 (1927) 289-305, for e_k.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from ..implicit.adaptive import AdaptiveStepper
from ..part_stepper import PartStepper
from ..solvers import ErrorControl
from .part_values import PartNumbers
from .plan import Plan
from .solution import Observation


_MAX_PASSES = 12
"""Largest number of passes: after it something other than the step is wrong."""

_MIN_PROGRESS = 1.25
"""Ratio of successive differences below which shorter steps are of no use."""

_LARGEST_RATIO = 2.5
"""Ratio of successive differences that is relied on."""

_LARGEST_FALL = 16.0
"""Ratio by which a difference may be below the one before it."""

_FIRST_JUDGED = 4
"""Pass from which that ratio is judged: earlier steps may be too long to tell."""


_ROUNDED = (
    "steps half as long change as much, by rounding of float32 or by something that "
    "jumps within a step: use dtype float64, or give a solver with its step"
)
_UNSTEADY = (
    "steps half as long change as much, since something jumps within a step: give a "
    "solver with its step, or a larger error"
)
_TOO_LONG = (
    f"steps were halved {_MAX_PASSES - 1} times: give a solver with its step, or a "
    "larger error"
)
_FAILED = "shorter steps failed: give a solver with its step, or a larger error"


class TimeError(NamedTuple):
    """Estimate of the error in time of any fragment at any saved time."""

    kelvin: float
    limit: float
    """[K]"""
    cause: str = ""
    """Why shorter steps do not reach the limit; empty if they may."""

    @property
    def holds(self) -> bool:
        """True if the estimate is within its limit."""
        return self.kelvin <= self.limit

    def text(self) -> str:
        """Return the estimate as a note of the receipt."""
        estimate = f"error in time about {self.kelvin:.2g} K"
        limit = f"{self.limit:.2g} K"
        if self.holds:
            return f"{estimate}, within {limit}"
        return f"{estimate}, above the limit of {limit}: {self.cause}"


class PartError(NamedTuple):
    """Error in time of a part of the scene in its last pass."""

    difference: float
    """Largest difference between its last two passes [K]."""
    kelvin: float
    """Estimate of its error."""
    stagnates: bool
    """True if shorter steps do not reach the limit."""
    holds: bool
    """True if the estimate is within the limit."""

    @property
    def ended(self) -> bool:
        """True if the part takes no further pass."""
        return self.holds or self.stagnates


class Passes(NamedTuple):
    """The passes of a run so far: all that the next one depends on."""

    number: int = 0
    """Number of the next pass, or if `finished` of the pass that made `rows`."""
    rows: Observation | None = None
    """Observations of the last pass of each part that succeeded."""
    part_errors: tuple[PartError, ...] = ()
    """Errors of all parts of the scene; none before the second pass."""
    error: TimeError | None = None
    """Largest of these errors; None before the second pass."""
    finished: bool = False

    def running(self, plan: Plan) -> Plan:
        """Return the plan of the next pass alone, or of the last one."""
        running = of_pass(plan, self.number)
        if not self.part_errors or not isinstance(running.stepper, PartStepper):
            return running
        stepper = replace(running.stepper, takes_steps=self._takes_steps)
        return running._replace(stepper=stepper)

    @property
    def _takes_steps(self) -> Bool[np.ndarray, " parts"]:
        return np.array([not error.ended for error in self.part_errors])

    def after(
        self,
        rows: Observation,
        control: ErrorControl,
        part_numbers: PartNumbers | None = None,
    ) -> "Passes":
        """Return the passes after another one with these observations.

        `part_numbers` are those of their values; None where the scene is one part.
        """
        if not _succeeded(rows):
            # The longest steps may be too long where shorter ones are not.
            if self.number == 0:
                return Passes(1)
            # Shorter steps than good ones may be out of reach of a tolerance.
            if self.error is not None:
                return self._replace(
                    number=self.number - 1,
                    error=self.error._replace(cause=_FAILED),
                    finished=True,
                )
            return Passes(self.number, rows, finished=True)
        if self.rows is None:
            return Passes(self.number + 1, rows)
        # On the host, where there is nothing to compile.
        part_count = 1
        of_fragment = np.zeros(rows.surface_temperature.shape[1], int)
        if part_numbers is not None:
            part_count = part_numbers.count
            of_fragment = part_numbers.of_fragment
            if self.part_errors:
                rows = part_numbers.merged(rows, self.rows, self._takes_steps)
        previous = np.asarray(self.rows.surface_temperature)
        latest = np.asarray(rows.surface_temperature)
        differences = np.zeros(part_count, latest.dtype)
        np.maximum.at(differences, of_fragment, np.abs(latest - previous).max(axis=0))
        if self.error is not None and any(
            part_error.ended for part_error in self.part_errors
        ):
            # The limit that these parts have met.
            limit = self.error.limit
        else:
            ranges = latest.max(axis=1) - latest.min(axis=1)
            limit = max(control.relative_error * float(ranges.max()), control.error)
        rounding = float(np.finfo(latest.dtype).eps * np.abs(latest).max())
        part_errors = tuple(
            self._part_error(number, difference, rounding, limit)
            for number, difference in enumerate(differences.tolist())
        )
        cause = ""
        if any(part_error.stagnates for part_error in part_errors):
            is_rounded = latest.dtype == np.float32
            cause = _ROUNDED if is_rounded else _UNSTEADY
        elif self.number + 1 >= _MAX_PASSES:
            cause = _TOO_LONG
        largest = max(part_error.kelvin for part_error in part_errors)
        all_ended = all(part_error.ended for part_error in part_errors)
        finished = all_ended or self.number + 1 >= _MAX_PASSES
        return Passes(
            number=self.number + (not finished),
            rows=rows,
            part_errors=part_errors,
            error=TimeError(largest, limit=limit, cause=cause),
            finished=finished,
        )

    def _part_error(
        self, number: int, difference: float, rounding: float, limit: float
    ) -> PartError:
        """Return the error of a part whose last two passes differ so much."""
        ratio = 2.0
        stagnates = False
        # The difference that is believed.
        expected = difference
        if self.part_errors:
            previous = self.part_errors[number]
            if previous.ended:
                return previous
            reduction = previous.difference / max(difference, 1e-30)
            ratio = min(max(reduction, 2.0), _LARGEST_RATIO)
            expected = max(difference, previous.difference / _LARGEST_FALL)
            judged = self.number >= _FIRST_JUDGED
            stagnates = judged and reduction < _MIN_PROGRESS
        kelvin = expected / (ratio - 1) + rounding
        return PartError(
            difference=difference,
            kelvin=kelvin,
            stagnates=stagnates,
            holds=kelvin <= limit,
        )


def _succeeded(rows: Observation) -> bool:
    # As `run_result` judges a run, but on the host.
    if not all(np.asarray(flags).all() for flags in (rows.is_finite, rows.is_physical)):
        return False
    if rows.statistics is None:
        return True
    failures = ("linear_failed", "newton_failed", "step_limit_reached")
    return not any(np.asarray(getattr(rows.statistics, f))[-1] for f in failures)


def of_pass(plan: Plan, number: int) -> Plan:
    """Return the plan of one pass alone; the plan itself without error control."""
    if plan.control is None:
        return plan
    factor = 2**number
    stepper = plan.stepper
    if isinstance(stepper, AdaptiveStepper):
        # The error of a step is of third order in its length.
        tolerance = stepper.tolerance * float(factor) ** -3
        stepper = replace(stepper, tolerance=tolerance)
    if isinstance(stepper, PartStepper):
        stepper = replace(stepper, takes_steps=np.ones(len(stepper.groups), bool))
    # Also under error control, where these are the longest steps: two passes that both
    # take steps as long as they may would not differ.
    intervals = tuple(replace(i, steps=i.steps * factor) for i in plan.intervals)
    return plan._replace(intervals=intervals, stepper=stepper, control=None)
