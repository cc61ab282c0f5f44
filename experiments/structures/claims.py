"""The table, a line for each body and structure, and what it says of the thesis."""

import statistics
from itertools import pairwise
from typing import Any

from jaxthermo.cli.console import open_console, print_line
from jaxthermo.report.numbers import seconds, significant, with_range

from ..harness.present import Column, table_of
from ..harness.record import Row
from .config import FULL, LINKS, ComparisonConfig, ExpectConfig, LimbConfig
from .sweeps import ALL
from .truth_lines import TRUTH_COLUMNS, truth_notes, worst_truth


Line = dict[str, Any]
Claim = dict[str, Any]


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
            line["expected"] = _check(line, good[0], expected.get(label))
        else:
            line = {"body": body, "label": label, "refused": group[0]["refused"]}
        lines.append(line)
    return lines


# Errors of a line: the largest over all loads.
_WORST = [f"worst_{e}" for e in ("rms_percent", "p99_percent", "max_percent")]
_WORST += ["worst_rms_kelvin"]


def _line(body: str, label: str, rows: list[Row]) -> Line:
    first = rows[0]
    middle = lambda name: statistics.median(row[name] for row in rows)
    worst = lambda name: max(row["error"][name] for row in rows)
    part = lambda name: [row[name] for row in rows]
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
        "run_time_s": _spread(part("run_time_s")),
        "times_faster": _spread(part("times_faster")),
        "error_percent": {
            row["load"]: row["error"]["worst_rms_percent"] for row in rows
        },
        **{name: worst(name) for name in _WORST},
        "frame_rms_kelvin": max(frame["worst_rms_kelvin"] for frame in part("frame")),
        "frame_ssim": min(frame["worst_ssim"] for frame in part("frame")),
        "energy_residual": max(part("energy_residual")),
        "truth": worst_truth(rows),
    }


def _spread(values: list[dict[str, float]]) -> dict[str, float]:
    # The median of medians, and the ends of all.
    middle, low, high = values[0]
    return {
        middle: statistics.median(value[middle] for value in values),
        low: min(value[low] for value in values),
        high: max(value[high] for value in values),
    }


def _check(line: Line, row: Row, expect: ExpectConfig | None) -> list[dict[str, Any]]:
    # None for a structure, or a body, of which the config expects nothing.
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


_COLUMNS: list[Column] = [
    ("structure", "{label}"),
    ("nodes", "{nodes:,}"),
    ("run", lambda line: seconds(line["run_time_s"]["median"])),
    ("times faster", lambda line: times(line)),
]
_ERROR_COLUMNS: list[Column] = [("error %", "{worst_rms_percent:.3g}")]
_MORE_COLUMNS: list[Column] = [
    ("steps", "{steps}"),
    ("p99 %", "{worst_p99_percent:.3g}"),
    ("max %", "{worst_max_percent:.3g}"),
    ("frame K", "{frame_rms_kelvin:.2g}"),
    ("SSIM", "{frame_ssim:.4f}"),
    ("capacity", "{capacity_ratio:.4g}"),
]
# Characters that all columns take; on a narrower terminal those that matter most.
_WIDTH_OF_ALL = 140
_NAMES = {
    "error_percent": "error %",
    "nodes": "nodes",
    "node_share": "nodes a solid voxel",
    "times_faster": "times faster",
}


def show_table(lines: list[Line]) -> None:
    """Print a table for each body, and what was expected and not met."""
    console = open_console()
    has_truth = any(line.get("truth") for line in lines)
    # The error against finer voxels comes first, in kelvin.
    columns = _COLUMNS + (TRUTH_COLUMNS if has_truth else []) + _ERROR_COLUMNS
    columns += _MORE_COLUMNS if console.width >= _WIDTH_OF_ALL else []
    for body in dict.fromkeys(line["body"] for line in lines):
        here = [line for line in lines if line["body"] == body]
        # The reason was printed with the row.
        short = [{**n, "refused": "refused"} if "refused" in n else n for n in here]
        title = f"{body}: worst of all loads and saved times; median times"
        console.print(table_of(short, columns, title, framed=False).rich())
        for text in truth_notes(here):
            print_line(console, text)
        for line in here:
            for check in line.get("expected", ()):
                if not check["met"]:
                    console.print(f"not met by {line['label']}: {in_words(check)}")


def times(row: Row) -> str:
    """Ratio of run times with its range: "8.1 (7.5-9)"."""
    return with_range(*row["times_faster"].values())


def in_words(check: dict) -> str:
    """A measured value with its limit: "error % 0.41 (at most 0.3)"."""
    way = "at_most" if "at_most" in check else "at_least"
    name, found, limit = _NAMES[check["what"]], check["found"], check[way]
    return f"{name} {significant(found)} ({way.replace('_', ' ')} {significant(limit)})"


# Relative: capacities and means that agree to this are the same.
_KEPT = 1e-6

# Table 6.1: 55 ms of the full volume over 50, 21 and 13 ms.
_THESIS_FASTER = {
    "multi_level": 1.10,
    "irregular_multi_level": 2.62,
    "single_shell": 4.23,
}


def thesis_claims(
    rows: list[Row],
    lines: list[Line],
    swept: list[Row],
    even: list[Row],
    local: list[Row],
    limb: LimbConfig | None,
) -> list[Claim]:
    """Verdicts on the claims for which there are rows."""
    return [
        *_speed_claims(lines),
        *_equilibrium_claim(even),
        *_path_claim(lines),
        *_levels_claim(swept),
        *(_limb_claim(local, limb) if limb else ()),
        *_capacity_claim(rows),
    ]


def _claim(
    name: str, claim: str, holds: bool | None, found: list[str], numbers: list
) -> list[Claim]:
    values = (name, claim, holds, found, numbers)
    keys = ("id", "claim", "holds", "found", "numbers")
    return [dict(zip(keys, values, strict=True))] if numbers else []


def _equilibrium_claim(rows: list[Row]) -> list[Claim]:
    """C11: the mean at the end, against the full volume's."""
    good = [row for row in rows if "refused" not in row]
    full = next((row for row in good if row["label"] == FULL), None)
    if full is None:
        return []
    numbers = [
        {
            "label": row["label"],
            "capacity_ratio": row["capacity_ratio"],
            "mean_off_relative": row["mean_K"] / full["mean_K"] - 1,
            "rise_off_relative": row["rise_K"] / full["rise_K"] - 1,
            "unevenness_relative": row["surface_range_K"] / full["rise_K"],
        }
        for row in good
    ]
    # The same heat in another capacity must end at another mean: those are not judged.
    keeping = [n for n in numbers if abs(n["capacity_ratio"] - 1) < _KEPT]
    worst = max(abs(n["rise_off_relative"]) for n in keeping)
    losing = ", ".join(
        f"{n['label']} {100 * n['rise_off_relative']:+.2g} %"
        for n in numbers
        if n not in keeping
    )
    found = [
        f"rise of the mean off by at most {worst:.1g} of it in the "
        f"{len(keeping)} structures that keep the capacity",
        *([f"in those that do not: {losing}"] if losing else []),
    ]
    claim = "an insulated body ends at the full volume's mean temperature"
    return _claim("C11", claim, worst <= _KEPT, found, numbers)


def _levels_claim(rows: list[Row]) -> list[Claim]:
    """C13: the more levels, the more precise."""
    worst = lambda error: error["worst_rms_percent"]
    numbers = [
        {
            "hollow": row["hollow"],
            "levels": row["levels"],
            "all": row["asked_for"] == ALL,
            "nodes": row["nodes"],
            "capacity_ratio": row["capacity_ratio"],
            "error_percent": worst(row["error"]),
            "from_full_volume_percent": worst(row["from_full_volume_at_the_same_step"]),
        }
        for row in rows
        if "refused" not in row
    ]
    if not numbers:
        return []
    falls, found = True, []
    for hollow in dict.fromkeys(n["hollow"] for n in numbers):
        here = [n for n in numbers if n["hollow"] == hollow]
        words = ", ".join(f"{n['levels']}: {n['error_percent']:.3g} %" for n in here)
        found.append(f"hollow {hollow}, error by levels: {words}")
        ordered = sorted(here, key=lambda n: n["levels"])
        off = [n["from_full_volume_percent"] for n in ordered]
        # With all levels the rest is rounding, which may rise again.
        falls &= all(later <= one + 1e-4 for one, later in pairwise(off))
    whole = max(n["from_full_volume_percent"] for n in numbers if n["all"])
    found.append(f"all levels: {whole:.1g} % from the full volume at the same step")
    claim = "more levels are more precise, up to the full volume"
    return _claim("C13", claim, falls and whole < 1e-3, found, numbers)


def _limb_claim(local: list[Row], limb: LimbConfig) -> list[Claim]:
    """C14: where the levels do not reach the middle, the error is larger."""
    parts = {row["label"]: row["rms_kelvin"] for row in local}
    parts = {name: part for name, part in parts.items() if None not in part.values()}
    found = [
        f"{name}: {part['filled']:.2g} K where the levels fill the body, "
        f"{part['hollow']:.2g} K where they do not"
        for name, part in parts.items()
    ]
    found.insert(0, f"{limb.shape.kind}, {limb.voxels_high} voxels high")
    claim = "holes inside break the multi-level structure (the sleeves)"
    holds = all(part["hollow"] > part["filled"] for part in parts.values())
    return _claim("C14", claim, holds, found, local if parts else [])


def _speed_claims(lines: list[Line]) -> list[Claim]:
    """C07 and C08: how much faster the thesis' structures are, a step and a run."""
    by_label = {(line["body"], line["label"]): line for line in lines}
    numbers, found = [], []
    for line in lines:
        body = line["body"]
        if line.get("kind") not in _THESIS_FASTER or (body, FULL) not in by_label:
            continue
        step = _step_ratio(line, by_label[body, FULL])
        as_links = _step_ratio(line, by_label.get((body, LINKS), {}))
        row = {
            "body": body,
            "label": line["label"],
            "thesis": _THESIS_FASTER[line["kind"]],
            "a_run": line["times_faster"],
            "a_step": step,
            "a_step_of_links": as_links,
            "worst_rms_percent": line["worst_rms_percent"],
        }
        numbers.append(row)
        words = "{a_step_of_links:.2g} a step of the full volume as links"
        links = f", {words.format_map(row)}" if as_links else ""
        text = (
            "{body}, {label} (thesis {thesis:.2g}): {a_run[median]:.2g} "
            "({a_run[least]:.2g} to {a_run[most]:.2g}) a run, {a_step:.2g} a step"
            "{links}; error {worst_rms_percent:.2g} %"
        )
        found.append(text.format_map({**row, "links": links}))
    claim = (
        "multi-level costs about what the full volume does (50 of 55 ms); "
        "irregular is 2.6 and the shell 4.2 times faster"
    )
    return _claim("C07, C08", claim, None, found, numbers)


def _step_ratio(line: Line, full: Line) -> float | None:
    # Time of one step of the full volume over one of the structure.
    if "steps" not in full:
        return None
    step = lambda one: one["run_time_s"]["median"] / one["steps"]
    return step(full) / step(line)


def _path_claim(lines: list[Line]) -> list[Claim]:
    """C12: the longer way round in a shell distorts the transient."""
    numbers, found, in_order = [], [], True
    for body in dict.fromkeys(line["body"] for line in lines):
        # The first of a kind is the thesis' own; others differ in an option.
        errors: dict[str, float] = {}
        for line in lines:
            if line["body"] == body and line.get("kind") in _THESIS_FASTER:
                errors.setdefault(line["kind"], line["worst_rms_percent"])
        if len(errors) < len(_THESIS_FASTER):
            continue
        numbers.append({"body": body, "error_percent": errors})
        words = (f"{k.replace('_', ' ')} {v:.2g} %" for k, v in errors.items())
        found.append(f"{body}: {', '.join(words)}")
        shell, levels = errors["single_shell"], errors["multi_level"]
        in_order &= shell > levels > errors["irregular_multi_level"]
    claim = "the error falls from shell to levels to irregular levels"
    return _claim("C12", claim, in_order, [*found, "with all weights 1"], numbers)


def _capacity_claim(rows: list[Row]) -> list[Claim]:
    """C15: overlap and cracks change the capacity, unless it is kept."""
    # The same under every load: one of them will do.
    unique = {
        (row["body"], row["label"]): {
            "body": row["body"],
            "label": row["label"],
            "keep_capacity": row["structure"]["options"]["keep_capacity"],
            "capacity_ratio": row["capacity_ratio"],
            "share_of_body_volume": row["structure"]["share_of_body_volume"],
        }
        for row in rows
        if "refused" not in row and row["kind"] == "irregular_multi_level"
    }
    numbers = [*unique.values()]
    off = {
        kept: [
            abs(n["capacity_ratio"] - 1) for n in numbers if n["keep_capacity"] == kept
        ]
        for kept in (True, False)
    }
    holds = all(o < _KEPT for o in off[True]) and any(o > _KEPT for o in off[False])
    found = [
        f"{n['body']}, {n['label']}: {n['capacity_ratio']:.4f} of the body's"
        for n in numbers
    ]
    claim = "overlap and cracks between irregular levels change the capacity"
    return _claim("C15", claim, holds, found, numbers)
