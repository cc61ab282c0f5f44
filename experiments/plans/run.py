"""`experiments run plans`: five parts, each planned for three tolerances."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, cast

from jaxthermo.console.progress import terminal_progress
from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError

from ..harness.case import Case, Check, Group, Row
from ..harness.record import Record
from ..harness.report import CasesResult, PageTexts, run_cases
from .measure import PlanRow, measure


_HERE = Path(__file__).parent
PARTS = tuple(sorted(path.stem for path in (_HERE / "parts").glob("*.yaml")))
TOLERANCES = (10.0, 5.0, 3.0)
"""Tolerances of each part [%]."""

MAX_VOXELS = 5000
"""Largest number of voxels of a part at its own pitch."""
_ALWAYS_MET = 10.0
"""Tolerance that every part has a model for [%]."""
_MAY_MISS = 3
"""Largest number of the 15 plans that may find nothing."""

# Interval of the lines that replace a progress bar in a pipe [s].
_INTERVAL = 30.0

_PAGE = PageTexts(
    "Plans",
    (
        "Each part is planned for each tolerance. The true error of the model that is "
        "chosen is its difference from temperatures that are extrapolated from the "
        "plan's two finest references and from a run in voxels 1.5 times as fine, at "
        "points of the surface.",
    ),
)


class Plan(NamedTuple):
    """A plan of a part."""

    part: str
    tolerance: float
    """[%]"""
    row: PlanRow


def run(folder: Path, cases: str | None = None) -> CasesResult:
    """Plan the parts of names such as "bowl,fins", or all; write the page.

    Plans that the folder has from the same programs are not made again, and an
    interrupted one goes on from its last candidate.
    """
    begin = time.perf_counter()
    parts = _parts(cases)
    record = Record(folder, (_HERE, _HERE.parents[1] / "calibrate"))
    plans = []
    with terminal_progress(open_console(), _INTERVAL) as progress:
        for part in parts:
            for tolerance in TOLERANCES:

                def make(part: str = part, tolerance: float = tolerance):
                    progress.line(f"{part}, {tolerance:g} %")
                    scene = _HERE / "parts" / f"{part}.yaml"
                    rows = folder / "candidates" / part
                    return dict(measure(scene, tolerance, rows, progress)), {}

                names = {"part": part, "tolerance_percent": tolerance}
                row = record.once(names, names, make)
                if "refused" in row:
                    raise InputError(f"{part}, {tolerance:g} %: {row['refused']}")
                plans.append(Plan(part, tolerance, cast("PlanRow", row)))
    group = Group("Plans", judged(plans))
    return run_cases((group,), names=None, folder=folder, texts=_PAGE, begin=begin)


def _parts(cases: str | None) -> tuple[str, ...]:
    if cases is None:
        return PARTS
    names = tuple(cases.split(","))
    if unknown := [name for name in names if name not in PARTS]:
        raise InputError(f"--cases {unknown[0]}: there are {', '.join(PARTS)}")
    return names


def judged(plans: list[Plan]) -> tuple[Case, ...]:
    """The limits as cases."""

    def errors() -> Iterator[Row]:
        for plan in plans:
            true_percent = plan.row["true_percent"]
            if true_percent is None:
                continue
            error = Check("true error", true_percent, highest=plan.tolerance, unit="%")
            yield Row(_name(plan), seen=_words(plan.row), checks=(error,))

    def misses() -> Iterator[Row]:
        missed = [plan for plan in plans if plan.row["true_percent"] is None]
        large = [plan for plan in missed if plan.tolerance >= _ALWAYS_MET]
        allowed = _MAY_MISS * len(plans) // (len(PARTS) * len(TOLERANCES))
        yield Row("without a model", checks=(_number(missed, allowed),))
        yield Row(f"at {_ALWAYS_MET:g} %", checks=(_number(large, 0),))
        yield from (Row(_name(plan), seen=_words(plan.row)) for plan in missed)

    def sizes() -> Iterator[Row]:
        for plan in plans:
            voxels = Check("voxels", plan.row["voxels"], highest=MAX_VOXELS)
            yield Row(_name(plan), checks=(voxels,))

    return (
        Case(
            id="P1",
            title="the model's true error is within the tolerance",
            source="Richardson extrapolation of three fine runs",
            requirement="true error <= tolerance, in all plans",
            method="`calibrate plan`",
            measure=errors,
        ),
        Case(
            id="P2",
            title="a model is found",
            source="models in finer voxels are more accurate",
            requirement=f"at 10 % for all parts; {_MAY_MISS} of 15 may have none",
            method="`calibrate plan`",
            measure=misses,
        ),
        Case(
            id="P3",
            title="parts are small",
            source="volume over that of a voxel",
            requirement=f"{MAX_VOXELS:,} voxels at their own pitch",
            method="the mesh's volume",
            measure=sizes,
        ),
    )


def _number(plans: list[Plan], allowed: int) -> Check:
    return Check("plans", len(plans), highest=allowed)


def _name(plan: Plan) -> str:
    return f"{plan.part}, {plan.tolerance:g} %"


def _words(row: PlanRow) -> str:
    reference = f"reference off by {row['reference_percent']:.2g} %"
    if row["difference_percent"] is None:
        return reference
    difference = f"difference {row['difference_percent']:.2g} %"
    return f"{row['chosen']}: {difference}, {reference}"
