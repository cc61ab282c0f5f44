"""`report.html` and the files beside it: everything in one page, nothing from afar."""

import json
from dataclasses import dataclass
from pathlib import Path

from jaxthermo.arrays import readable_bytes
from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.chart import write_chart
from jaxthermo.report.numbers import seconds
from jaxthermo.report.table import Cell, Table, prose

from ..harness.record import Row
from .cases import all_cases
from .charts import (
    Paint,
    by_levels,
    by_thickness,
    colours,
    error_against_time,
    error_over_time,
)
from .claims import Claim
from .config import FULL, resolved
from .measure import LONG
from .pictures import write_pictures
from .study import Study
from .summary import Line, in_words, span, times


TITLE = "Structures against the full volume"

COST = [
    "structure", "nodes", "links", "memory", "steps", "build", "setup", "compile",
    "run (fastest-slowest)", "times faster (least-most)",
]  # fmt: skip

ERROR = [
    "structure", "RMS % by load", "p99 %", "max %", "RMS K", "frame RMS K",
    "frame SSIM", "capacity", "energy",
]  # fmt: skip

DEFINITIONS = (
    (
        "error",
        "the area-weighted RMS over the surface of the difference from the full volume "
        "at {share:g} of its stable step, over that one's range (max - min) at the "
        "same time, or over 5 % of the run's largest range where that is more; the "
        "worst of the saved times. Every structure is read at the depth of the full "
        "volume's nodes, by the surface map of the config",
    ),
    ("steps", "each structure runs at its own largest stable step"),
    ("memory", "the arrays of the compiled scene and its state"),
    (
        "setup",
        "all between the structure and the first step, and what is compiled for it",
    ),
    (
        "run",
        "the compiled loop with the surface map at the saved times: the median of "
        "{repeats} warm runs, or of as many as {long:g} s hold and the first, two at "
        "least",
    ),
    (
        "times faster",
        "what the full volume's explicit loop took in the same process over the run, "
        "with the ends of what was seen",
    ),
    (
        "frame",
        "the same camera, over the body's pixels; SSIM with the error's range as its "
        "data range",
    ),
    ("capacity", "of the nodes, over the body's"),
    ("energy", "what the ledger leaves unexplained, over the heat moved"),
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
    words = {"share": config.reference_step, "repeats": config.repeats, "long": LONG}
    about = [(name, text.format(**words)) for name, text in DEFINITIONS]
    high = f"{config.voxels_high} voxels high, {host}"
    sections = [page.paragraph(high), page.terms(about)]
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
) -> list[page.Section]:
    """The table, the charts and the pictures of one body."""
    name, load = study.body.name, study.config.picture.load
    rows = [r for r in findings.rows if r["body"] == name and "refused" not in r]
    lines = [line for line in findings.lines if line["body"] == name]
    made: list[page.Section] = [
        page.heading(name),
        Table(COST, [_cost(line) for line in lines]),
        Table(ERROR, [_error(line) for line in lines]),
        *_expected(lines),
        page.paragraph(_full(rows), note=True),
    ]
    if not rows:
        return made
    shown = [row for row in rows if row["load"] == load]
    paint = _paint(findings)
    charts = {
        f"error_against_time_{name}": error_against_time(
            rows, paint, f"{name}: error against run time"
        ),
        f"error_over_time_{name}": error_over_time(
            shown, paint, f"{name}: error over time, sun on {load}"
        ),
    }
    for file, chart in charts.items():
        made.append(write_chart(chart, folder / file))
        files += [folder / f"{file}.svg", folder / f"{file}.png"]
    for path in write_pictures(study, rows, folder):
        made.append(page.picture(path, path.stem))
        files.append(path)
    return made


def _paint(findings: Findings) -> Paint:
    """One colour for a structure in all charts."""
    limb = () if findings.limb is None else all_cases(findings.limb.config)
    cases = (*all_cases(findings.studies[0].config), *limb)
    return colours({case.label: case.kind for case in cases})


def _full(rows: list[Row]) -> str:
    """The rate of the loop that all are compared with."""
    return " ".join(
        f"Full volume, sun on {row['load']}: {row['steps']} steps in "
        f"{seconds(row['run_time_s']['median'])}, "
        f"{row['lattice_voxels_per_s'] / 1e9:.3g} billion lattice voxels a second."
        for row in rows
        if row["label"] == FULL
    )


def _expected(lines: list[Line]) -> list[page.Section]:
    """The expectations of the config, each marked as met or missed."""
    rows = [
        [line["label"], Cell(in_words(c), c["met"])]
        for line in lines
        for c in line.get("expected", ())
    ]
    return [Table(["structure", "expected"], rows)] if rows else []


def _refused(reason: str, columns: int) -> Cell:
    return Cell(reason, wraps=True, columns=columns)


def _cost(line: Line) -> list[str | Cell]:
    if "refused" in line:
        return [line["label"], _refused(line["refused"], len(COST) - 1)]
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


def _error(line: Line) -> list[str | Cell]:
    if "refused" in line:
        return [line["label"], _refused(line["refused"], len(ERROR) - 1)]
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
    ]


def _claims(findings: Findings, folder: Path, files: list[Path]) -> list[page.Section]:
    """Claims of the thesis, results of this run, and the charts that show them."""
    words = {True: "yes", False: "no", None: "reported"}
    rows = [
        [
            claim["id"],
            prose(claim["claim"]),
            Cell(words[claim["holds"]], claim["holds"]),
            prose(*claim["found"]),
        ]
        for claim in findings.claims
    ]
    made: list[page.Section] = []
    if rows:
        columns = ["", "claim", "found so", "measured"]
        made = [
            page.heading("Claims of the thesis"),
            Table(columns, rows, left=range(4)),
        ]
    charts = {}
    if any("refused" not in row for row in findings.level_rows):
        charts["error_by_levels"] = by_levels(findings.level_rows)
    if findings.local:
        chart = by_thickness(findings.local, _paint(findings))
        charts["error_by_thickness"] = chart
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


def _all_rows(findings: Findings) -> Table:
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
            rows.append([*names, _refused(row["refused"], len(columns) - 3)])
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
    return Table(columns, rows)
