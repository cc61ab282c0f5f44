"""`report.html` and the files beside it: everything in one page, nothing from afar."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from jaxthermo.arrays import readable_bytes
from jaxthermo.image.annotate import write_png
from jaxthermo.image.ticks import time_label, to_celsius
from jaxthermo.report import page
from jaxthermo.report.chart import Chart, write_chart
from jaxthermo.report.difference_scale import (
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.numbers import seconds, seconds_with_range
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.report.table import Cell, Table, prose

from ..harness.present import Column, colour_bar, table_of, thermal_tile
from ..harness.record import Row
from .charts import (
    by_levels,
    by_thickness,
    colours,
    error_against_time,
    error_over_time,
)
from .claims import Claim, Line, in_words, times
from .config import FULL, resolved
from .measure import MAX_REPEATED_SECONDS, Scenery
from .study import Study, all_cases
from .truth_lines import (
    ALL_TRUTH_COLUMNS,
    REFERENCE_COLUMNS,
    TRUTH_BY_TIME,
    truth_notes,
)


_run_time = lambda line: seconds_with_range(*line["run_time_s"].values())
_by_load = lambda errors: ", ".join(f"{k}: {v:.3g}" for k, v in errors.items())

# Cost and accuracy stand in tables of their own: in one they would not fit on a page.
_COST: list[Column] = [
    ("structure", "{label}"),
    ("nodes", "{nodes:,}"),
    ("links", "{links:,}"),
    ("memory", lambda line: readable_bytes(line["held_bytes"])),
    ("steps", "{steps}"),
    ("build", lambda line: seconds(line["build_time_s"])),
    ("setup", lambda line: seconds(line["setup_time_s"])),
    ("compile", lambda line: seconds(line["compile_time_s"])),
    ("run (fastest-slowest)", _run_time),
    ("times faster (least-most)", times),
]

_TRUTH_ERROR: list[Column] = [("structure", "{label}"), *ALL_TRUTH_COLUMNS]
_ERROR: list[Column] = [
    ("structure", "{label}"),
    ("RMS % by load", lambda line: _by_load(line["error_percent"])),
    ("p99 %", "{worst_p99_percent:.3g}"),
    ("max %", "{worst_max_percent:.3g}"),
    ("RMS K", "{worst_rms_kelvin:.3g}"),
    ("frame RMS K", "{frame_rms_kelvin:.3g}"),
    ("frame SSIM", "{frame_ssim:.4f}"),
    ("capacity", "{capacity_ratio:.5g}"),
    ("energy", "{energy_residual:.0e}"),
]

_several = lambda part, name, form=".3g": (
    lambda row: ", ".join(f"{value:{form}}" for value in row[part][name])
)

_ALL_ROWS: list[Column] = [
    ("body", "{body}"),
    ("load", "{load}"),
    ("structure", "{label}"),
    ("nodes", "{nodes:,}"),
    ("steps", "{steps}"),
    ("run", lambda row: seconds(row["run_time_s"]["median"])),
    ("times faster", times),
    *TRUTH_BY_TIME,
    ("RMS %", "{error[worst_rms_percent]:.4g}"),
    ("RMS % at each time", _several("error", "rms_percent")),
    ("RMS K at each time", _several("error", "rms_kelvin")),
    ("frame K at each time", _several("frame", "rms_kelvin")),
    ("SSIM at each time", _several("frame", "ssim", ".4f")),
]

_DEFINITIONS = {
    "error": "the area-weighted RMS over the surface of the difference from the full "
    "volume at {share:g} of its stable step, over that one's range (max - min) at the "
    "same time, or over 5 % of the run's largest range where that is more; the worst "
    "of the saved times. Every structure is read at the depth of the full volume's "
    "nodes, by the surface map of the config",
    "steps": "each structure runs at its own largest stable step",
    "memory": "the arrays of the compiled scene and its state",
    "setup": "all between the structure and the first step, and what is compiled for "
    "it",
    "run": "the compiled loop with the surface map at the saved times: the median of "
    "{repeats} warm runs, or of as many as {long:g} s hold and the first, two at least",
    "times faster": "what the full volume's explicit loop took in the same process "
    "over the run, with the ends of what was seen",
    "frame": "the same camera, over the body's pixels; SSIM with the error's range as "
    "its data range",
    "capacity": "of the nodes, over the body's",
    "energy": "what the ledger leaves unexplained, over the heat moved",
}


_TRUTH = {
    "truth": "root mean square, over points spread evenly over the mesh, of the "
    "difference in surface temperature from a run ({structure}) in voxels {finer} "
    "times as fine, in K and in percent of that run's range (0.5 to 99.5 %) at that "
    "time; the largest of the saved times and loads. Read at the surface itself, each "
    "structure at its own stable step. Lost: fraction of the surface that the voxels "
    "of a row do not have",
    "truth's own": "estimated error of the finer run, from two coarser ones by "
    "Richardson extrapolation with the observed order; a bound is the larger "
    "difference between these runs, where the order is not within 0.5 to 3",
}


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
    truth_references: list[Row]
    lines: list[Line]
    claims: list[Claim]


class _Page:
    # The sections of the page and the names of the files beside it, in their order.
    def __init__(self, findings: Findings, folder: Path):
        self.findings, self.folder = findings, folder
        self.sections: list[page.Section] = []
        self.files: list[str] = []
        limb = () if findings.limb is None else all_cases(findings.limb.config)
        cases = (*all_cases(findings.studies[0].config), *limb)
        # One colour for a structure in all charts.
        self.paint = colours({case.label: case.kind for case in cases})

    def add_charts(self, charts: Mapping[str, Chart]) -> None:
        for name, chart in charts.items():
            self.sections.append(write_chart(chart, self.folder / name))
            self.files += [f"{name}.svg", f"{name}.png"]

    def add_pictures(self, study: Study, rows: list[Row], prefix: str = "") -> None:
        for kind, image in _sheets(study, rows).items():
            path = self.folder / f"{prefix}{kind}_{study.body.name}.png"
            write_png(path, image)
            self.sections.append(page.picture(path, path.stem))
            self.files.append(path.name)


def write_report(findings: Findings, folder: Path, host: str) -> list[str]:
    """Charts, pictures and the page; returns the names of all files."""
    config = findings.studies[0].config
    words = {"share": config.reference_step, "repeats": config.repeats}
    words["long"] = MAX_REPEATED_SECONDS
    chosen = _DEFINITIONS | (_TRUTH if config.truth is not None else {})
    if config.truth is not None:
        structure = config.truth.structure.kind.replace("_", " ")
        words |= {"finer": f"{config.truth.refinement:.3g}", "structure": structure}
    about = [(name, text.format(**words)) for name, text in chosen.items()]
    made = _Page(findings, folder)
    made.sections = [f"{config.voxels_high} voxels high, {host}", page.terms(about)]
    for study in findings.studies:
        _add_body(made, study)
    _add_claims(made)
    rows = table_of((*findings.rows, *findings.limb_rows), _ALL_ROWS, names=3)
    made.sections.append(page.details("All rows", rows))
    if findings.truth_references:
        table = table_of(findings.truth_references, REFERENCE_COLUMNS, names=2)
        made.sections.append(page.details("Runs of finer voxels", table))
    plain = json.dumps(resolved(config), indent=2)
    made.sections.append(page.details("The config, in SI units", page.pre(plain)))
    title = "Structures against the full volume"
    page.write_page(folder / "report.html", title, made.sections)
    return [*made.files, "report.html"]


def _add_body(made: _Page, study: Study) -> None:
    name, load = study.body.name, study.config.picture.load
    rows = [r for r in made.findings.rows if r["body"] == name and "refused" not in r]
    lines = [line for line in made.findings.lines if line["body"] == name]
    expected = [
        [line["label"], Cell(in_words(check), check["met"])]
        for line in lines
        for check in line.get("expected", ())
    ]
    # The rate of the loop that all are compared with.
    full = " ".join(
        f"Full volume, sun on {row['load']}: {row['steps']} steps in "
        f"{seconds(row['run_time_s']['median'])}, "
        f"{row['lattice_voxels_per_s'] / 1e9:.3g} billion lattice voxels a second."
        for row in rows
        if row["label"] == FULL
    )
    has_truth = any(line.get("truth") for line in lines)
    truth = [table_of(lines, _TRUTH_ERROR)] if has_truth else []
    made.sections += [
        page.heading(name),
        table_of(lines, _COST),
        *truth,
        *(page.paragraph(text, note=True) for text in truth_notes(lines)),
        table_of(lines, _ERROR),
        *([Table(["structure", "expected"], expected)] if expected else []),
        page.paragraph(full, note=True),
    ]
    if not rows:
        return
    shown = [row for row in rows if row["load"] == load]
    over = f"{name}: error over time, sun on {load}"
    made.add_charts(
        {
            f"error_against_time_{name}": error_against_time(
                rows, made.paint, f"{name}: error against run time"
            ),
            f"error_over_time_{name}": error_over_time(shown, made.paint, over),
        }
    )
    made.add_pictures(study, rows)


def _add_claims(made: _Page) -> None:
    """Claims of the thesis, results of this run, and the charts that show them."""
    findings = made.findings
    words = {True: "yes", False: "no", None: "reported"}
    columns: list[Column] = [
        ("", "{id}"),
        ("claim", lambda claim: prose(claim["claim"])),
        ("found so", lambda claim: Cell(words[claim["holds"]], claim["holds"])),
        ("measured", lambda claim: prose(*claim["found"])),
    ]
    if findings.claims:
        table = table_of(findings.claims, columns, left=range(4))
        made.sections += [page.heading("Claims of the thesis"), table]
    if any("refused" not in row for row in findings.level_rows):
        made.add_charts({"error_by_levels": by_levels(findings.level_rows)})
    if findings.local:
        chart = by_thickness(findings.local, made.paint)
        made.add_charts({"error_by_thickness": chart})
    good = [row for row in findings.limb_rows if "refused" not in row]
    if findings.limb is not None and good:
        # Names of their own: the body may be one of those that are compared.
        made.add_pictures(findings.limb, good, "limb_")


# Share of the pixels that a scale spans: a few hot tips must not darken the rest.
_WITHIN = 0.995

_Frame = Float[np.ndarray, "h w"]


def _sheets(study: Study, rows: list[Row]) -> dict[str, Image.Image]:
    # Every structure's frame, and its difference from the full volume's.
    shown, scene = study.config.picture, study.scenery
    chosen = [row for row in rows if row["load"] == shown.load]
    expected = scene.frame(study.shown_reference)
    surfaces = (study.record.arrays_of(row)["surface"] for row in chosen)
    frames = [scene.frame(surface) for surface in surfaces]
    where = f"{study.body.name}, sun on {shown.load}, {time_label(shown.time)}"
    return {
        "differences": _difference_sheet(scene, expected, chosen, frames, where),
        "frames": _frame_sheet(scene, expected, chosen, frames, where),
    }


def _difference_sheet(
    scene: Scenery, expected: _Frame, rows: list[Row], frames: list[_Frame], where: str
) -> Image.Image:
    # Structure less full volume [K], on one scale for all.
    differences = [np.asarray(f - expected, float) for f in frames]
    sizes = np.abs([d[scene.body] for d in differences])
    scale = DifferenceScale(nice_limit(float(np.quantile(sizes, _WITHIN))))
    tiles = [
        Tile(scale.picture(d, scene.body), row["label"], _rms(d, scene))
        for d, row in zip(differences, rows, strict=True)
    ]
    bar = difference_bar(
        scale,
        "structure less full volume [K], one scale for all; "
        f"the largest difference is {sizes.max():.2g} K",
    )
    return sheet(tiles, bar, f"{where}: difference from the full volume")


def _frame_sheet(
    scene: Scenery, expected: _Frame, rows: list[Row], frames: list[_Frame], where: str
) -> Image.Image:
    # All on the reference's scale, or a structure's error would move its colours.
    ends = np.quantile(expected[scene.body], [1 - _WITHIN, _WITHIN])
    limits = float(ends[0]), float(ends[1])
    tiles = [thermal_tile(expected, scene.body, limits, "reference", "full volume")]
    for row, frame in zip(rows, frames, strict=True):
        # The full volume shows what the reference shows, but for the step.
        if row["label"] != FULL:
            note = _rms(np.asarray(frame - expected, float), scene)
            tiles.append(thermal_tile(frame, scene.body, limits, row["label"], note))
    bar = colour_bar(
        to_celsius(limits[0]),
        to_celsius(limits[1]),
        "surface temperature [\N{DEGREE SIGN}C], as the reference's pixels but "
        "the coldest and hottest 0.5 %",
    )
    return sheet(tiles, bar, f"{where}: frames")


def _rms(difference: _Frame, scene: Scenery) -> str:
    return f"RMS {np.sqrt((difference[scene.body] ** 2).mean()):.2g} K"
