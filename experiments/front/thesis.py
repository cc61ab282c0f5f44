from collections.abc import Sequence

from jaxthermo.report import page
from jaxthermo.report.table import Cell, Table

from .charts import Marks
from .pareto import Point
from .wording import error_text, ratio_text, time_text


_FULL_VOLUME_MS = 55.0
"""Time of the full volume in the thesis, on its graphics card [ms]."""

# Run time in the thesis [ms], and the kind of structure in a config.
_TIMES = {
    "shell": (13.0, "single_shell"),
    "irregular levels": (21.0, "irregular_multi_level"),
    "ten levels": (50.0, "multi_level"),
}


def _full_time(points: Sequence[Point]) -> float | None:
    """Time of the slowest explicit loop of a full volume that was timed [s]."""
    times = [
        p.time.median * p.ratio.median
        for p in points
        if p.time is not None and p.ratio is not None and _structure(p) in _kinds()
    ]
    return max(times, default=None)


def _kinds() -> set[str]:
    return {kind for _, kind in _TIMES.values()}


def _structure(point: Point) -> str | None:
    """The kind of structure that a choice sets."""
    for key, value in (point.set or {}).items():
        if key.endswith("structure"):
            return value["kind"] if isinstance(value, dict) else str(value)
        if key.endswith("structure.kind"):
            return str(value)
    return None


def thesis_marks(points: Sequence[Point]) -> Marks:
    """Times of the thesis' ratios for our full volume [s]."""
    full = _full_time(points)
    if full is None:
        return ()
    return [
        (f"thesis: {name} {time:g}/{_FULL_VOLUME_MS:g}", full * time / _FULL_VOLUME_MS)
        for name, (time, _) in _TIMES.items()
    ]


def thesis_table(points: Sequence[Point]) -> list[page.Section]:
    """Ratios of the thesis compared with those of the same kinds of structure here."""
    rows: list[list[str | Cell]] = []
    for name, (time, kind) in _TIMES.items():
        kind_points = [
            p for p in points if _structure(p) == kind and p.ratio is not None
        ]
        for point in kind_points or [None]:
            words = ["not in this sweep", "-", "-", "-"]
            if point is not None:
                words = [
                    point.name,
                    ratio_text(point.ratio),
                    time_text(point.time),
                    error_text(point),
                ]
            theirs = f"{_FULL_VOLUME_MS / time:.2g} ({_FULL_VOLUME_MS:g}/{time:g} ms)"
            rows.append([name, theirs, *words])
    columns = [
        "structure",
        "thesis, times faster",
        "here",
        "times faster",
        "run time",
        "error",
    ]
    processors = {p.processor for p in points if p.processor}
    note = (
        "Times faster than the explicit loop of the full volume of the same voxels; "
        f"here on {', '.join(sorted(processors)) or 'no processor'}, in the thesis on "
        "an NVIDIA 9800 GT. The thesis has no errors; its points are lines in the "
        "chart."
    )
    return [
        page.heading("The thesis' structures"),
        Table(columns, rows, left=(0, 2)),
        page.paragraph(note, note=True),
    ]
