"""`report.html` and the files beside it: everything in one page, nothing from afar."""

import json
from dataclasses import dataclass
from pathlib import Path

from jaxthermo.atomic import replacing
from jaxthermo.memory import readable_bytes

from . import page
from .cases import all_cases
from .claims import Claim
from .config import FULL, ComparisonConfig, resolved
from .pictures import write_pictures
from .plots import by_levels, by_thickness, error_against_time, error_over_time
from .record import Row
from .study import Study
from .summary import Line
from .svg import write_chart
from .tables import in_words, seconds, span, times


TITLE = "Structures against the full volume"

COST = [
    "structure", "nodes", "links", "memory", "steps", "build", "setup", "compile",
    "run (fastest-slowest)", "times faster (least-most)",
]  # fmt: skip

ERROR = [
    "structure", "RMS % by load", "p99 %", "max %", "RMS K", "frame RMS K",
    "frame SSIM", "capacity", "energy", "expected",
]  # fmt: skip

DEFINITIONS = (
    "Error: the area-weighted RMS over the surface of the difference from the full "
    "volume at {share:g} of its stable step, over that one's range (max - min) at the "
    "same time, or over 5 % of the run's largest range where that is more; the worst "
    "of the saved times. Every structure is read at the depth of the full volume's "
    "nodes, by the surface map of the config. Each runs at its own largest stable "
    "step. Memory: the arrays of the compiled scene and its state. Setup: all between "
    "the structure and the first step, and what is compiled for it. Run: the compiled "
    "loop with the surface map at the saved times, warm, median of {repeats}; beside "
    "it what the full volume's explicit loop took in the same process over it, with "
    "the ends of what was seen. Frame: the same camera, over the body's pixels; SSIM "
    "with that range as its data range. Capacity: of the nodes, over the body's. "
    "Energy: what the ledger leaves unexplained, over the heat moved."
)


@dataclass(frozen=True, eq=False)
class Findings:
    """All that was measured."""

    studies: list[Study]
    limb: Study | None
    rows: list[Row]
    limb_rows: list[Row]
    level_rows: list[Row]
    equilibrium_rows: list[Row]
    local: list[Row]
    lines: list[Line]
    claims: list[Claim]


def write_report(findings: Findings, folder: Path, host: str) -> list[str]:
    """Charts, pictures and the page; returns the names of all files."""
    config = findings.studies[0].config
    about = DEFINITIONS.format(share=config.reference_step, repeats=config.repeats)
    high = f"{config.voxels_high} voxels high, {host}"
    sections = [page.paragraph(high), page.paragraph(about, note=True)]
    files: list[Path] = []
    for study in findings.studies:
        sections += _body(findings, study, folder, files)
    sections += _claims(findings, folder, files)
    sections.append(page.details("All rows", _all_rows(findings)))
    plain = json.dumps(resolved(config), indent=2)
    sections.append(page.details("The config, in SI units", page.pre(plain)))
    with replacing(folder / "report.html") as path:
        path.write_text(page.document(TITLE, sections), encoding="utf-8")
    return [*(path.name for path in files), "report.html"]


def _body(
    findings: Findings, study: Study, folder: Path, files: list[Path]
) -> list[str]:
    """The table, the charts and the pictures of one body."""
    name, load = study.body.name, study.config.picture.load
    rows = [r for r in findings.rows if r["body"] == name and "refused" not in r]
    lines = [line for line in findings.lines if line["body"] == name]
    made = [
        page.heading(name),
        page.table(COST, [_cost(line) for line in lines]),
        page.table(ERROR, [_error(line) for line in lines]),
    ]
    made += [page.paragraph(text, note=True) for text in _full(rows)]
    if not rows:
        return made
    shown = [row for row in rows if row["load"] == load]
    everyone = labels(study.config)
    charts = {
        f"error_against_time_{name}": error_against_time(
            rows, everyone, f"{name}: error against run time"
        ),
        f"error_over_time_{name}": error_over_time(
            shown, everyone, f"{name}: error over time, sun on {load}"
        ),
    }
    for file, chart in charts.items():
        made.append(write_chart(chart, folder / file))
        files += [folder / f"{file}.svg", folder / f"{file}.png"]
    for path in write_pictures(study, rows, folder):
        made.append(page.picture(path, path.stem))
        files.append(path)
    return made


def labels(config: ComparisonConfig) -> list[str]:
    """Of all structures, in their order."""
    return [case.label for case in all_cases(config)]


def _full(rows: list[Row]) -> list[str]:
    """The rate of the loop that all are compared with."""
    return [
        f"Full volume, sun on {row['load']}: {row['steps']} steps in "
        f"{seconds(row['run_time_s']['median'])}, "
        f"{row['lattice_voxels_per_s'] / 1e9:.3g} billion lattice voxels a second."
        for row in rows
        if row["label"] == FULL
    ]


def _cost(line: Line) -> list[str]:
    if "refused" in line:
        return [line["label"], page.spanning(line["refused"], len(COST) - 1)]
    return [
        line["label"],
        f"{line['nodes']:,}",
        f"{line['links']:,}",
        readable_bytes(line["held_bytes"]),
        str(line["steps"]),
        seconds(line["build_time_s"]),
        seconds(line["setup_time_s"]),
        seconds(line["compile_time_s"]),
        span(line["run_time_s"]),
        times(line["times_faster"]),
    ]


def _error(line: Line) -> list[str]:
    if "refused" in line:
        return [line["label"], page.spanning(line["refused"], len(ERROR) - 1)]
    return [
        line["label"],
        ", ".join(f"{k}: {v:.3g}" for k, v in line["error_percent"].items()),
        f"{line['worst_p99_percent']:.3g}",
        f"{line['worst_max_percent']:.3g}",
        f"{line['worst_rms_kelvin']:.3g}",
        f"{line['frame_rms_kelvin']:.3g}",
        f"{line['frame_ssim']:.4f}",
        f"{line['capacity_ratio']:.5g}",
        f"{line['energy_residual']:.0e}",
        page.verdicts([(in_words(c), c["met"]) for c in line["expected"]]),
    ]


def _claims(findings: Findings, folder: Path, files: list[Path]) -> list[str]:
    """What the thesis says, what was found, and the charts that show it."""
    config = findings.studies[0].config
    words = {True: "yes", False: "no", None: "reported"}
    rows = [
        [
            claim["id"],
            page.prose([claim["claim"]]),
            page.marked(words[claim["holds"]], claim["holds"]),
            page.prose(claim["found"]),
        ]
        for claim in findings.claims
    ]
    made = []
    if rows:
        columns = ["", "claim", "found so", "measured"]
        made = [page.heading("Claims of the thesis"), page.table(columns, rows, True)]
    charts = {}
    if any("refused" not in row for row in findings.level_rows):
        charts["error_by_levels"] = by_levels(findings.level_rows)
    if findings.local:
        everyone = [*labels(config), *(row["label"] for row in findings.local)]
        charts["error_by_thickness"] = by_thickness(findings.local, everyone)
    for file, chart in charts.items():
        made.append(write_chart(chart, folder / file))
        files += [folder / f"{file}.svg", folder / f"{file}.png"]
    good = [row for row in findings.limb_rows if "refused" not in row]
    if findings.limb is not None and good:
        # A name of its own: the body may be one of those that are compared.
        for path in write_pictures(findings.limb, good, folder, "limb_"):
            made.append(page.picture(path, path.stem))
            files.append(path)
    return made


def _all_rows(findings: Findings) -> str:
    columns = [
        "body", "load", "structure", "nodes", "steps", "run", "times faster", "RMS %",
        "RMS % at each time", "RMS K at each time", "frame K at each time",
        "SSIM at each time",
    ]  # fmt: skip
    several = lambda values: ", ".join(f"{v:.3g}" for v in values)
    rows = []
    for row in (*findings.rows, *findings.limb_rows):
        names = [row["body"], row["load"], row["label"]]
        if "refused" in row:
            rows.append([*names, page.spanning(row["refused"], len(columns) - 3)])
            continue
        error, frame = row["error"], row["frame"]
        rows.append(
            [
                *names,
                f"{row['nodes']:,}",
                str(row["steps"]),
                seconds(row["run_time_s"]["median"]),
                times(row["times_faster"]),
                f"{error['worst_rms_percent']:.4g}",
                several(error["rms_percent"]),
                several(error["rms_kelvin"]),
                several(frame["rms_kelvin"]),
                ", ".join(f"{v:.4f}" for v in frame["ssim"]),
            ]
        )
    return page.table(columns, rows)
