"""`report.html` of a fit: everything in one page, nothing from afar."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError
from jaxthermo.report import page
from jaxthermo.report.chart import Chart, chart_svg
from jaxthermo.report.table import Cell, Table, prose
from jaxthermo.scene.dimensionless_groups import scene_numbers

from ..problem.build import Calibration
from ..problem.problem import Problem
from ..problem.thermogram_targets import FrameTarget
from ..solvers.fit import Fit
from .charts import (
    MOST,
    Result,
    correlation_chart,
    error_chart,
    loss_chart,
    parameter_charts,
    told,
)
from .pictures import difference_picture, frame_picture, run_both
from .text_summary import (
    GROUPS,
    MEANING,
    about_bars,
    definition,
    error_title,
    is_frames,
    name_of,
    number,
    summary,
)


NUMBERS = {
    "biot": "Biot number",
    "fourier": "Fourier number",
    "voxels_across": "V / A over the pitch",
    "heating": "heating: flux times V / A over k [K]",
}
VIEWS = 4
"""Of frames, that have pictures."""
GOOD = {"fine": True, "dead": False, "flat": False, "not pinned": False}


def write_report(
    folder: Path, calibration: Calibration, fit: Fit, result: Result
) -> None:
    """Write `report.html` into a folder.

    Args:
        folder: that exists.
        calibration: problems and scenes.
        fit: what was found.
        result: as in `fit.json`.
    """
    sections = [
        *_summary(result),
        *_errors(result),
        *_pictures(calibration, fit, result),
        *_parameters(result),
        *_identifiability(result),
        *_loss(result),
        *_advice(result),
        *_ranges(calibration),
        *_origin(result),
    ]
    text = page.document(f"Calibration: {result['name']}", sections)
    with replacing(folder / "report.html") as path:
        path.write_text(text, encoding="utf-8")


def _drawn(chart: Chart | None, otherwise: str) -> page.Section:
    return page.paragraph(otherwise, True) if chart is None else chart_svg(chart)


def _summary(result: Result) -> list[page.Section]:
    return [
        *(page.paragraph(text) for text in summary(result)),
        page.paragraph(definition(result), note=True),
    ]


def _errors(result: Result) -> list[page.Section]:
    columns = ["case", "role", "default %", "fitted %"]
    if not is_frames(result):
        columns += ["default K", "fitted K"]
    rows, made = [], []
    for group, both in result["errors"].items():
        for case in both["fitted"]:
            pair = [both[way][case] for way in ("default", "fitted")]
            percent = [number(e["worst_percent"]) for e in pair]
            kelvin = [f"{max(e['rms_kelvin']):.3g}" for e in pair]
            row = [case, GROUPS[group], *percent, *kelvin]
            rows.append(row[: len(columns)])
        title = f"Error over time of the cases {GROUPS[group]}"
        chart = error_chart(both, error_title(result))
        made += [page.heading(title), _drawn(chart, "All errors are 0.")]
    return [page.heading("Errors"), Table(columns, rows), *made]


def _pictures(calibration: Calibration, fit: Fit, result: Result) -> list[page.Section]:
    made: list[page.Section] = [page.heading("Where it is wrong")]
    for group, problem in (
        ("train", calibration.train),
        ("held_out", calibration.held_out),
    ):
        if problem is not None:
            made += _picture(group, problem, calibration, fit, result)
    return made


def _picture(
    group: str, problem: Problem, calibration: Calibration, fit: Fit, result: Result
) -> list[page.Section]:
    """Of the case whose fitted error is largest, when default and fitted are worst."""
    both = result["errors"][group]
    fitted = both["fitted"]
    name = max(fitted, key=lambda case: fitted[case]["worst_percent"])
    worst = {w: int(np.argmax(both[w][name]["rms_percent"])) for w in both}
    case = next(case for case in problem.cases if case.name == name)
    found = run_both(problem, case, fit.z)
    words = f"{name}, {GROUPS[group]}"
    try:
        if isinstance(case.target, FrameTarget):
            views = range(min(len(case.target.views), VIEWS))
            made = [frame_picture(case, found, worst["fitted"], n) for n in views]
            text = "when the fitted values are worst"
        else:
            camera = calibration.configs[name].camera
            whens = sorted(set(worst.values()))
            made = [difference_picture(case, camera, found, whens)]
            text = "when default and when fitted are worst"
    except InputError as error:
        # What was found is worth more than its picture.
        return [page.paragraph(f"{words}: no picture: {error}", note=True)]
    text = f"{words}, the case with the largest fitted error, {text}."
    return [page.paragraph(text), *(page.embedded(png, words) for png in made)]


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".strip()


def _error_bar(row: dict[str, Any]) -> str:
    error = row["standard_error"]
    return _with_unit(float(f"{error:.2g}"), row["unit"]) if told(error) else "\u2013"


def _marked(verdict: str) -> Cell:
    return Cell(verdict, GOOD.get(verdict))


def _parameters(result: Result) -> list[page.Section]:
    columns = [
        "parameter",
        "start",
        "fitted",
        "standard error",
        "over start",
        "verdict",
    ]
    rows = [
        [
            name_of(name, row),
            _with_unit(row["initial"], row["unit"]),
            _with_unit(row["value"], row["unit"]),
            _error_bar(row),
            f"{row['value'] / row['initial']:.3g}" if row["initial"] else "\u2013",
            _marked(row["verdict"]),
        ]
        for name, row in result["parameters"].items()
    ]
    table = Table(columns, rows)
    few = len(rows) <= MOST
    made = [
        page.heading("Parameters"),
        table if few else page.details(f"All {len(rows)} values", table),
    ]
    if not few:
        made.append(page.paragraph(f"The chart has the first {MOST}.", note=True))
    charts = [chart_svg(chart) for chart in parameter_charts(result)]
    return [*made, *charts, page.paragraph(about_bars(result), note=True)]


def _identifiability(result: Result) -> list[page.Section]:
    parameters = result["parameters"]
    rows = [
        [
            name,
            _marked(row["verdict"]),
            prose(", ".join(row["with"]) or "\u2013"),
            prose(MEANING.get(row["verdict"], "")),
        ]
        for name, row in parameters.items()
        if row["verdict"] != "fine"
    ]
    made: list[page.Section] = [page.heading("What the data tell")]
    fine = len(parameters) - len(rows)
    if not result["correlation"]:
        return [*made, page.paragraph("There are too many values to be judged.")]
    text = f"The data tell {fine} of {len(parameters)} values."
    made.append(page.paragraph(text))
    if rows:
        made.append(
            Table(["parameter", "verdict", "with", "meaning"], rows, left=range(4))
        )
    values = [f"{v:.2g}" for v in result["singular_values"][:MOST]]
    text = (
        "Singular values of the Jacobian with columns of one length, over the largest: "
        f"{', '.join(values) or 'none'}. Below 0.001 a combination of values is flat."
    )
    made.append(page.paragraph(text, note=True))
    if len(parameters) < 2:
        return made
    text = "Correlation of the values' errors; 0 beside what is dead or flat."
    if len(parameters) > MOST:
        text += f" The first {MOST} values."
    return [
        *made,
        page.heading("Correlations"),
        page.paragraph(text),
        chart_svg(correlation_chart(result)),
    ]


def _loss(result: Result) -> list[page.Section]:
    chart = _drawn(loss_chart(result), "The loss was 0 from the start.")
    return [page.heading("Loss by step"), chart]


def _advice(result: Result) -> list[page.Section]:
    if not result["advice"]:
        return []
    rows = [[e["what"], f"{e['gain_nats']:.2f}"] for e in result["advice"]]
    text = (
        "What a further case would add to what is known of the values: half of the "
        "gain of the logarithm of the information's determinant. One nat shrinks the "
        "volume of the confidence region by e."
    )
    table = Table(["further case", "gain [nats]"], rows)
    return [page.heading("Which case to add"), page.paragraph(text), table]


def _ranges(calibration: Calibration) -> list[page.Section]:
    """The cases in numbers without units: weights hold for others like these."""
    groups = {GROUPS["train"]: calibration.train}
    if calibration.held_out is not None:
        groups[GROUPS["held_out"]] = calibration.held_out
    found = {
        words: [
            scene_numbers(case.scene, calibration.configs[case.name].time.end)
            for case in problem.cases
        ]
        for words, problem in groups.items()
    }
    rows = [
        [words, *(_span([one[name] for one in numbers]) for numbers in found.values())]
        for name, words in NUMBERS.items()
    ]
    text = "At the values of the start; a scene outside of what was fitted is a guess."
    table = Table(["", *found], rows)
    return [page.heading("Range of the fit"), table, page.paragraph(text, note=True)]


def _span(values: list[float]) -> str:
    low, high = min(values), max(values)
    one = f"{low:.3g}"
    return one if f"{high:.3g}" == one else f"{one} to {high:.3g}"


def _origin(result: Result) -> list[page.Section]:
    pairs = [
        ("reference", result["reference"].replace("_", " ")),
        ("config", result["config_hash"]),
        ("program", result["program_hash"]),
        ("seed", str(result["seed"])),
        *result["versions"].items(),
    ]
    config = json.dumps(result["config"], indent=2)
    return [
        page.heading("Origin"),
        page.terms(pairs),
        page.details("The config", page.pre(config)),
    ]
