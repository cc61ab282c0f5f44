"""`report.html` of a fit: one page without references to other files."""

import json
from pathlib import Path

import numpy as np

from jaxthermo.errors import InputError
from jaxthermo.host_memory import readable_bytes
from jaxthermo.report import page
from jaxthermo.report.chart import Chart, chart_svg
from jaxthermo.report.numbers import padded
from jaxthermo.report.table import Table, prose

from ..config.fit_record import (
    CaseErrors,
    FitRecord,
    Group,
    Pair,
    each_group,
    number_of,
)
from ..problem.build import Calibration
from ..problem.targets import FrameTarget
from ..solvers.fit import Fit
from .charts import (
    MAX_CHARTED,
    correlation_chart,
    error_chart,
    loss_chart,
    parameter_charts,
)
from .pictures import difference_picture, frame_picture, run_both, values_of_both
from .text_summary import (
    GROUPS,
    MEANING,
    about_standard_errors,
    definition,
    error_title,
    error_unit,
    experiment_table,
    is_frames,
    marked,
    parameter_table,
    summary,
    time_table,
    truth_definition,
    truth_table,
)


_NUMBERS = {
    "biot": "Biot number",
    "fourier": "Fourier number",
    "voxels_across": "V / A over the pitch",
    "heating": "heating: flux times V / A over k [K]",
}
_MACHINE = ("device", "processor", "commit")
_MAX_VIEWS = 4
"""Views of frames that have pictures."""
_Sections = list[page.Section]


def write_report(
    folder: Path, calibration: Calibration, fit: Fit, result: FitRecord
) -> None:
    """Write `report.html` into an existing folder."""
    sections = [
        *summary(result),
        page.paragraph(definition(result), note=True),
        *_errors(result),
        *_truth(result),
        *_pictures(calibration, fit, result),
        *_parameters(result),
        *_identifiability(result),
        page.heading("Loss by step"),
        _drawn(loss_chart(result), "The loss was 0 from the start."),
        *_experiments(result),
        *_ranges(calibration),
        *_origin(result),
    ]
    title = f"Calibration: {result['name']}"
    page.write_page(folder / "report.html", title, sections)


def _drawn(chart: Chart | None, otherwise: str) -> page.Section:
    return page.paragraph(otherwise, True) if chart is None else chart_svg(chart)


def _errors(result: FitRecord) -> _Sections:
    unit = error_unit(result)
    # Frames may show radiances, whose errors are not in kelvin.
    columns = ["case", "role", f"default [{unit}]", f"fitted [{unit}]"]
    columns += [] if is_frames(result) else ["default [K]", "fitted [K]"]
    rows: list[list[str]] = []
    charts: _Sections = []
    for group, errors in each_group(result["errors"]):
        for case in errors["fitted"]:
            pair = (errors["default"][case], errors["fitted"][case])
            percent = [padded(number_of(e["worst_percent"])) for e in pair]
            kelvin = [padded(max(map(number_of, e["rms_kelvin"]))) for e in pair]
            rows.append([case, GROUPS[group], *percent, *kelvin][: len(columns)])
        title = f"Error over time of the cases {GROUPS[group]}"
        chart = error_chart(errors, error_title(result))
        charts += [page.heading(title), _drawn(chart, "All errors are 0.")]
    details = page.details("Errors at every saved time", time_table(result))
    return [page.heading("Errors"), Table(columns, rows, left=(0, 1)), details, *charts]


def _truth(result: FitRecord) -> _Sections:
    table = truth_table(result)
    truth = result.get("truth")
    if table is None or truth is None:
        return []
    note = page.paragraph(truth_definition(truth), note=True)
    runs = [
        [
            run["case"],
            ", ".join(f"{1e3 * pitch:.3g}" for pitch in run["pitch_m"]),
            f"{run['nodes']:,}",
            f"{run['steps']:,}",
            readable_bytes(run["memory_bytes"]),
            f"{run['run_time_s']:.3g}",
            "yes" if run["cached"] else "no",
        ]
        for run in truth["cost"]
    ]
    columns = ["case", "pitch [mm]", "nodes", "steps", "memory", "run [s]", "cached"]
    cost = page.details("Reference runs of finer voxels", Table(columns, runs))
    return [page.heading("Errors against finer voxels"), table, note, cost]


def _pictures(calibration: Calibration, fit: Fit, result: FitRecord) -> _Sections:
    sections: _Sections = [page.heading("Spatial distribution of the error")]
    errors = dict(each_group(result["errors"]))
    for group in calibration.problems:
        sections += _worst_case(
            group, errors=errors[group], calibration=calibration, fit=fit
        )
    return sections


def _worst_case(
    group: Group,
    errors: Pair[dict[str, CaseErrors]],
    calibration: Calibration,
    fit: Fit,
) -> _Sections:
    problem = calibration.problems[group]
    fitted = errors["fitted"]
    name = max(fitted, key=lambda case: number_of(fitted[case]["worst_percent"]))

    def worst_time(cases: dict[str, CaseErrors]) -> int:
        return int(np.argmax(list(map(number_of, cases[name]["rms_percent"]))))

    case = next(case for case in problem.cases if case.name == name)
    solutions = run_both(problem, case=case, z=fit.z)
    label = f"{name}, {GROUPS[group]}"
    try:
        if isinstance(case.target, FrameTarget):
            views = range(min(len(case.target.views), _MAX_VIEWS))
            time = worst_time(fitted)
            values = values_of_both(problem, case=case, z=fit.z)
            images = [
                frame_picture(
                    case, solutions=solutions, values=values, time=time, view=n
                )
                for n in views
            ]
            moment = "after the fit"
        else:
            camera = calibration.configs[name].camera
            times = sorted({worst_time(errors["default"]), worst_time(fitted)})
            images = [
                difference_picture(
                    case, camera=camera, solutions=solutions, times=times
                )
            ]
            moment = "before and after the fit"
    except InputError as error:
        # A camera that sees nothing must not cost the results of a long fit.
        return [page.paragraph(f"{label}: no picture: {error}", note=True)]
    text = (
        f"{name}, the worst of the cases {GROUPS[group]}, at the saved time of its "
        f"largest error {moment}."
    )
    return [text, *(page.embedded(png, label) for png in images)]


def _parameters(result: FitRecord) -> _Sections:
    number = len(result["parameters"])
    table = parameter_table(result["parameters"], "")
    sections: _Sections = [page.heading("Parameters"), table]
    # Hundreds of rows would hide what follows.
    if number > MAX_CHARTED:
        folded = page.details(f"All {number} values", table)
        first = page.paragraph(f"The chart has the first {MAX_CHARTED}.", note=True)
        sections[1:] = [folded, first]
    bars = (
        "Bars are one standard error to each side; on a logarithmic axis a factor "
        "exp(standard error / value). Values that the data do not determine have none. "
    )
    note = page.paragraph(bars + about_standard_errors(result), note=True)
    return [*sections, *map(chart_svg, parameter_charts(result)), note]


def _identifiability(result: FitRecord) -> _Sections:
    parameters = result["parameters"]
    sections: _Sections = [page.heading("Identifiability")]
    if not result["correlation"]:
        return [*sections, "There are too many values to be judged."]
    rows = []
    for name, row in parameters.items():
        if (verdict := row["verdict"]) != "fine":
            related = prose(", ".join(row["with"]) or "\N{EN DASH}")
            meaning = prose(MEANING.get(verdict, ""))
            rows.append([name, marked(verdict), related, meaning])
    fine = len(parameters) - len(rows)
    sections.append(f"The data determine {fine} of {len(parameters)} values.")
    if rows:
        columns = ["parameter", "verdict", "with", "meaning"]
        sections.append(Table(columns, rows, left=range(len(columns))))
    values = ", ".join(f"{v:.2g}" for v in result["singular_values"][:MAX_CHARTED])
    text = (
        "Singular values of the Jacobian with columns of one length, over the largest: "
        f"{values or 'none'}. Below 0.001 a combination of values is flat."
    )
    sections.append(page.paragraph(text, note=True))
    # One value is correlated with itself only.
    if len(parameters) < 2:
        return sections
    text = "Correlation of the values' errors; 0 with dead or flat ones."
    if len(parameters) > MAX_CHARTED:
        text += f" The first {MAX_CHARTED} values."
    chart = chart_svg(correlation_chart(result))
    return [*sections, page.heading("Correlations"), text, chart]


def _experiments(result: FitRecord) -> _Sections:
    if not result["advice"]:
        return []
    text = (
        "Information that a further experiment would add on the values: half of the "
        "gain of the logarithm of the information's determinant. One nat shrinks the "
        "volume of the confidence region by e."
    )
    return [page.heading("Which experiment to add"), text, experiment_table(result)]


def _ranges(calibration: Calibration) -> _Sections:
    # Weights are valid for scenes with similar dimensionless numbers.
    scene_groups = {
        GROUPS[group]: calibration.numbers(problem)
        for group, problem in calibration.problems.items()
    }
    rows = [
        [words, *(_span([n[name] for n in group]) for group in scene_groups.values())]
        for name, words in _NUMBERS.items()
    ]
    note = (
        "At the scene's own values; outside these ranges the weights are extrapolated."
    )
    sections = [Table(["", *scene_groups], rows), page.paragraph(note, note=True)]
    return [page.heading("Range of the fit"), *sections]


def _span(values: list[float]) -> str:
    low = f"{min(values):.3g}"
    high = f"{max(values):.3g}"
    return low if high == low else f"{low} to {high}"


def _origin(result: FitRecord) -> _Sections:
    pairs = [
        ("reference", result["reference"].replace("_", " ")),
        ("config", result["config_hash"]),
        ("program", result["program_hash"]),
        ("seed", str(result["seed"])),
        *((k, str(result.get(k))) for k in _MACHINE if k in result),
        *result["versions"].items(),
    ]
    config = page.pre(json.dumps(result["config"], indent=2))
    details = page.details("The config", config)
    return [page.heading("Origin"), page.terms(pairs), details]
