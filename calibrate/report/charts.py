"""Charts of a fit: its loss, its values with error bars, errors, correlations."""

import math
from collections.abc import Callable
from typing import Any

import altair as alt

from jaxthermo.report.chart import POINT_AREA, Chart, LogAxis, legend
from jaxthermo.report.numbers import is_finite

from ..config.fit_record import CaseErrors, FitRecord, Pair


MAX_CHARTED = 48
"""Parameters in a chart; a field of thousands only has a table."""
_Point = dict[str, Any]
_WIDTH = 560.0
"""Width of a chart [px]."""
_ROW_HEIGHT = 26.0
"""Height of a parameter [px]."""
_CELL = 34.0
"""Edge of a cell of correlations [px]."""
_LETTER_WIDTH = 7.3
"""Width of a letter in a label [px]."""
_MAX_BAR = 10.0
"""Length of an error bar at which it is cut off, over the range of the values."""
_MAX_NUMBERED = 14
"""Parameters up to which correlations are written into their cells."""
_UPRIGHT = "M0,-1L0,1"
"""Path of a mark, which its legend shows as it is; a turned one it would not."""
_COLOURS = {"default": "#868d99", "fitted": "#17358c"}
_VERDICT_COLOURS = {
    "fine": "#1b7a4a",
    "misfit": "#d6336c",
    "not converged": "#0b7285",
    "ambiguous": "#845ef7",
    "trade-off": "#b8500a",
    "at bound": "#66228f",
    "not pinned": "#c79a12",
    "flat": "#b3261e",
    "dead": "#5a606c",
}


def _is_positive(value: float | None) -> bool:
    return value is not None and math.isfinite(value) and value > 0


def loss_chart(result: FitRecord) -> Chart | None:
    """Loss at the best point by step; None if it is nowhere above 0."""
    outcomes = ["not accepted", "accepted"]
    history = [(0, result["loss"]["initial"], "accepted")]
    history += [
        (s["step"], s["loss"], outcomes[s["accepted"]]) for s in result["steps"]
    ]
    points = []
    for step, loss, outcome in history:
        if _is_positive(loss):
            text = f"step {step}, {outcome}: {loss:.6g}"
            points.append({"step": step, "loss": loss, "kind": outcome, "text": text})
    if not points:
        return None
    vertical = LogAxis([p["loss"] for p in points], "loss: half of the sum of squares")
    last = max(1, *(p["step"] for p in points))
    ticks = alt.Axis(tickCount=min(last, 12), format="d", tickMinStep=1)
    # Room for the first and the last point.
    scale = alt.Scale(domain=[0, last], padding=16, nice=False)
    fill = alt.Scale(domain=outcomes[::-1], range=["#17358c", "#ffffff"])
    base = alt.Chart(alt.Data(values=points)).encode(
        x=alt.X("step:Q", title="step", axis=ticks, scale=scale),
        y=alt.Y(**vertical.channel("loss")),
    )
    blue = _COLOURS["fitted"]
    line = base.mark_line(color=blue, strokeWidth=2)
    dots = base.mark_point(
        size=POINT_AREA, opacity=1, stroke=blue, strokeWidth=1.5, filled=False
    ).encode(fill=alt.Fill("kind:N", scale=fill, legend=legend()), description="text:N")
    return alt.layer(line, dots).properties(width=_WIDTH, height=240)


def parameter_charts(result: FitRecord) -> list[Chart]:
    """Start and value with its standard error, one chart per unit."""
    groups: dict[tuple[str, bool], list[_Point]] = {}
    for name, row in list(result["parameters"].items())[:MAX_CHARTED]:
        positive = _is_positive(row["value"]) and _is_positive(row["initial"])
        # A value that is not finite is only in the table.
        if is_finite(row["value"]) and is_finite(row["initial"]):
            group = groups.setdefault((row["unit"], positive), [])
            group.append({"name": name, **row})
    margin = _label_width([p["name"] for points in groups.values() for p in points])
    return [
        _value_chart(points, unit=unit, positive=positive, margin=margin)
        for (unit, positive), points in groups.items()
    ]


def _label_width(labels: list[str]) -> float:
    # Fixed, since some viewers' letters are wider than those of the renderer.
    return _LETTER_WIDTH * max(map(len, labels), default=0)


def _value_chart(
    points: list[_Point], unit: str, positive: bool, margin: float
) -> Chart:
    ends = [p[k] for p in points for k in ("initial", "value")]
    # Factors, and what spans decades, are logarithmic; a temperature stays linear.
    logarithmic = positive and (unit == "" or max(ends) > _MAX_BAR * min(ends))
    span = max(ends) - min(ends) or abs(ends[0]) or 1.0
    if logarithmic:
        limits = (min(ends) / _MAX_BAR, max(ends) * _MAX_BAR)
    else:
        limits = (min(ends) - _MAX_BAR * span, max(ends) + _MAX_BAR * span)
    rows = [_value_row(p, logarithmic=logarithmic, limits=limits) for p in points]
    labels = alt.Axis(labelLimit=400, grid=True, ticks=False, minExtent=margin)
    base = alt.Chart(alt.Data(values=rows)).encode(
        y=alt.Y("name:N", title=None, sort=None, axis=labels)
    )
    values = [r[k] for r in rows for k in ("low", "high", "start", "value")]
    title = f"value [{unit}]" if unit else "value"
    # A short logarithmic axis has the ticks of a linear one.
    title += " (logarithmic)" * logarithmic
    across = _value_axis(values, title=title, logarithmic=logarithmic)
    verdicts = {r["verdict"] for r in rows}
    present = [name for name in _VERDICT_COLOURS if name in verdicts]
    paint = alt.Scale(
        domain=present, range=[_VERDICT_COLOURS[name] for name in present]
    )
    colour = alt.Color("verdict:N", scale=paint, legend=legend("verdict"))
    # Marks of start and fitted value have a legend of their own, apart from colours.
    marks = alt.Scale(domain=["start", "fitted"], range=[_UPRIGHT, "circle"])

    def shape(field: str) -> alt.Shape:
        return alt.Shape(field, scale=marks, legend=legend(" "))

    bars = base.mark_rule(strokeWidth=2).encode(
        x=alt.X(**across("low")), x2="high:Q", color=colour
    )
    dots = base.mark_point(size=POINT_AREA, filled=True, opacity=1).encode(
        x=alt.X(**across("value")),
        color=colour,
        shape=shape("as_fitted:N"),
        description="text:N",
    )
    starts = base.mark_point(
        size=2 * POINT_AREA, stroke="#868d99", strokeWidth=2.5, opacity=1
    ).encode(x=alt.X(**across("start")), shape=shape("as_start:N"))
    height = _ROW_HEIGHT * len(rows) + 10
    return alt.layer(bars, starts, dots).properties(width=_WIDTH, height=height)


def _value_axis(
    values: list[float], title: str, logarithmic: bool
) -> Callable[[str], dict[str, Any]]:
    if logarithmic:
        return LogAxis(values, title).channel
    scale = alt.Scale(zero=False, padding=16, domain=[min(values), max(values)])
    return lambda field: {
        "shorthand": field,
        "type": "quantitative",
        "title": title,
        "scale": scale,
        "axis": alt.Axis(tickCount=8),
    }


def _value_row(row: _Point, logarithmic: bool, limits: tuple[float, float]) -> _Point:
    value = row["value"]
    error = row["standard_error"]
    low = high = value
    words = "no error bar"
    if is_finite(error):
        low = value - error
        high = value + error
        if logarithmic:
            # To first order the relative error is the error of the logarithm.
            factor = math.exp(min(error / value, 700.0))
            low = value / factor
            high = value * factor
        words = f"standard error {error:.2g}"
    start = f"start {row['initial']:.4g}"
    return {
        "name": row["name"],
        "verdict": row["verdict"],
        "start": row["initial"],
        "value": value,
        "low": max(low, limits[0]),
        "high": min(high, limits[1]),
        "as_start": "start",
        "as_fitted": "fitted",
        "text": f"{row['name']}: {value:.4g}, {start}, {words}, {row['verdict']}",
    }


def error_chart(errors: Pair[dict[str, CaseErrors]], title: str) -> Chart | None:
    """Error over saved time, a frame per case; None if none is above 0."""
    points = [
        {
            "case": case,
            "values": values,
            "time": time,
            "error": percent,
            "text": f"{case}, {values}, {time:g} s: {percent:.3g} %, {kelvin:.3g} K",
        }
        for values, cases in (
            ("default", errors["default"]),
            ("fitted", errors["fitted"]),
        )
        for case, error in cases.items()
        for time, percent, kelvin in zip(
            error["times_s"], error["rms_percent"], error["rms_kelvin"], strict=True
        )
        if _is_positive(percent)
    ]
    if not points:
        return None
    cases = list(dict.fromkeys(p["case"] for p in points))
    columns = min(len(cases), 3)
    vertical = LogAxis([p["error"] for p in points], title)
    paint = alt.Scale(domain=list(_COLOURS), range=list(_COLOURS.values()))
    dashes = alt.Scale(domain=list(_COLOURS), range=[[5, 4], [1, 0]])
    times = sorted({p["time"] for p in points})
    # Ticks at saved times, at most 8 of them.
    axis = alt.Axis(values=times[:: math.ceil(len(times) / 8)], format=".4~r")
    scale = alt.Scale(padding=16, nice=False, zero=False)
    line_legend = alt.Legend(title=None, symbolSize=POINT_AREA, symbolStrokeWidth=0)
    chart = alt.Chart(alt.Data(values=points))
    lines = chart.mark_line(point=alt.OverlayMarkDef(size=45), strokeWidth=2).encode(
        x=alt.X("time:Q", title="time [s]", axis=axis, scale=scale),
        y=alt.Y(**vertical.channel("error")),
        color=alt.Color("values:N", scale=paint, sort=None, legend=line_legend),
        strokeDash=alt.StrokeDash("values:N", scale=dashes, legend=None),
        description="text:N",
    )
    header = alt.Header(title=None, labelFontSize=13, labelFontWeight="bold")
    frame = alt.Facet("case:N", title=None, sort=cases, header=header)
    width = 420.0 if columns == 1 else 310.0
    return lines.properties(width=width, height=220).facet(frame, columns=columns)


def correlation_chart(result: FitRecord) -> Chart:
    """Correlation of the values' errors, -1 to 1, a cell per pair."""
    names = list(result["parameters"])[:MAX_CHARTED]
    table = result["correlation"]
    rows = []
    for i, a in enumerate(names):
        for j, b in enumerate(names):
            value = float(table[i][j])
            text = f"{a} and {b}: {value:.2f}"
            rows.append({"row": a, "column": b, "value": value, "text": text})
    width = _label_width(names)
    # Labels at an angle need less height than their length.
    column_axis = alt.Axis(
        title=None,
        labelLimit=400,
        ticks=False,
        minExtent=0.7 * width,
        labelAngle=-40,
    )
    row_axis = alt.Axis(title=None, labelLimit=400, ticks=False, minExtent=width)
    ends = ["#17358c", "#f0f0ee", "#a31621"]
    paint = alt.Scale(domain=[-1, 0, 1], range=ends, type="linear", interpolate="rgb")
    ticks = [-1, -0.5, 0, 0.5, 1]
    bar = alt.Legend(
        title="correlation", gradientLength=160, values=ticks, format=".1f"
    )
    base = alt.Chart(alt.Data(values=rows)).encode(
        x=alt.X("column:N", sort=names, axis=column_axis),
        y=alt.Y("row:N", sort=names, axis=row_axis),
    )
    cells = base.mark_rect().encode(
        color=alt.Color("value:Q", scale=paint, legend=bar), description="text:N"
    )
    numbered = len(names) <= _MAX_NUMBERED
    size = _CELL * len(names) if numbered else _WIDTH
    if not numbered:
        return cells.properties(width=size, height=size)
    # White on dark cells.
    ink = alt.condition("abs(datum.value) > 0.5", alt.value("white"), alt.value("#333"))
    numbers = base.mark_text(fontSize=10).encode(
        text=alt.Text("value:Q", format=".2f"), color=ink
    )
    return alt.layer(cells, numbers).properties(width=size, height=size)
