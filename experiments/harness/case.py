"""A case: what is measured, the limits that it must keep, and the verdict."""

import functools
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from jaxthermo.errors import InputError


PASS = "pass"
FAIL = "FAIL"
REFUSED = "refused as it must"
# Nothing is judged, or all checks are met and the rest is shown for comparison.
REPORTED = "reported"

Number = float | int


@dataclass(frozen=True)
class Check:
    """A computed number with the range or the value that it must have.

    NaN lies in no range and is near no value.
    """

    name: str
    computed: Number
    highest: Number = math.inf
    lowest: Number = -math.inf
    unit: str = ""
    expected: Number | None = None
    """Expected value; None for a number that only has a range."""
    tolerance: Number | None = None
    """Largest error, in the unit; None where the source of the value states none."""

    @property
    def error(self) -> float:
        """The computed number less the expected one; NaN if none is expected."""
        expected = math.nan if self.expected is None else self.expected
        return float(self.computed) - float(expected)

    @property
    def passes(self) -> bool | None:
        """True if the number is right; None without a tolerance or a limit."""
        if self.expected is None:
            is_open = self.lowest == -math.inf and self.highest == math.inf
            if is_open and not math.isnan(self.computed):
                return None
            return bool(self.lowest <= self.computed <= self.highest)
        if self.tolerance is None:
            return None
        return abs(self.error) <= self.tolerance

    @property
    def text(self) -> str:
        """The number with its expectation or limits: "energy 2e-16 <= 1e-12"."""
        if self.expected is not None:
            stated = "" if self.tolerance is None else f" +- {self.tolerance:.3g}"
            expected = f"expected {self.expected:.6g}{stated}"
            return f"{self.name} {self.computed:.6g}, {expected}"
        if self.lowest == self.highest:
            return f"{self.name} {self.computed:.6g} = {self.highest:.6g}"
        below = "" if self.lowest == -math.inf else f"{self.lowest:.6g} <= "
        above = "" if self.highest == math.inf else f" <= {self.highest:.6g}"
        return f"{below}{self.name} {self.computed:.3g}{above}"


@dataclass(frozen=True)
class Order:
    """Convergence: how the error falls with the size of a voxel or a step."""

    sizes: tuple[Number, ...]
    """Sizes from coarse to fine, in any unit."""
    errors: tuple[Number, ...]
    """Error at each size, in any unit."""
    expected: Number | None = None
    """Order that theory gives; None where it gives none, and nothing is judged."""
    # On few sizes the order is seen with the next term of the error in it.
    margin: Number = 0.3
    """Largest shortfall of the last observed order."""

    @property
    def observed(self) -> tuple[float, ...]:
        """log(e1 / e2) / log(h1 / h2) from each size to the next."""
        orders = []
        for coarse, fine in pairwise(zip(self.sizes, self.errors, strict=True)):
            h1, e1 = coarse
            h2, e2 = fine
            # An error of exactly 0 says nothing about convergence.
            is_seen = e1 > 0 and e2 > 0
            order = math.log(e1 / e2) / math.log(h1 / h2) if is_seen else math.nan
            orders.append(order)
        return tuple(orders)

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
        """A row in which nothing is judged is only reported."""
        verdicts = [check.passes for check in self.checks]
        if self.order is not None:
            verdicts.append(self.order.passes)
        judged = [passes for passes in verdicts if passes is not None]
        if self.failure or not all(judged):
            return FAIL
        return self.if_met if judged else REPORTED


# One row; or rows, and checks that share one row, as they are measured.
Measure = Callable[[], Row | Iterable[Row | Check]]


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
    measure: Measure


def case(
    id_: str, title: str, source: str, requirement: str, method: str = ""
) -> Callable[[Measure], Case]:
    """Decorator of the function that measures a case; arguments as of `Case`."""
    return functools.partial(Case, id_, title, source, requirement, method)


@dataclass(frozen=True)
class Group:
    """Cases of one idea."""

    title: str
    cases: tuple[Case, ...]


@dataclass(frozen=True)
class Outcome:
    """A case that was run, with its rows."""

    case: Case
    rows: tuple[Row, ...]
    seconds: float

    @property
    def verdict(self) -> str:
        """FAIL if any row fails, else PASS if any was judged, else REPORTED."""
        verdicts = {row.verdict for row in self.rows}
        if FAIL in verdicts:
            return FAIL
        return REPORTED if verdicts <= {REPORTED} else PASS

    @property
    def failure(self) -> str:
        """The exception that stopped the case, if any."""
        return "; ".join(row.failure for row in self.rows if row.failure)

    @property
    def worst(self) -> Check | None:
        """The check with the largest error over its tolerance."""
        checks = [check for row in self.rows for check in row.checks]
        return max(checks, key=_severity, default=None)


def _severity(check: Check) -> float:
    # Error over tolerance, so that checks of any unit compare: above 1 one fails.
    if check.expected is None:
        if check.passes is False:
            return math.inf
        if check.passes is None:
            return 0.0
        if check.lowest == -check.highest:
            return abs(check.computed) / check.highest if check.highest else 0.0
        one_sided = check.lowest == -math.inf and 0 < check.highest < math.inf
        return max(0.0, check.computed / check.highest) if one_sided else 0.0
    if not check.tolerance:
        return 0.0 if check.passes is not False else math.inf
    ratio = abs(check.error) / check.tolerance
    # No number compares with NaN: `max` would pass over the worst of all.
    return math.inf if math.isnan(ratio) else ratio


def check(case: Case) -> Outcome:
    """Run a case; an exception becomes a row that fails, after the rows before it."""
    begin = time.perf_counter()
    rows: list[Row] = []
    checks: list[Check] = []
    try:
        measured = case.measure()
        # A row is a tuple itself, and would be taken apart.
        for item in (measured,) if isinstance(measured, Row) else measured:
            if isinstance(item, Row):
                rows.append(item)
            else:
                checks.append(item)
    except Exception as error:  # one broken case must not stop the others
        rows.append(Row("the case itself", failure=described(error)))
    shared = [Row(checks=tuple(checks))] if checks else []
    return Outcome(case, (*shared, *rows), time.perf_counter() - begin)


def near(
    name: str,
    computed: Number,
    expected: Number,
    *,
    unit: str = "",
    tolerance: Number | None = None,
    fraction: Number | None = None,
) -> Check:
    """A number with its expected value.

    The tolerance is in the unit, or a fraction of the expected value.
    """
    if fraction is not None:
        tolerance = fraction * abs(expected)
    return Check(
        name, float(computed), unit=unit, expected=expected, tolerance=tolerance
    )


def values(
    expected: Mapping[str, Number], computed: Iterable[Number], **limits: Any
) -> tuple[Check, ...]:
    """Numbers with their expected values by name; limits as of `near`."""
    pairs = zip(expected.items(), computed, strict=True)
    return tuple(near(name, number, value, **limits) for (name, value), number in pairs)


def exactly(name: str, computed: Number, value: Number) -> Check:
    """A number, or the truth of a statement as 0 or 1, that must have one value."""
    return Check(name, float(computed), highest=value, lowest=value)


def largest_error(checks: Iterable[Check]) -> float:
    """The largest error of several numbers, in their unit."""
    return max(abs(value.error) for value in checks)


def converge(
    measure: Callable[..., Iterable[Check]],
    at: Sequence[Number],
    length: Number | None = None,
    *,
    expected: Number | None = None,
    shown: int = -1,
    error: Callable[[Sequence[Check]], float] = largest_error,
) -> Row:
    """The checks at one resolution, the finest or `shown`, and the order over all.

    Args:
        measure: gives the checks at a size of a voxel or a step, or at a cell count.
        at: sizes or counts, from coarse to fine.
        length: that the cells divide; None if `at` are sizes themselves.
        expected: order that theory gives, if any.
        shown: index of the resolution whose checks are judged.
        error: of one resolution, from its checks.
    """
    checks = [tuple(measure(resolution)) for resolution in at]
    sizes = tuple(at) if length is None else tuple(length / count for count in at)
    order = Order(sizes, errors=tuple(map(error, checks)), expected=expected)
    return Row(checks=checks[shown], order=order)


def named_cases(names: str, listed: str) -> list[str]:
    """The names of an option such as "V21, A1"; `listed` are those that there are.

    Raises:
        InputError: if it names none.
    """
    stripped = (name.strip() for name in names.split(","))
    requested = [name for name in stripped if name]
    if not requested:
        raise InputError(f"--cases {names!r} names none: there are {listed}")
    return requested


def described(error: Exception) -> str:
    """An exception in one line, with its kind."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def attempt(
    what: str, measure: Callable[[], Row], solver: str = "", dtype: str = ""
) -> Row:
    """The row that is measured, with its names; it fails because of an exception."""
    try:
        return measure()._replace(what=what, solver=solver, dtype=dtype)
    except Exception as error:  # the rows after it must not be lost
        return Row(what, solver, dtype, failure=described(error))


def refusal(
    what: str, call: Callable[[], object], reason: str, solver: str = "", dtype=""
) -> Row:
    """A row for a call that an InputError must refuse, with the reason in one line."""
    stated = False
    seen = "not refused"
    try:
        call()
    except InputError as error:
        seen = str(error)
        stated = reason in seen and "\n" not in seen
    except Exception as error:
        # Any other exception is a stack trace to the user, not a refusal.
        return Row(what, solver, dtype, failure=described(error))
    check = exactly(f"says {reason!r}", stated, 1)
    return Row(what, solver, dtype, seen=seen, checks=(check,), if_met=REFUSED)
