"""Outcomes of cases: which cases are run, their verdicts, and their record."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jaxthermo.errors import InputError

from .case import (
    FAIL,
    PASS,
    REPORTED,
    Bound,
    Case,
    Check,
    Group,
    Order,
    Row,
    Value,
    broken,
)


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
        return max(checks, key=severity, default=None)


def severity(check: Check) -> float:
    """Error over tolerance: above 1 the check fails."""
    if isinstance(check, Bound):
        if not check.passes:
            return math.inf
        one_sided = check.lowest == -math.inf and 0 < check.highest < math.inf
        return max(0.0, check.computed / check.highest) if one_sided else 0.0
    if not check.tolerance:
        return 0.0 if check.passes is not False else math.inf
    ratio = abs(check.error) / check.tolerance
    return math.inf if math.isnan(ratio) else ratio


def check(case: Case) -> Outcome:
    """Run a case; an exception becomes a row that fails, after the rows before it.

    A test can parametrize over cases and assert `check(case).verdict != FAIL`.
    """
    begin, rows = time.perf_counter(), []
    try:
        measured = case.measure()
        for row in (measured,) if isinstance(measured, Row) else measured:
            rows.append(row)
    except Exception as error:  # one broken case must not stop the others
        rows.append(broken("the case itself", error))
    return Outcome(case, tuple(rows), time.perf_counter() - begin)


def select(groups: Sequence[Group], names: str | None) -> tuple[Group, ...]:
    """The groups, reduced to the cases that are named.

    Args:
        groups: all cases.
        names: beginnings of ids, separated by commas, such as "V21,A1"; None for all.

    Raises:
        InputError: for a name that no case has.
    """
    if names is None:
        return tuple(groups)
    wanted = [name.strip().upper() for name in names.split(",") if name.strip()]
    cases = [case for group in groups for case in group.cases]
    known = "there are " + "; ".join(case.id for case in cases)
    if not wanted:
        raise InputError(f"--cases {names!r} names none: {known}")
    for name in wanted:
        if not any(_is_named(case, [name]) for case in cases):
            raise InputError(f"--cases {name}: {known}")
    picked = (
        Group(group.title, tuple(c for c in group.cases if _is_named(c, wanted)))
        for group in groups
    )
    return tuple(group for group in picked if group.cases)


def _is_named(case: Case, names: list[str]) -> bool:
    """True if a part of the case's id begins with one of the names."""
    parts = case.id.upper().replace(",", " ").split()
    return any(part.startswith(name) for part in parts for name in names)


def ids_of(outcomes: Sequence[Outcome], verdict: str) -> list[str]:
    """Ids of the cases with a verdict."""
    return [o.case.id for o in outcomes if o.verdict == verdict]


def plain(outcome: Outcome, group: str) -> dict[str, Any]:
    """An outcome in types that JSON has."""
    case = outcome.case
    return {
        "id": case.id,
        "group": group,
        "title": case.title,
        "source": case.source,
        "requirement": case.requirement,
        "method": case.method,
        "verdict": outcome.verdict,
        "took_s": round(outcome.seconds, 2),
        "rows": [_plain_row(row) for row in outcome.rows],
    }


def _plain_row(row: Row) -> dict[str, Any]:
    fields = {name: _number(value) for name, value in row._asdict().items()}
    del fields["if_met"], fields["order"]
    fields["checks"] = [_plain_check(check) for check in row.checks]
    found = {k: v for k, v in fields.items() if v not in (None, "")}
    if row.order is not None:
        found["order"] = _plain_order(row.order)
    return {**found, "verdict": row.verdict}


def _plain_check(check: Check) -> dict[str, Any]:
    names = ("name", "unit", "computed")
    names += (
        ("expected", "error", "tolerance", "passes")
        if isinstance(check, Value)
        else ("lowest", "highest", "passes")
    )
    return {name: _number(getattr(check, name)) for name in names}


def _plain_order(order: Order) -> dict[str, Any]:
    return {
        "sizes": list(order.sizes),
        "errors": [_number(e) for e in order.errors],
        "observed": [_number(p) for p in order.observed],
        "expected": order.expected,
        "passes": order.passes,
    }


def _number(value: Any) -> Any:
    """A number that JSON lacks, NaN or infinity, as text; others as they are."""
    if isinstance(value, bool | str | None) or not isinstance(value, float | int):
        return value
    return value if math.isfinite(value) else str(value)
