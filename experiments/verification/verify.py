"""`experiments run verification`: every published case that can be expressed here."""

from pathlib import Path

from ..harness.case import Group
from ..harness.report import CasesResult, PageTexts, run_cases
from . import bars, contacts, radiation, round_and_square, steady_bodies, walls


GROUPS = (
    Group("Half-spaces, slabs and bars in time", bars.CASES),
    Group("Contact", contacts.CASES),
    Group("Round and square bodies in time", round_and_square.CASES),
    Group("Steady walls", walls.CASES),
    Group("Steady bodies", steady_bodies.CASES),
    Group("Radiation, convection, pictures", radiation.CASES),
)

NOT_COVERED = (
    (
        "A15, other correlations",
        "Zukauskas, Fand, McAdams, Whitaker and Perkins-Leppert are not among the "
        "averages here",
    ),
    ("A15, spectral radiance", "it is compared by tests/unit/image/test_band.py"),
    ("A16", "raw counts are compared by tests/unit/image/test_thermography.py"),
    ("A17, angles", "they are compared by tests/unit/image/effects/test_effects.py"),
    ("A18", "the channel of Schaefer and Turek is computed by tests/unit/flow"),
    ("V24, plates as bodies", "no body is endless; the spheres are computed"),
)

PAGE = PageTexts(
    "Verification: published cases and closed forms",
    (
        "Tolerances are those of the sources. Errors are computed less expected; each "
        "case is listed with the quantity whose error is largest over its tolerance.",
    ),
    NOT_COVERED,
)

# Most of their time the cases are compiled, which takes one core.
_AT_ONCE = 2


def run(folder: Path, cases: str | None = None) -> CasesResult:
    """Run the cases whose ids begin so, such as "S01,V21", or all; write the page."""
    return run_cases(GROUPS, names=cases, folder=folder, texts=PAGE, at_once=_AT_ONCE)
