"""`experiments run stiff`: stiff and extreme cases through every solver."""

from pathlib import Path

from ..harness.case import Group
from ..harness.report import CasesResult, PageTexts, run_cases
from . import contrasts, extremes, inputs, radiation


_MODULES = (contrasts, extremes, radiation, inputs)
_CASES = tuple(
    sorted((case for m in _MODULES for case in m.CASES), key=lambda case: case.id)
)

_PAGE = PageTexts(
    "Stiff and extreme cases",
    (
        "Each row is one solver on one scene. It passes if all of its checks lie "
        "within the limits given with it; a run that must be refused passes if the "
        "refusal gives the reason. Reported: the energy is judged, the overshoot is "
        "shown for comparison only.",
        "A result other than successful is the run's own verdict: an error unless the "
        "caller asks for the result. Bounds and energy are judged all the same. Run "
        "times are those of the second run, without compilation.",
    ),
)


def run(folder: Path, cases: str | None = None) -> CasesResult:
    """Run the cases whose ids begin so, such as "S01,V21", or all; write the page."""
    groups = (Group("Stiff and extreme cases", _CASES),)
    return run_cases(groups, cases, folder, _PAGE)
