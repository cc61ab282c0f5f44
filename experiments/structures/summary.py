"""The table: one line for each body and structure, over all its loads."""

import statistics
from typing import Any

from rich.console import Console

from jaxthermo.report.numbers import (
    seconds,
    seconds_with_range,
    significant,
    with_range,
)
from jaxthermo.report.table import Table

from ..harness.record import Row
from .config import ComparisonConfig, ExpectConfig


Line = dict[str, Any]


def summarize(rows: list[Row], config: ComparisonConfig) -> list[Line]:
    """Worst errors and median times over the loads, and what was expected."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["body"], row["label"]), []).append(row)
    expected = {entry.label: entry.expect for entry in config.structures}
    lines = []
    for (body, label), group in groups.items():
        good = [row for row in group if "refused" not in row]
        if good:
            line = _line(body, label, good)
            line["expected"] = check(line, good[0], expected.get(label))
        else:
            line = {"body": body, "label": label, "refused": group[0]["refused"]}
        lines.append(line)
    return lines


def _line(body: str, label: str, rows: list[Row]) -> Line:
    first = rows[0]
    middle = lambda name: statistics.median(row[name] for row in rows)
    times = [row["run_time_s"] for row in rows]
    ratios = [row["times_faster"] for row in rows]
    errors = [row["error"] for row in rows]
    frames = [row["frame"] for row in rows]
    return {
        "body": body,
        "label": label,
        "kind": first["kind"],
        "loads": [row["load"] for row in rows],
        **{k: first[k] for k in ("nodes", "links", "held_bytes", "capacity_ratio")},
        "steps": max(row["steps"] for row in rows),
        "build_time_s": first["build_time_s"],
        "setup_time_s": middle("setup_time_s"),
        "compile_time_s": middle("compile_time_s"),
        "run_time_s": _spread(times, "fastest", "slowest"),
        "times_faster": _spread(ratios, "least", "most"),
        "error_percent": {
            row["load"]: row["error"]["worst_rms_percent"] for row in rows
        },
        "worst_rms_percent": max(e["worst_rms_percent"] for e in errors),
        "worst_p99_percent": max(e["worst_p99_percent"] for e in errors),
        "worst_max_percent": max(e["worst_max_percent"] for e in errors),
        "worst_rms_kelvin": max(e["worst_rms_kelvin"] for e in errors),
        "frame_rms_kelvin": max(f["worst_rms_kelvin"] for f in frames),
        "frame_ssim": min(f["worst_ssim"] for f in frames),
        "energy_residual": max(row["energy_residual"] for row in rows),
    }


def _spread(values: list[dict[str, float]], low: str, high: str) -> dict[str, float]:
    """The median of medians, and the ends of all."""
    return {
        "median": statistics.median(value["median"] for value in values),
        low: min(value[low] for value in values),
        high: max(value[high] for value in values),
    }


def check(line: Line, row: Row, expect: ExpectConfig | None) -> list[dict[str, Any]]:
    """Compare a structure with the expectations of the config."""
    if expect is None or expect.body not in (None, line["body"]):
        return []
    share = line["nodes"] / row["structure"]["solid_voxels"]
    found = {
        "error_percent": (line["worst_rms_percent"], "at most"),
        "nodes": (line["nodes"], "at most"),
        "node_share": (share, "at most"),
        "times_faster": (line["times_faster"]["median"], "at least"),
    }
    checks = []
    for name, limit in expect.model_dump(exclude_none=True, exclude={"body"}).items():
        value, way = found[name]
        held = value <= limit if way == "at most" else value >= limit
        checks.append(
            {"what": name, way.replace(" ", "_"): limit, "found": value, "met": held}
        )
    return checks


COLUMNS = ("structure", "nodes", "run", "times faster", "error %")
MORE = ("steps", "p99 %", "max %", "frame K", "SSIM", "capacity")
NAMES = {
    "error_percent": "error %",
    "nodes": "nodes",
    "node_share": "nodes a solid voxel",
    "times_faster": "times faster",
}
WIDE = 140
"""Characters that all columns take."""


def show_table(console: Console, lines: list[Line]) -> None:
    """One table a body, and below it what was expected and not met."""
    # Wide in a file; on a narrow terminal the columns that matter most.
    wide = not console.is_terminal or console.width >= WIDE
    page = console if console.is_terminal else Console(width=WIDE, markup=False)
    for body in dict.fromkeys(line["body"] for line in lines):
        here = [line for line in lines if line["body"] == body]
        title = f"{body}: worst of all loads and saved times; median times"
        columns = COLUMNS + (MORE if wide else ())
        rows = [cells(line, wide) for line in here]
        page.print(Table(columns, rows, title, framed=False).rich())
        for line in here:
            for check in line.get("expected", ()):
                if not check["met"]:
                    page.print(f"not met by {line['label']}: {in_words(check)}")


def cells(line: Line, wide: bool) -> list[str]:
    """A line of the table as text."""
    if "refused" in line:
        return [line["label"], "refused"]
    few = [
        line["label"],
        f"{line['nodes']:,}",
        seconds(line["run_time_s"]["median"]),
        times(line["times_faster"]),
        f"{line['worst_rms_percent']:.3g}",
    ]
    more = [
        str(line["steps"]),
        f"{line['worst_p99_percent']:.3g}",
        f"{line['worst_max_percent']:.3g}",
        f"{line['frame_rms_kelvin']:.2g}",
        f"{line['frame_ssim']:.4f}",
        f"{line['capacity_ratio']:.4g}",
    ]
    return few + more if wide else few


def span(time: dict[str, float]) -> str:
    """A time with its range in one unit: "13 (12-15) ms"."""
    return seconds_with_range(time["median"], time["fastest"], time["slowest"])


def times(ratio: dict[str, float]) -> str:
    """A ratio with its range: "8.1 (7.5-9)"."""
    return with_range(ratio["median"], ratio["least"], ratio["most"])


def in_words(check: dict) -> str:
    """A measured value with its limit: "error % 0.41 (at most 0.3)"."""
    way = "at_most" if "at_most" in check else "at_least"
    name, found, limit = NAMES[check["what"]], check["found"], check[way]
    return f"{name} {significant(found)} ({way.replace('_', ' ')} {significant(limit)})"
