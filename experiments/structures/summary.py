"""The table: one line a body and structure, over all its loads."""

import statistics
from typing import Any

from .config import ComparisonConfig, ExpectConfig
from .record import Row


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


def _spread(values: list[dict[str, float]], least: str, most: str) -> dict[str, float]:
    """The median of medians, and the ends of all."""
    return {
        "median": statistics.median(value["median"] for value in values),
        least: min(value[least] for value in values),
        most: max(value[most] for value in values),
    }


def check(line: Line, row: Row, expect: ExpectConfig | None) -> list[dict[str, Any]]:
    """What the config expects of a structure: limit, what was found, and whether.

    Args:
        line: the structure's summary.
        row: any of its rows.
        expect: of the config.
    """
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
