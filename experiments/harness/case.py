"""A case: what is measured, the limits that it must keep, and the verdict."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from jaxthermo.errors import InputError


PASS, FAIL = "pass", "FAIL"
REFUSED = "refused as it must"
REPORTED = "reported"
"""Nothing is judged, or all checks are met and the rest is shown for comparison."""

VERDICTS = (PASS, REFUSED, REPORTED, FAIL)

Number = float | int


@dataclass(frozen=True)
class Value:
    """A computed number beside the one that is expected."""

    name: str
    unit: str
    expected: Number
    computed: Number
    tolerance: Number | None
    """Largest error, in the same unit; None where the source states none."""

    @property
    def error(self) -> float:
        """The computed number less the expected one."""
        return float(self.computed) - float(self.expected)

    @property
    def passes(self) -> bool | None:
        """True if the error is within the tolerance; None if there is none."""
        if self.tolerance is None:
            return None
        # The comparison is false for NaN, which must not pass.
        return abs(self.error) <= self.tolerance

    @property
    def text(self) -> str:
        """The number with its expectation and tolerance."""
        stated = "" if self.tolerance is None else f" +- {self.tolerance:.3g}"
        return f"{self.name} {self.computed:.6g}, expected {self.expected:.6g}{stated}"


@dataclass(frozen=True)
class Bound:
    """A number and the range that it must lie in; NaN lies in no range."""

    name: str
    computed: Number
    highest: Number = math.inf
    lowest: Number = -math.inf
    unit: str = ""

    @property
    def passes(self) -> bool:
        """True if the number lies in the range."""
        return bool(self.lowest <= self.computed <= self.highest)

    @property
    def text(self) -> str:
        """The number between its limits, as in "energy 2e-16 <= 1e-12"."""
        if self.lowest == self.highest:
            return f"{self.name} {self.computed:.6g} = {self.highest:.6g}"
        below = "" if self.lowest == -math.inf else f"{self.lowest:.6g} <= "
        above = "" if self.highest == math.inf else f" <= {self.highest:.6g}"
        return f"{below}{self.name} {self.computed:.3g}{above}"


Check = Value | Bound


@dataclass(frozen=True)
class Order:
    """Convergence: how the error falls with the size of a voxel or a step."""

    sizes: tuple[Number, ...]
    """Sizes from coarse to fine, in any unit."""
    errors: tuple[Number, ...]
    """Error at each size, in any unit."""
    expected: Number | None = None
    """Order that theory gives; None where it gives none, and nothing is judged."""
    margin: Number = 0.3
    """Largest shortfall of the last observed order."""

    @property
    def observed(self) -> tuple[float, ...]:
        """log(e1 / e2) / log(h1 / h2) from each size to the next."""
        steps = pairwise(zip(self.sizes, self.errors, strict=True))
        # An error of exactly 0 says nothing about convergence.
        return tuple(
            math.log(e1 / e2) / math.log(h1 / h2) if e1 > 0 and e2 > 0 else math.nan
            for (h1, e1), (h2, e2) in steps
        )

    @property
    def passes(self) -> bool | None:
        """True if the last observed order is high enough; None if none is expected."""
        if self.expected is None:
            return None
        return self.observed[-1] >= self.expected - self.margin


class Row(NamedTuple):
    """One result of a case; what does not apply is None or empty."""

    what: str = ""
    solver: str = ""
    dtype: str = ""
    overshoot_K: float | None = None
    """Excess over the bounds of the maximum principle, at any node or fragment [K]."""
    energy_residual: float | None = None
    """Energy that the ledger leaves unexplained, over the heat that moved [-]."""
    newton: int | None = None
    linear: int | None = None
    """Iterations of Newton's method and of the linear solver."""
    compile_s: float | None = None
    run_s: float | None = None
    result: str = ""
    """Name of the run's `RESULTS`."""
    seen: str = ""
    checks: tuple[Check, ...] = ()
    order: Order | None = None
    if_met: str = PASS
    """Verdict where all checks are met."""
    failure: str = ""
    """Exception that stopped the case."""

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`; a row in which nothing is judged is only reported."""
        verdicts = [check.passes for check in self.checks]
        if self.order is not None:
            verdicts.append(self.order.passes)
        judged = [passes for passes in verdicts if passes is not None]
        if self.failure or not all(judged):
            return FAIL
        return self.if_met if judged else REPORTED


@dataclass(frozen=True)
class Case:
    """A physical situation with a known answer, and how it is computed here."""

    id: str
    title: str
    source: str
    requirement: str
    """Limits that must be kept, with the tolerance as the source states it."""
    method: str
    """Voxels, steps and solver."""
    measure: Callable[[], Row | Iterable[Row]]


@dataclass(frozen=True)
class Group:
    """Cases of one idea."""

    title: str
    cases: tuple[Case, ...]


def values(
    names: Iterable[str],
    unit: str,
    expected: Iterable[Number],
    computed: Iterable[float],
    tolerance: Number | None,
) -> tuple[Value, ...]:
    """Several numbers of one kind, with one unit and one tolerance."""
    rows = zip(names, expected, computed, strict=True)
    return tuple(Value(n, unit, e, float(c), tolerance) for n, e, c in rows)


def largest_error(checks: Iterable[Value]) -> float:
    """The largest error of several numbers, in their unit."""
    return max(abs(value.error) for value in checks)


def result(checks: Iterable[Check], order: Order | None = None) -> Row:
    """The row of a case that is not about solvers: its checks and its convergence."""
    return Row(checks=tuple(checks), order=order)


def broken(what: str, error: Exception, solver: str = "", dtype: str = "") -> Row:
    """A row that fails because of an exception."""
    text = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return Row(what, solver, dtype, failure=text)


def refusal(
    what: str,
    call: Callable[[], object],
    reason: str,
    solver: str = "",
    dtype: str = "",
) -> Row:
    """A row for a call that must be refused in one line that gives the reason.

    Args:
        what: subject of the row.
        call: must raise an InputError.
        reason: part of its message.
        solver: name of the solver, if any.
        dtype: dtype of the scene, if any.
    """
    try:
        call()
    except InputError as error:
        message = str(error)
        stated = reason in message and "\n" not in message
        seen = message
    except Exception as error:
        return broken(what, error, solver, dtype)
    else:
        stated, seen = False, "not refused"
    check = Bound(f"says {reason!r}", float(stated), 1, 1)
    return Row(what, solver, dtype, seen=seen, checks=(check,), if_met=REFUSED)
