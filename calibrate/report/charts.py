"""The charts of a fit: its loss, its values with error bars, errors, correlations."""

import math
from typing import Any

import altair as alt

from jaxthermo.report.chart import POINT_AREA, Chart, LogAxis, legend


Point = dict[str, Any]
Result = dict[str, Any]
"""What `fit.json` holds."""

WIDTH, ROW, CELL = 560.0, 26.0, 34.0
"""Of a chart, and heights of a parameter and of a cell in it [px]."""
MOST = 48
"""Parameters in a chart; a field of thousands has a table."""
LETTER = 7.3
"""Width of a letter in a label [px]."""
REACH = 10.0
"""Times the values of a chart that its error bars may reach."""
IN_CELLS = 14
"""Up to so many parameters, the correlations are written into their cells."""

WAYS = {"default": "#868d99", "fitted": "#17358c"}
VERDICTS = {
    "fine": "#1b7a4a",
    "trade-off": "#b8500a",
    "at bound": "#66228f",
    "not pinned": "#c79a12",
    "flat": "#b3261e",
    "dead": "#5a606c",
}
"""Each verdict with its colour, from good to bad."""


def told(value: float | None) -> bool:
    """Whether there is a finite number."""
    return value is not None and math.isfinite(value)


def positive(value: float | None) -> bool:
    """Whether it can stand on a logarithmic axis."""
    return value is not None and math.isfinite(value) and value > 0


def loss_chart(result: Result) -> Chart | None:
    """The loss at the best point so far, by step; None if there is nothing above 0."""
    kind = lambda accepted: "accepted" if accepted else "not accepted"
    points = [
        {"step": 0, "loss": result["loss"]["initial"], "kind": "accepted"},
        *(
            {"step": s["step"], "loss": s["loss"], "kind": kind(s["accepted"])}
            for s in result["steps"]
        ),
    ]
    points = [point for point in points if positive(point["loss"])]
    if not points:
        return None
    for point in points:
        point["text"] = f"step {point['step']}, {point['kind']}: {point['loss']:.6g}"
    up = LogAxis([p["loss"] for p in points], "loss: half of the sum of squares")
    most = max(1, *(p["step"] for p in points))
    ticks = alt.Axis(tickCount=min(most, 12), format="d", tickMinStep=1)
    scale = alt.Scale(domain=[0, most], padding=16, nice=False)
    paint = alt.Scale(domain=["accepted", "not accepted"], range=["#17358c", "#ffffff"])
    base = alt.Chart(alt.Data(values=points)).encode(
        x=alt.X("step:Q", title="step", axis=ticks, scale=scale),
        y=alt.Y(**up.channel("loss")),
    )
    line = base.mark_line(color=WAYS["fitted"], strokeWidth=2)
    dots = base.mark_point(
        size=POINT_AREA, opacity=1, stroke=WAYS["fitted"], strokeWidth=1.5, filled=False
    ).encode(
        fill=alt.Fill("kind:N", scale=paint, legend=legend()), description="text:N"
    )
    return alt.layer(line, dots).properties(width=WIDTH, height=240)


def parameter_charts(result: Result) -> list[Chart]:
    """Start and value with its standard error: a chart of all that share a unit."""
    groups: dict[tuple[str, bool], list[Point]] = {}
    for name, row in list(result["parameters"].items())[:MOST]:
        above = positive(row["value"]) and positive(row["initial"])
        point = {"name": name, **row}
        # One that is not finite has no place; the table has it.
        if told(row["value"]) and told(row["initial"]):
            groups.setdefault((row["unit"], above), []).append(point)
    room = _room([p["name"] for points in groups.values() for p in points])
    return [_values(points, *key, room) for key, points in groups.items()]


def _room(labels: list[str]) -> float:
    """For labels [px], which are wider in some viewers than where they are drawn."""
    return LETTER * max(map(len, labels), default=0)


def _values(points: list[Point], unit: str, above: bool, room: float) -> Chart:
    ends = [p[k] for p in points for k in ("initial", "value")]
    # A factor, or what spans decades; a temperature stays linear.
    logarithmic = above and (unit == "" or max(ends) > REACH * min(ends))
    span = max(ends) - min(ends) or abs(ends[0]) or 1.0
    if logarithmic:
        limits = (min(ends) / REACH, max(ends) * REACH)
    else:
        limits = (min(ends) - REACH * span, max(ends) + REACH * span)
    rows = [_value(p, logarithmic, limits) for p in points]
    title = f"value [{unit}]" if unit else "value"
    base = alt.Chart(alt.Data(values=rows)).encode(
        y=alt.Y(
            "name:N",
            title=None,
            sort=None,
            axis=alt.Axis(labelLimit=400, grid=True, ticks=False, minExtent=room),
        )
    )
    every = [r[k] for r in rows for k in ("low", "high", "start", "value")]
    if logarithmic:
        across = LogAxis(every, title).channel
    else:
        scale = alt.Scale(zero=False, padding=16, domain=[min(every), max(every)])
        across = lambda field: {
            "shorthand": field, "type": "quantitative", "title": title, "scale": scale,
            "axis": alt.Axis(tickCount=8),
        }  # fmt: skip
    shown = [name for name in VERDICTS if any(r["verdict"] == name for r in rows)]
    paint = alt.Scale(domain=shown, range=[VERDICTS[name] for name in shown])
    # The mark of the start has a legend of its own, or nobody knows what it is.
    marks = alt.Scale(domain=["start", "fitted"], range=["stroke", "circle"])
    colour = alt.Color("verdict:N", scale=paint, legend=legend("verdict"))
    bars = base.mark_rule(strokeWidth=2).encode(
        x=alt.X(**across("low")), x2="high:Q", color=colour
    )
    dots = base.mark_point(size=POINT_AREA, filled=True, opacity=1).encode(
        x=alt.X(**across("value")),
        color=colour,
        shape=alt.Shape("as_fitted:N", scale=marks, legend=legend(" ")),
        description="text:N",
    )
    starts = base.mark_point(
        size=2 * POINT_AREA, angle=90, stroke="#868d99", strokeWidth=2.5, opacity=1
    ).encode(
        x=alt.X(**across("start")),
        shape=alt.Shape("as_start:N", scale=marks, legend=legend(" ")),
    )
    height = ROW * len(rows) + 10
    return alt.layer(bars, starts, dots).properties(width=WIDTH, height=height)


def _value(row: Point, logarithmic: bool, limits: tuple[float, float]) -> Point:
    """A value and the ends of its bar: a factor exp(+-error / value) on a log axis."""
    value, error = row["value"], row["standard_error"]
    low = high = value
    words = "no error bar"
    if told(error):
        if logarithmic:
            factor = math.exp(min(error / value, 700.0))
            low, high = value / factor, value * factor
        else:
            low, high = value - error, value + error
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


def error_chart(both: dict[str, dict[str, Any]], title: str) -> Chart | None:
    """Error over saved time, a frame a case; None if none is above 0.

    Args:
        both: of one group, by "default" or "fitted", then by case, as in `fit.json`.
        title: of the error's axis.
    """
    points = [
        {
            "case": case,
            "way": way,
            "time": time,
            "error": percent,
            "text": f"{case}, {way}, {time:g} s: {percent:.3g} %, {kelvin:.3g} K",
        }
        for way, cases in both.items()
        for case, error in cases.items()
        for time, percent, kelvin in zip(
            error["times_s"], error["rms_percent"], error["rms_kelvin"], strict=True
        )
        if positive(percent)
    ]
    if not points:
        return None
    cases = list(dict.fromkeys(p["case"] for p in points))
    across = min(len(cases), 3)
    up = LogAxis([p["error"] for p in points], title)
    paint = alt.Scale(domain=list(WAYS), range=list(WAYS.values()))
    dashes = alt.Scale(domain=list(WAYS), range=[[5, 4], [1, 0]])
    times = sorted({p["time"] for p in points})
    axis = alt.Axis(values=times[:: math.ceil(len(times) / 8)], format=".4~r")
    scale = alt.Scale(padding=16, nice=False, zero=False)
    lines_legend = alt.Legend(title=None, symbolSize=POINT_AREA, symbolStrokeWidth=0)
    lines = (
        alt.Chart(alt.Data(values=points))
        .mark_line(point=alt.OverlayMarkDef(size=45), strokeWidth=2)
        .encode(
            x=alt.X("time:Q", title="time [s]", axis=axis, scale=scale),
            y=alt.Y(**up.channel("error")),
            color=alt.Color("way:N", scale=paint, sort=None, legend=lines_legend),
            strokeDash=alt.StrokeDash("way:N", scale=dashes, legend=None),
            description="text:N",
        )
    )
    width = 420.0 if across == 1 else 310.0
    header = alt.Header(title=None, labelFontSize=13, labelFontWeight="bold")
    frame = alt.Facet("case:N", title=None, sort=cases, header=header)
    return lines.properties(width=width, height=220).facet(frame, columns=across)


def correlation_chart(result: Result) -> Chart:
    """How the errors of the values go together: -1 to 1, a cell a pair."""
    names = list(result["parameters"])[:MOST]
    rows = [
        {
            "row": a,
            "column": b,
            "value": float(result["correlation"][i][j]),
            "text": f"{a} and {b}: {result['correlation'][i][j]:.2f}",
        }
        for i, a in enumerate(names)
        for j, b in enumerate(names)
    ]
    side = CELL if len(names) <= IN_CELLS else 560.0 / len(names)
    room = _room(names)
    axis = lambda share, **more: alt.Axis(
        title=None, labelLimit=400, ticks=False, minExtent=share * room, **more
    )
    colours = alt.Scale(
        domain=[-1, 0, 1],
        range=["#17358c", "#f0f0ee", "#a31621"],
        type="linear",
        interpolate="rgb",
    )
    base = alt.Chart(alt.Data(values=rows)).encode(
        x=alt.X("column:N", sort=names, axis=axis(0.7, labelAngle=-40)),
        y=alt.Y("row:N", sort=names, axis=axis(1.0)),
    )
    bar = alt.Legend(
        title="correlation",
        gradientLength=160,
        values=[-1, -0.5, 0, 0.5, 1],
        format=".1f",
    )
    cells = base.mark_rect().encode(
        color=alt.Color("value:Q", scale=colours, legend=bar), description="text:N"
    )
    size = side * len(names)
    if len(names) > IN_CELLS:
        return cells.properties(width=size, height=size)
    ink = alt.condition("abs(datum.value) > 0.5", alt.value("white"), alt.value("#333"))
    numbers = base.mark_text(fontSize=10).encode(
        text=alt.Text("value:Q", format=".2f"), color=ink
    )
    return alt.layer(cells, numbers).properties(width=size, height=size)
