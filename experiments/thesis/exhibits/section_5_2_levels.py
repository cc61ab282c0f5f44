"""Sections 5.2 and 6.1: the mean at equilibrium, and holes inside of limbs."""

import math

from ...harness.case import Check, Value, check
from ..bodies import buddha, planck
from ..exhibit import Exhibit, Finding, Row, Verdict
from ..levels import claims


_OTHERS_HEIGHT = 60


def _row(found: Check) -> Row:
    unit = f" [{found.unit}]" if found.unit else ""
    if isinstance(found, Value):
        note = f"full volume {found.expected:.7g}"
        return Row(found.name + unit, None, found.computed, note)
    limits = (("above", found.lowest), ("below", found.highest))
    bounds = [f"{word} {at:.4g}" for word, at in limits if math.isfinite(at)]
    return Row(found.name + unit, None, found.computed, ", ".join(bounds))


def _finding(name: str, texts: tuple[str, str]) -> Finding:
    # The height is that of a statue in other claims: these two have their own bodies.
    every = claims(buddha().mesh, (planck() or buddha()).mesh, _OTHERS_HEIGHT)
    case = next(each for each in every if each.id == name)
    outcome = check(case)
    if outcome.failure:
        raise RuntimeError(outcome.failure)
    checks = [each for row in outcome.rows for each in row.checks]
    judged = [each.passes for each in checks if each.passes is not None]
    met = all(judged)
    verdict = Verdict.REPRODUCED if met else Verdict.CONTRADICTED
    reason = f"{texts[not met]} ({sum(judged)} of {len(judged)} comparisons)."
    return Finding(
        verdict, reason, tuple(map(_row, checks)), chosen=(("bodies", case.method),)
    )


def _equilibrium(_: bool) -> Finding:
    kept = (
        "Long after the sun an insulated body has the full volume's mean temperature "
        "in every structure that keeps its capacity; the others end at the mean of "
        "their own capacity"
    )
    return _finding(
        "C11", (kept, "Some structure that keeps the capacity ends elsewhere")
    )


def _holes(_: bool) -> Finding:
    worse = (
        "Where levels from both sides do not meet, a hole is left inside, and the "
        "error is larger than where they do"
    )
    return _finding(
        "C14", (worse, "The error is no larger where a hole is left inside")
    )


EXHIBITS = (
    Exhibit(
        name="section-5.2-equilibrium",
        title="the mean at equilibrium",
        place="5.2",
        claims=("C11",),
        measure=_equilibrium,
    ),
    Exhibit(
        name="section-6.1-holes",
        title="holes inside of thick parts",
        place="6.1",
        claims=("C14",),
        measure=_holes,
    ),
)
