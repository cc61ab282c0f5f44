"""Running cases: what each came to, whatever happens in it."""

import math
import time
from dataclasses import dataclass
from typing import Any

from .case import Bound, Case, Check, Measured, Value


PASSED, FAILED, REPORTED = "pass", "FAIL", "reported"


@dataclass(frozen=True)
class Outcome:
    """A case that was run."""

    case: Case
    measured: Measured | None
    failure: str
    """What stopped it; empty if nothing did."""
    seconds: float

    @property
    def verdict(self) -> str:
        """One of `PASSED`, `FAILED` and, where nothing is judged, `REPORTED`."""
        if self.measured is None or self.measured.passed is False:
            return FAILED
        return REPORTED if self.measured.passed is None else PASSED

    @property
    def worst(self) -> Check | None:
        """What is farthest from its expectation, by its tolerance."""
        if self.measured is None:
            return None
        return max(self.measured.checks, key=severity)


def severity(check: Check) -> float:
    """The error in tolerances; above 1 it fails."""
    if isinstance(check, Bound):
        return 0.0 if check.passes else math.inf
    if not check.tolerance:
        return 0.0 if check.passes is not False else math.inf
    share = abs(check.error) / check.tolerance
    return math.inf if math.isnan(share) else share


def run_case(case: Case) -> Outcome:
    """Run a case; one that breaks is a failure, and the others go on."""
    begin = time.perf_counter()
    measured, failure = None, ""
    try:
        measured = case.measure()
    except Exception as error:  # what breaks a case is what it has to tell
        failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return Outcome(case, measured, failure, time.perf_counter() - begin)


def named(outcomes: list[Outcome], verdict: str) -> list[str]:
    """Ids of the cases of one verdict."""
    return [o.case.id for o in outcomes if o.verdict == verdict]


def plain(outcome: Outcome, group: str) -> dict[str, Any]:
    """An outcome in plain types, for JSON."""
    case, measured = outcome.case, outcome.measured
    order = measured.order if measured is not None else None
    return {
        "id": case.id,
        "group": group,
        "name": case.name,
        "source": case.source,
        "stated_tolerance": case.tolerance,
        "how": case.how,
        "verdict": outcome.verdict,
        "failure": outcome.failure,
        "took_s": round(outcome.seconds, 2),
        "quantities": [_plain_check(c) for c in measured.checks] if measured else [],
        "order": None
        if order is None
        else {
            "sizes": list(order.sizes),
            "errors": [finite(e) for e in order.errors],
            "observed": [finite(p) for p in order.observed],
            "asked": order.asked,
            "pass": order.passes,
        },
    }


def _plain_check(check: Check) -> dict[str, Any]:
    found = {"name": check.name, "unit": check.unit, "computed": finite(check.computed)}
    if isinstance(check, Value):
        found |= {
            "expected": check.expected,
            "error": finite(check.error),
            "tolerance": check.tolerance,
        }
    else:
        found |= {"lowest": finite(check.lowest), "highest": finite(check.highest)}
    return {**found, "pass": check.passes}


def finite(number: float) -> float | None:
    """JSON has no other numbers."""
    return float(number) if math.isfinite(number) else None
