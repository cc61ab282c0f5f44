"""A measured quantity and that of a named peer, in the form that all benchmarks share.

Values of the same index were measured in turn, so that a ratio is one of two values
that saw the same state of the machine.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, cast

from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.numbers import count, with_range
from jaxthermo.report.table import Cell, Table
from jaxthermo.report.templates import Html
from jaxthermo.timing import Spread, ratio_of


# Units of times, with the shortest median [s] that each is used for; then ns.
_SCALES = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6))
_FACTORS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def time_unit(seconds: float) -> tuple[str, float]:
    """The unit that fits a time [s], and how many of it a second has."""
    # A difference of times may be negative.
    units = (name for name, shortest in _SCALES if abs(seconds) >= shortest)
    unit = next(units, "ns")
    return unit, _FACTORS[unit]


CsvRow = dict[str, str | float | bool | None]
"""A line of the CSV file, by its columns."""


class _Shown(NamedTuple):
    """A measurement as a table has it."""

    unit: str
    ours: str
    """Median and range."""
    peer: str
    """Median and range of the peer; empty without one."""


class _PlainMeasurement(TypedDict):
    """The fields of a measurement, as `result.json` has them."""

    name: str
    unit: str
    ours: list[float]
    peer_name: str
    peer: list[float]
    bound: float | None
    overhead: bool
    note: str


class MeasuredResult(TypedDict):
    """Measurements of a benchmark, in its result."""

    measurements: list[_PlainMeasurement]


@dataclass(frozen=True)
class Measurement:
    """A measured cost (lower is better): its samples, a peer, a required bound."""

    name: str
    unit: str
    """Unit of the values; times in "s" are shown in the one that fits them."""
    ours: Sequence[float]
    """Every repeat."""
    peer_name: str = ""
    """Name of what it is compared with; empty if with nothing."""
    peer: Sequence[float] = ()
    """As many as of ours, or one for all of them."""
    bound: float | None = None
    """Smallest speed relative to the peer; else largest overhead, or largest value."""
    overhead: bool = False
    """The ratio is ours over the peer's, as of a cost; otherwise how many times as fast
    as the peer ours is."""
    note: str = ""

    @property
    def ratio(self) -> Spread | None:
        """Ratio to the peer; None without one."""
        if not len(self.peer):
            return None
        if self.overhead:
            return ratio_of(self.ours, self.peer)
        return ratio_of(self.peer, self.ours)

    @property
    def met(self) -> bool | None:
        """True if the median keeps the bound; None if there is none."""
        if self.bound is None:
            return None
        if self.ratio is None:
            return Spread.of(self.ours).median <= self.bound
        ratio = self.ratio.median
        return ratio <= self.bound if self.overhead else ratio >= self.bound

    @property
    def asked(self) -> str:
        """The bound in words; empty if there is none."""
        if self.bound is None:
            return ""
        is_speed = self.ratio is not None and not self.overhead
        return f"{'at least' if is_speed else 'at most'} {self.bound:g}"

    @property
    def ratio_text(self) -> str:
        """The ratio with its range and meaning; empty without a peer."""
        if self.ratio is None:
            return ""
        cost = "x the time" if self.unit == "s" else "x as much"
        return f"{with_range(*self.ratio)} {cost if self.overhead else 'x as fast'}"

    @property
    def shown(self) -> _Shown:
        """Unit, and the values of both with their ranges, for a table."""
        unit = self.unit
        factor = 1.0
        if unit == "s":
            unit, factor = time_unit(Spread.of(self.ours).median)

        def text(samples: Sequence[float]) -> str:
            return with_range(*(factor * value for value in Spread.of(samples)))

        peer = text(self.peer) if len(self.peer) else ""
        return _Shown(unit=unit, ours=text(self.ours), peer=peer)

    def as_dict(self) -> _PlainMeasurement:
        """Plain values, for `result.json`; the constructor takes them again."""
        return cast("_PlainMeasurement", asdict(self))

    def as_row(self) -> CsvRow:
        """A summary, for a line of a CSV file."""
        has_peer = len(self.peer) > 0
        direction = "ours / peer" if self.overhead else "peer / ours"
        peer = Spread.of(self.peer) if has_peer else None
        return {
            "name": self.name,
            "unit": self.unit,
            **spread_columns("ours", Spread.of(self.ours)),
            "peer": self.peer_name,
            **spread_columns("peer", peer),
            **spread_columns("ratio", self.ratio),
            "ratio_of": direction if has_peer else "",
            "asked": self.asked,
            "met": self.met,
            "note": self.note,
        }


def spread_columns(name: str, spread: Spread | None) -> CsvRow:
    """Columns of a median and its range; empty ones without them."""
    return {
        f"{name}_{field}": None if spread is None else getattr(spread, field)
        for field in Spread._fields
    }


def compared(
    name: str,
    ours: Sequence[float],
    peers: Mapping[str, Sequence[float]],
    bound: float | None = None,
    overhead: bool = False,
    note: str = "",
) -> list[Measurement]:
    """Times [s] compared with those of each peer, by the peer's name."""
    return [
        Measurement(
            name=name,
            unit="s",
            ours=ours,
            peer_name=peer_name,
            peer=peer,
            bound=bound,
            overhead=overhead,
            note=note,
        )
        for peer_name, peer in peers.items()
    ]


def plain_rows(rows: Iterable[Measurement]) -> list[_PlainMeasurement]:
    """Measurements for the result of a benchmark, under the key "measurements"."""
    return [row.as_dict() for row in rows]


_PAGE = "report.html"
_CSV = "measurements.csv"

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


def summary(benchmarks: Sequence[Finished]) -> str:
    """Number of bounds met, names of the others, and of benchmarks without rows."""
    asked = [
        (f"{benchmark.name}: {row.name}", row.met)
        for benchmark in benchmarks
        for row in benchmark.rows
        if row.met is not None
    ]
    missed = [name for name, met in asked if not met]
    failed = [benchmark.name for benchmark in benchmarks if benchmark.error]
    text = "no bound is asked"
    if asked:
        text = f"{len(asked) - len(missed)} of {count(len(asked), 'bound')} met"
    if missed:
        text += f"; missed: {', '.join(missed)}"
    return f"{text}; without a result: {', '.join(failed)}" if failed else text


def table(benchmarks: Sequence[Finished]) -> Table:
    """A line for each measurement, below a line for each benchmark."""
    lines: list[list[str | Cell]] = []
    width = len(_COLUMNS)
    for benchmark in benchmarks:
        heading = _heading(benchmark)
        lines.append([Cell(heading, wraps=True, columns=width, is_heading=True)])
        if benchmark.error:
            error = Cell(benchmark.error, met=False, wraps=True, columns=width)
            lines.append([error])
        lines += [_line(row) for row in benchmark.rows]
    return Table(_COLUMNS, lines, left=_LEFT)


def _heading(benchmark: Finished) -> str:
    took = f"; took {benchmark.took_s:.0f} s" if benchmark.took_s else ""
    return f"{benchmark.name}: {benchmark.about}\n{benchmark.command}{took}"


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
    for benchmark in benchmarks:
        for name, caption in benchmark.charts:
            chart = benchmark.folder / f"{name}.svg"
            if chart.is_file():
                sections += [page.heading(caption), Html(chart.read_text("utf-8"))]
    page.write_page(folder / _PAGE, title, sections)
    _write_csv(folder / _CSV, benchmarks)
    return [_PAGE, _CSV]


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


def plain_table(benchmarks: Sequence[Finished]) -> list[CsvRow]:
    """A mapping for each measurement, and one for each benchmark without any."""
    rows: list[CsvRow] = []
    for benchmark in benchmarks:
        names: CsvRow = {"benchmark": benchmark.name, "command": benchmark.command}
        rows += [{**names, **row.as_row()} for row in benchmark.rows]
        if benchmark.error:
            rows.append({**names, "error": benchmark.error})
    return rows
