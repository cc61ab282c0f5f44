"""Measurements of several benchmarks as one table, one page and one CSV file."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.numbers import count
from jaxthermo.report.table import Cell, Table
from jaxthermo.report.templates import Html

from .measurement import Measurement, measurement_of


PAGE, CSV = "report.html", "measurements.csv"

_COLUMNS = (
    *("quantity", "unit", "jaxthermo", "peer", "peer's", "ratio"),
    *("asked", "verdict"),
)
_LEFT = (0, 1, 3, 6, 7)
_NONE = "\N{EN DASH}"

_INTRODUCTION = (
    "Medians, with the lowest and the highest value in brackets; less is better. A "
    "peer is measured in the same run, in turn with ours, and a ratio is that of such "
    'pairs: with "x as fast" its time over ours, with "x the time" ours over its. A '
    "bound is kept by the median of the ratios."
)


@dataclass(frozen=True)
class Finished:
    """A benchmark that has ended, with its rows or with the reason for none."""

    name: str
    about: str
    folder: Path
    """Folder of its charts."""
    command: str
    """Measures it alone."""
    rows: tuple[Measurement, ...] = ()
    error: str = ""
    charts: tuple[tuple[str, str], ...] = ()
    """Name and title of each SVG file in the folder."""
    took_s: float = 0.0


def finished(
    name: str, about: str, folder: Path, command: str, result: Mapping[str, Any]
) -> Finished:
    """A benchmark that has ended with a result, the whole of its `result.json`."""
    body = result["result"]
    rows = tuple(measurement_of(row) for row in body.get("measurements", ()))
    error = "" if rows else "no measurement in the form of this table: see result.json"
    charts = tuple(body.get("charts", {}).items())
    took = float(result.get("took_s", 0.0))
    return Finished(
        name=name,
        about=about,
        folder=folder,
        command=command,
        rows=rows,
        error=error,
        charts=charts,
        took_s=took,
    )


def summary(benchmarks: Sequence[Finished]) -> str:
    """Number of bounds met, names of the others, and of benchmarks without rows."""
    asked = [
        (f"{each.name}: {row.name}", row.met)
        for each in benchmarks
        for row in each.rows
        if row.met is not None
    ]
    missed = [name for name, met in asked if not met]
    failed = [each.name for each in benchmarks if each.error]
    text = "no bound is asked"
    if asked:
        text = f"{len(asked) - len(missed)} of {count(len(asked), 'bound')} met"
    if missed:
        text += f"; missed: {', '.join(missed)}"
    return f"{text}; without a result: {', '.join(failed)}" if failed else text


def table(benchmarks: Sequence[Finished]) -> Table:
    """A line for each measurement, below a line for each benchmark."""
    lines: list[list[str | Cell]] = []
    for each in benchmarks:
        whole = {"wraps": True, "columns": len(_COLUMNS)}
        lines.append([Cell(_heading(each), is_heading=True, **whole)])
        if each.error:
            lines.append([Cell(each.error, False, **whole)])
        lines += [_line(row) for row in each.rows]
    return Table(_COLUMNS, lines, left=_LEFT)


def _heading(each: Finished) -> str:
    took = f"; took {each.took_s:.0f} s" if each.took_s else ""
    return f"{each.name}: {each.about}\n{each.command}{took}"


def _line(row: Measurement) -> list[str | Cell]:
    unit, ours, theirs = row.shown
    name = f"{row.name}\n{row.note}" if row.note else row.name
    verdict = {True: "met", False: "missed", None: ""}[row.met]
    peer = Cell(row.peer_name or _NONE, wraps=True)
    return [
        Cell(name, wraps=True),
        unit,
        ours,
        peer,
        theirs,
        row.ratio_text,
        row.asked,
        Cell(verdict, row.met),
    ]


def write(
    folder: Path,
    title: str,
    benchmarks: Sequence[Finished],
    origin: Mapping[str, Any],
) -> list[str]:
    """Write the page and the CSV file; return their names.

    Args:
        folder: of both files.
        title: of the page.
        benchmarks: in the order of the page.
        origin: processor, versions, commit and date, as of `provenance`.
    """
    sections: list[page.Section] = [
        page.terms(_origin(origin)),
        f"{summary(benchmarks)}.",
        _INTRODUCTION,
        table(benchmarks),
    ]
    for each in benchmarks:
        for name, caption in each.charts:
            chart = each.folder / f"{name}.svg"
            if chart.is_file():
                sections += [page.heading(caption), Html(chart.read_text("utf-8"))]
    page.write_page(folder / PAGE, title, sections)
    _write_csv(folder / CSV, benchmarks)
    return [PAGE, CSV]


def _origin(origin: Mapping[str, Any]) -> list[tuple[str, str]]:
    versions = ", ".join(f"{k} {v}" for k, v in origin["versions"].items())
    return [
        ("processor", origin["processor"]),
        ("device", origin["device"]),
        ("versions", versions),
        ("commit", origin.get("commit", "none: not a git checkout")),
        ("date", origin["date"]),
    ]


def _write_csv(path: Path, benchmarks: Sequence[Finished]) -> None:
    rows = plain_table(benchmarks)
    names = list(dict.fromkeys(name for row in rows for name in row))
    with replacing(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def plain_table(benchmarks: Sequence[Finished]) -> list[dict[str, Any]]:
    """A mapping for each measurement, and one for each benchmark without any."""
    rows = []
    for each in benchmarks:
        own = {"benchmark": each.name, "command": each.command}
        rows += [{**own, **row.as_row()} for row in each.rows]
        if each.error:
            rows.append({**own, "error": each.error})
    return rows
