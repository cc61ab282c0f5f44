"""Tuning by a sweep and by a fit: errors over one or two numbers, optima and costs."""

from typing import Literal, TypedDict

import altair as alt
import numpy as np
from jaxtyping import Float
from skimage.measure import find_contours

from jaxthermo.errors import InputError
from jaxthermo.progress import Progress
from jaxthermo.report import page
from jaxthermo.report.chart import POINT_AREA, Chart, chart_svg
from jaxthermo.report.table import Table

from ..config.fit_record import FitRecord, read_fit
from ..config.loader import load_calibration
from ..config.schema import ParameterConfig
from ..run import fit_config
from .config import RangeAxis, text_of
from .evaluate import evaluate, find_truth
from .points import Choice, cases_of
from .sweep import Sweep, worst_percent


_WIDTH = 520
"""Width of a chart [px]."""
_HEIGHT = 360
"""Height of a chart [px]."""
_SWEPT = "#17358c"
_FITTED = "#b3261e"
_START = "#868d99"
_LEVELS = 12
"""Number of lines of a contour."""
_OPTIMA: tuple[Literal["start", "sweep", "fit"], ...] = ("start", "sweep", "fit")
_RUNS = "a run of one case; a derivative along one value counts as a run, too"


class _Optimum(TypedDict):
    values: dict[str, float]
    """Value by axis."""
    rms_percent: float | None
    """Error with these values [%]; None for an infinite one."""


class _FoundOptimum(_Optimum):
    runs: int
    """Number of runs that it took."""


class Tuning(TypedDict):
    """A sweep compared with a fit of the same numbers, in `result.json`."""

    sweep: _FoundOptimum
    fit: _FoundOptimum
    start: _Optimum
    times_fewer_runs: float
    fit_ended: str
    fit_steps: int


class _Mark(TypedDict):
    """An optimum in a chart."""

    x: float
    y: float
    error: float | None
    mark: str
    text: str


class _LinePoint(TypedDict):
    """A point of a line in a chart of one value."""

    x: float
    error: float
    line: str
    text: str


def compare_with_fit(sweep: Sweep, progress: Progress) -> Tuning:
    """Run the fit that a sweep names, and judge its values like those of the sweep.

    Raises:
        InputError: if an axis is not a parameter of the fit, or a case failed.
    """
    comparison = sweep.config.compare_with_fit
    assert comparison is not None
    progress.stage("fit")
    config = load_calibration(comparison.calibration)
    names = _parameters(sweep, config.parameters)
    folder = sweep.folder / "fit"
    done = folder / "fit.json"
    # Finished by an earlier run of this sweep, whose config has the fit's hash.
    if done.is_file():
        result = read_fit(done)
    else:
        result = fit_config(comparison.calibration, out=folder, report=False)
    parameters = result["parameters"]
    values = {axis: parameters[name]["value"] for axis, name in names.items()}
    start = {axis: parameters[name]["initial"] for axis, name in names.items()}
    runs = _fit_runs(result) * len(config.train)
    errors = grid_errors(sweep)
    best = min(errors, key=lambda values: errors[values])
    swept = len(sweep.cases)
    fitted_percent = _judged(sweep, values)
    start_percent = _judged(sweep, start)
    return {
        "sweep": {
            "values": dict(best),
            "rms_percent": errors[best],
            "runs": swept,
        },
        "fit": {
            "values": values,
            "rms_percent": fitted_percent,
            "runs": runs,
        },
        "start": {
            "values": start,
            "rms_percent": start_percent,
        },
        "times_fewer_runs": swept / runs,
        "fit_ended": result["ended"],
        "fit_steps": len(result["steps"]),
    }


def _parameters(sweep: Sweep, fitted: tuple[ParameterConfig, ...]) -> dict[str, str]:
    """Name of the fit's parameter on each axis."""
    parameters = {}
    for name, axis in sweep.config.axes.items():
        key = getattr(axis, "key", "")
        matching = [p.name for p in fitted if key.endswith(p.name)]
        if not isinstance(axis, RangeAxis) or not matching:
            listed = ", ".join(p.name for p in fitted)
            raise InputError(
                f"fit: the axis {name} is no range of a value that is fitted: the fit "
                f"has {listed}"
            )
        parameters[name] = matching[0]
    if len(parameters) > 2:
        raise InputError("fit: it is compared with a sweep over one or two values")
    return parameters


def _fit_runs(result: FitRecord) -> int:
    """Number of runs of each case in a fit."""
    size = len(result["parameters"])
    # The start with its Jacobian, one trial a step, and later Jacobians.
    steps = result["steps"]
    return 1 + size + sum(1 + size * bool(s.get("jacobian_computed")) for s in steps)


def _judged(sweep: Sweep, values: dict[str, float]) -> float | None:
    """Error of values between those of the sweep [%]."""
    axes = sweep.config.axes
    changes = {getattr(axes[name], "key", ""): value for name, value in values.items()}
    labels = tuple((name, text_of(value)) for name, value in values.items())
    cases = cases_of(sweep.config, Choice(labels, changes))
    rows = [evaluate(c, find_truth(c, lambda _: None)).row for c in cases]
    return worst_percent(rows)


def grid_errors(sweep: Sweep) -> dict[tuple[tuple[str, float], ...], float]:
    """Error of each choice by its values; failed choices are left out."""
    errors = {}
    for names, cases in sweep.choices.items():
        rows = [sweep.rows[case.id] for case in cases if case.id in sweep.rows]
        error = worst_percent(rows) if len(rows) == len(cases) else None
        if error is not None:
            errors[tuple((axis, float(label)) for axis, label in names)] = error
    if not errors:
        raise InputError("fit: no choice of the sweep has an error")
    return errors


def sections(sweep: Sweep, tuning: Tuning) -> list[page.Section]:
    """Curves, contour and the table of both optima, for the page of a sweep."""
    page_sections: list[page.Section] = [page.heading("Optimum by sweep and by fit")]
    rows = []
    for name in _OPTIMA:
        optimum = tuning[name]
        values = optimum["values"]
        axis_cells = [f"{values[axis]:.4g}" for axis in sweep.config.axes]
        percent = _percent(optimum["rms_percent"])
        # The start takes no search.
        runs = "" if name == "start" else f"{tuning[name]['runs']:,}"
        rows.append([name, *axis_cells, percent, runs])
    page_sections.append(Table(["", *sweep.config.axes, "error %", "runs"], rows))
    page_sections.append(
        f"The fit took {tuning['fit']['runs']} runs and the sweep "
        f"{tuning['sweep']['runs']}, {tuning['times_fewer_runs']:.3g} times as many "
        f"({_RUNS})."
    )
    for axis in sweep.config.axes:
        other_axes = [name for name in sweep.config.axes if name != axis]
        title = f"Error over {axis}"
        if other_axes:
            title += f", {other_axes[0]} as swept nearest to each optimum"
        page_sections += [
            page.heading(title, 3),
            chart_svg(_curve(sweep, tuning, axis)),
        ]
    if len(sweep.config.axes) == 2:
        page_sections += [
            page.heading("Error over both", 3),
            chart_svg(_contour(sweep, tuning)),
        ]
    return page_sections


def _percent(error: float | None) -> str:
    return "infinite" if error is None else f"{error:.3g}"


def _scale(sweep: Sweep, name: str) -> alt.Scale:
    """Scale of an axis of the sweep, from end to end."""
    axis = sweep.config.axes[name]
    is_log = isinstance(axis, RangeAxis) and axis.log
    ends = list(axis.between) if isinstance(axis, RangeAxis) else []
    scale_type = "log" if is_log else "linear"
    return alt.Scale(type=scale_type, domain=ends, nice=False)


def _grid(
    sweep: Sweep,
) -> tuple[list[np.ndarray], Float[np.ndarray, "..."]]:
    """Values on each axis, and errors at all combinations, NaN where there is none."""
    errors = grid_errors(sweep)
    axes = [
        np.unique([dict(point)[name] for point in errors]) for name in sweep.config.axes
    ]
    table = np.full([len(values) for values in axes], np.nan)
    for point, error in errors.items():
        index = [
            int(np.searchsorted(values, value))
            for values, (_, value) in zip(axes, point, strict=True)
        ]
        table[tuple(index)] = error
    return axes, table


def _curve(sweep: Sweep, tuning: Tuning, axis: str) -> Chart:
    """Error over one value, with the second one at that of start, sweep and fit."""
    names = list(sweep.config.axes)
    column = names.index(axis)
    values, table = _grid(sweep)
    curves = _lines(names, column=column, values=values, table=table, tuning=tuning)
    points: list[_LinePoint] = [
        {
            "x": float(x),
            "error": float(percent),
            "line": name,
            "text": f"{x:.4g}: {percent:.4g} %",
        }
        for name, errors in curves
        for x, percent in zip(values[column], errors, strict=True)
        if np.isfinite(percent)
    ]
    error = alt.Y("error:Q", title="error of the worst load [%]")
    lines = alt.Chart(alt.Data(values=points)).mark_line(strokeWidth=2)
    lines = lines.encode(
        alt.X("x:Q", title=axis, scale=_scale(sweep, axis)),
        error,
        alt.Color("line:N", title=None, scale=_line_scale(points)),
        description="text:N",
    )
    optima = _optima(tuning, axis, axis).encode(y=alt.Y("error:Q"))
    chart = alt.layer(lines, optima)
    chart = chart.resolve_scale(color="independent", shape="independent")
    return chart.properties(width=_WIDTH, height=_HEIGHT)


def _lines(
    names: list[str],
    column: int,
    values: list[np.ndarray],
    table: Float[np.ndarray, "..."],
    tuning: Tuning,
) -> list[tuple[str, np.ndarray]]:
    """Errors along one axis, with the second value near each optimum."""
    if len(names) == 1:
        return [("sweep", table)]
    other_values = values[1 - column]
    nearest: dict[int, list[str]] = {}
    for optimum in _OPTIMA:
        at = tuning[optimum]["values"][names[1 - column]]
        distance = np.abs(np.log(other_values / at) if at > 0 else other_values - at)
        # Two optima nearest to one value share a line.
        nearest.setdefault(int(distance.argmin()), []).append(optimum)
    lines = []
    for index, optima in nearest.items():
        value = f"{names[1 - column]} = {other_values[index]:.3g}"
        errors = np.take(table, index, axis=1 - column)
        lines.append((f"{value} ({', '.join(optima)})", errors))
    return lines


def _line_scale(points: list[_LinePoint]) -> alt.Scale:
    names = list(dict.fromkeys(point["line"] for point in points))
    colours = [_START, _SWEPT, _FITTED] if len(names) > 1 else [_SWEPT]
    return alt.Scale(domain=names, range=colours[: len(names)])


def _optima(tuning: Tuning, across: str, up: str) -> alt.Chart:
    """The optima by their values on two axes."""
    marks: list[_Mark] = []
    for name in _OPTIMA:
        values = tuning[name]["values"]
        error = tuning[name]["rms_percent"]
        mark: _Mark = {
            "x": values[across],
            "y": values[up],
            "error": error,
            "mark": name,
            "text": f"{name}: {_percent(error)} %",
        }
        marks.append(mark)
    chart = alt.Chart(alt.Data(values=marks)).mark_point(
        filled=True, size=1.6 * POINT_AREA, opacity=1, stroke="white", strokeWidth=1.5
    )
    names = list(_OPTIMA)
    shapes = alt.Scale(domain=names, range=["circle", "square", "diamond"])
    colours = alt.Scale(domain=names, range=[_START, _SWEPT, _FITTED])
    return chart.encode(
        alt.X("x:Q"),
        alt.Y("y:Q"),
        alt.Shape("mark:N", title="optimum", scale=shapes),
        alt.Color("mark:N", title="optimum", scale=colours),
        description="text:N",
    )


def _contour(sweep: Sweep, tuning: Tuning) -> Chart:
    """Error over two values: lines of equal error, even in its logarithm."""
    names = list(sweep.config.axes)
    (first, second), table = _grid(sweep)
    finite = table[np.isfinite(table)]
    levels = np.geomspace(finite.min() * 1.02, finite.max(), _LEVELS + 1)[:-1]
    lines = []
    for level in levels.tolist():
        for number, path in enumerate(find_contours(table, level)):
            steps = zip(path.T, (first, second), strict=True)
            x, y = (np.interp(i, np.arange(len(v)), v).tolist() for i, v in steps)
            for order, (x_value, y_value) in enumerate(zip(x, y, strict=True)):
                point = {
                    "error": level,
                    "text": f"{level:.3g} %",
                    "line": f"{level} {number}",
                    "x": x_value,
                    "y": y_value,
                    "order": order,
                }
                lines.append(point)
    scale = alt.Scale(type="log", scheme="viridis", domain=[levels[0], levels[-1]])
    contour = alt.Chart(alt.Data(values=lines)).mark_line(strokeWidth=1.6)
    contour = contour.encode(
        alt.X("x:Q", title=names[0], scale=_scale(sweep, names[0])),
        alt.Y("y:Q", title=names[1], scale=_scale(sweep, names[1])),
        alt.Color("error:Q", title="error [%]", scale=scale),
        detail="line:N",
        order="order:Q",
        description="text:N",
    )
    chart = alt.layer(contour, _optima(tuning, names[0], names[1]))
    chart = chart.resolve_scale(color="independent", shape="independent")
    return chart.properties(width=_WIDTH, height=_WIDTH)
