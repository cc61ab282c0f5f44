"""`report.html` of a front, with its charts and its table as files.

It compares run times with those of the thesis, which has times of one run but no
errors: on its graphics card of 2010 the full volume took 55 ms, the shell 13, the
irregular levels 21 and ten levels 50 ms.
"""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict
from urllib.parse import quote

from calibrate.study.front import MEASURES, Cost, Measure, Point, front
from calibrate.study.front_charts import Marks, error_against, numbered, tooltips
from calibrate.study.wording import error_text, ratio_text, sentence, time_text
from jaxthermo.atomic import replacing
from jaxthermo.host_memory import readable_bytes
from jaxthermo.report import page
from jaxthermo.report.chart import write_chart
from jaxthermo.report.numbers import seconds, significant
from jaxthermo.report.table import Cell, Table, prose
from jaxthermo.timing import Spread

from ..harness.measurement import spread_columns
from ..thesis.table_6_1 import FULL, KINDS, TABLE_TIMES
from .comparisons import Comparison, PlainComparison
from .rivals import SweepFolder


_DEFINITIONS = [
    (
        "error",
        "RMS over points spread evenly over the mesh of the difference in surface "
        "temperature from the reference, in kelvin and in percent of the reference's "
        "range (0.5 to 99.5 %) at that time; the largest of the saved times and loads",
    ),
    (
        "run time",
        "the compiled loop with the surface read at the saved times: median of the "
        "repeats after a warm-up, one case after the other; the largest of the loads. "
        "In parentheses the fastest and the slowest",
    ),
    (
        "times faster",
        "the time of the rival over that of the choice, measured alternately in one "
        "process on the named processor: median, lowest and highest",
    ),
    (
        "front",
        "choices that no other one beats in both error and cost; the numbers in the "
        "first chart are those of the list, each further chart has its own front. "
        "Grey: beaten choices",
    ),
    (
        "rivals",
        "full volumes of the same kind of voxels and open areas, by solvers written "
        "by hand: each is run at several pitches and numbers of steps",
    ),
    (
        "reduced model",
        "a choice by a few vectors, for the patterns of one load: its run time is that "
        "of the model alone; the preparation is stated apart",
    ),
]


_TITLES: dict[Measure, str] = {
    "rms_kelvin": "Error in kelvin",
    "p99_percent": "Error that 99 % of the surface stays below",
    "p99_kelvin": "Error that 99 % of the surface stays below, in kelvin,",
}


class _FrontPoint(TypedDict):
    """A choice of a front in `result.json`."""

    sentence: str
    choice: dict[str, str]
    errors: dict[Measure, float]
    loop_s: dict[str, float] | None
    full_volume_times_faster: dict[str, float] | None
    nodes: int
    memory_bytes: int


class FrontResult(TypedDict):
    """A front and its rivals in `result.json`."""

    front: list[_FrontPoint]
    comparisons: list[PlainComparison]
    remarks: list[str]
    processors: list[str]
    files: list[str]


def plain_spread(spread: Spread | None) -> dict[str, float] | None:
    """Values of a spread by their names."""
    return None if spread is None else spread._asdict()


@dataclass(frozen=True)
class Findings:
    """Content of a report."""

    title: str
    about: list[str]
    """Sentences below the title."""
    folder: SweepFolder
    points: list[Point]
    rivals: list[Point]
    comparisons: list[Comparison]
    config: Mapping[str, object]

    @property
    def processors(self) -> list[str]:
        """Names of the processors of all times."""
        all_points = (*self.points, *self.rivals)
        return list(dict.fromkeys(p.processor for p in all_points if p.processor))

    @property
    def best(self) -> list[Point]:
        """The front by error and run time, the fastest first."""
        return front(self.points)


def write_report(findings: Findings, out: Path) -> list[str]:
    """Write page, charts and table into a folder; return the names of the files."""
    all_points = [*findings.points, *findings.rivals]
    files: list[str] = []

    def chart(
        name: str, cost: Cost, error: Measure, title: str, marks: Marks = ()
    ) -> list[page.Section]:
        drawn = error_against(
            cost,
            points=findings.points,
            rivals=findings.rivals,
            error=error,
            title=title,
            marks=marks,
        )
        if drawn is None:
            return []
        files.extend([f"{name}.svg", f"{name}.png"])
        return [numbered(write_chart(drawn, out / name), all_points)]

    sections: list[page.Section] = [*findings.about]
    if findings.processors:
        sections.append(f"Processor of all times: {'; '.join(findings.processors)}.")
    sections.append(page.terms(_DEFINITIONS))
    sections += [page.heading("Error against run time")]
    sections += chart(
        "error_against_time",
        cost="time_s",
        error="rms_percent",
        title="Error against run time",
        marks=_thesis_marks(findings.points),
    )
    sections += _front_sections(findings)
    sections += _rival_sections(findings)
    sections += [page.heading("Error against memory and nodes")]
    names: list[tuple[Cost, str]] = [("memory_bytes", "memory"), ("nodes", "nodes")]
    for cost, name in names:
        title = f"Error against {name}"
        sections += chart(
            f"error_against_{name}", cost=cost, error="rms_percent", title=title
        )
    sections += [page.heading("Other measures of the error")]
    for error in MEASURES[1:]:
        title = f"{_TITLES[error]} against run time"
        sections += chart(
            f"{error}_against_time", cost="time_s", error=error, title=title
        )
    sections += _thesis_table(findings.points)
    sections += _all_sections(findings)
    sections.append(tooltips(all_points, findings.folder.path))
    page.write_page(out / "report.html", findings.title, sections)
    _write_csv(out / "front.csv", findings)
    return [*files, "front.csv", "report.html"]


def write_contents(path: Path, title: str, fronts: Mapping[str, FrontResult]) -> None:
    """Write a page with a link to the page of each of several fronts, by name."""
    cards = []
    for name, front_result in fronts.items():
        link = next(
            file for file in front_result["files"] if file.endswith("report.html")
        )
        lines = [point["sentence"] for point in front_result["front"]]
        cards.append(page.Card(name, quote(link), lines))
    about = (
        "The choices of this sweep solve several problems, each with a reference, a "
        "front and rivals of its own."
    )
    page.write_page(path, title, [about, page.cards(cards)])


def _front_sections(findings: Findings) -> list[page.Section]:
    best = findings.best
    if not best:
        return [page.paragraph("No choice was timed: there is no front.", note=True)]
    columns = ["", "choice", "full volume's explicit loop, times faster"]
    rows = [
        [str(n), prose(sentence(p)), Cell(ratio_text(p.ratio), is_number=True)]
        for n, p in enumerate(best, 1)
    ]
    return [page.heading("The front, in words", 3), Table(columns, rows, left=(0, 1))]


def _rival_sections(findings: Findings) -> list[page.Section]:
    if not findings.rivals and not findings.comparisons:
        return []
    sections: list[page.Section] = [page.heading("Rivals at the same error")]
    rows = [
        [
            f"{significant(comparison.pair.tolerance)} %",
            prose(comparison.pair.choice.name, error_text(comparison.pair.choice)),
            prose(comparison.pair.rival.name, error_text(comparison.pair.rival)),
            Cell(time_text(comparison.choice_time), is_number=True),
            Cell(time_text(comparison.rival_time), is_number=True),
            Cell(ratio_text(comparison.ratio), is_number=True),
        ]
        for comparison in findings.comparisons
    ]
    columns = ["error up to", "choice", "rival", "choice", "rival", "times faster"]
    if rows:
        sections.append(Table(columns, rows, left=range(3)))
        sections.append(
            page.paragraph(
                "The rival is the fastest of its kind within the error, at any pitch "
                "and number of steps; the ratio is that of the load where it is "
                "smallest.",
                note=True,
            )
        )
    sections.append(_listed("All runs of rivals and reduced models", findings.rivals))
    return sections


_COLUMNS = (
    "choice",
    "RMS %",
    "RMS K",
    "99th percentile %",
    "99th percentile K",
    "run time",
    "full volume, times faster",
    "call",
    "set-up, geometry known",
    "compile",
    "steps",
    "nodes",
    "memory",
)


def _cells(point: Point) -> list[str | Cell]:
    set_up = _duration(point.known_set_up_s)
    if point.offline_s is not None:
        set_up = f"{_duration(point.offline_s)} offline"
    return [
        point.name,
        *(significant(point.errors[measure]) for measure in MEASURES),
        time_text(point.time),
        ratio_text(point.ratio),
        _duration(point.call_s),
        set_up,
        _duration(point.compile_s),
        "-" if point.steps is None else f"{point.steps:,}",
        f"{point.nodes:,}",
        readable_bytes(point.memory_bytes),
    ]


def _duration(value: float | None) -> str:
    return "-" if value is None else seconds(value)


def _by_time(points: Sequence[Point]) -> list[Point]:
    return sorted(points, key=lambda p: (p.time_s is None, p.time_s or 0.0))


def _listed(title: str, points: Sequence[Point]) -> page.Section:
    """All points, folded."""
    return page.details(title, Table(_COLUMNS, [_cells(p) for p in _by_time(points)]))


def _all_sections(findings: Findings) -> list[page.Section]:
    sections: list[page.Section] = [
        page.heading("All rows"),
        _listed(f"All {len(findings.points)} choices", findings.points),
    ]
    if failed := findings.folder.failed:
        rows = []
        for row in failed:
            choice = ", ".join(map(str, row["choice"].values()))
            rows.append([choice, row["load"], row["failed"]])
        table = Table(["choice", "load", "reason"], rows, left=range(3))
        sections.append(
            page.details(f"{len(failed)} cases that could not be run", table)
        )
    plain = json.dumps(findings.config, indent=2, default=str)
    sections.append(page.details("The config, in SI units", page.pre(plain)))
    return sections


def _write_csv(path: Path, findings: Findings) -> None:
    """Write a line for each choice and each rival, with SI units in the names."""
    best = findings.best
    text = io.StringIO()
    rows = [
        _csv_row(point, on_front=point in best, is_rival=False)
        for point in _by_time(findings.points)
    ]
    rows += [
        _csv_row(point, on_front=False, is_rival=True)
        for point in _by_time(findings.rivals)
    ]
    axes = list(dict.fromkeys(key for row in rows for key in row))
    writer = csv.DictWriter(text, axes, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with replacing(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _csv_row(point: Point, on_front: bool, is_rival: bool) -> dict[str, object]:
    return {
        "name": point.name,
        "is_rival": is_rival,
        "on_front": on_front,
        **point.errors,
        "own_error_percent": point.own_error_percent,
        **spread_columns("loop_s", point.time),
        **spread_columns("full_volume_times_faster", point.ratio),
        "call_s": point.call_s,
        "known_set_up_s": point.known_set_up_s,
        "compile_s": point.compile_s,
        "offline_s": point.offline_s,
        "steps": point.steps,
        "nodes": point.nodes,
        "memory_bytes": point.memory_bytes,
        "processor": point.processor,
        **{f"axis {name}": label for name, label in point.choice.items()},
    }


# Kinds of structures that are compared with the full volume, with the thesis' names.
_KINDS = {kind: name for name, kind in KINDS.items() if name != FULL}
_FULL_MS = 1e3 * TABLE_TIMES[FULL]


def _full_time(points: Sequence[Point]) -> float | None:
    """Time of the slowest explicit loop of a full volume that was timed [s]."""
    times = [
        p.time.median * p.ratio.median
        for p in points
        if p.time is not None and p.ratio is not None and _structure(p) in _KINDS
    ]
    return max(times, default=None)


def _structure(point: Point) -> str | None:
    """The kind of structure that a choice sets."""
    for key, value in (point.set or {}).items():
        if key.endswith("structure"):
            return value["kind"] if isinstance(value, dict) else str(value)
        if key.endswith("structure.kind"):
            return str(value)
    return None


def _thesis_marks(points: Sequence[Point]) -> Marks:
    """Times of the thesis' ratios for our full volume [s]."""
    full = _full_time(points)
    if full is None:
        return ()
    marks = []
    for name in _KINDS.values():
        time = 1e3 * TABLE_TIMES[name]
        words = f"thesis: {name} {time:g}/{_FULL_MS:g}"
        marks.append((words, full * time / _FULL_MS))
    return marks


def _thesis_table(points: Sequence[Point]) -> list[page.Section]:
    """Ratios of the thesis compared with those of the same kinds of structure here."""
    rows: list[list[str | Cell]] = []
    for kind, name in _KINDS.items():
        time = 1e3 * TABLE_TIMES[name]
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
            theirs = f"{_FULL_MS / time:.2g} ({_FULL_MS:g}/{time:g} ms)"
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
