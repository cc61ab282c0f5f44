"""Charts of curves, with axes and colours that several exhibits share."""

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import altair as alt

from jaxthermo.report.chart import Chart, LogAxis, legend


# Told apart without any kind of cone: Okabe and Ito (2008).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
WIDTH = 560
HEIGHT = 360

SHADES = ("#440154", "#3b528b", "#21918c", "#5ec962", "#b8860b", "#e8743b", "#c23b22")
"""Colours of curves in an order, such as of their Reynolds number."""


Marks = tuple[Literal["line", "dot", "diamond"], ...]
"""Marks by which a point is drawn; without a line it stands alone."""

LINE: Marks = ("line",)
DOT: Marks = ("dot",)
LINE_AND_DOT: Marks = ("line", "dot")
ALONE: Marks = ("diamond",)
"""Mark of a point that is compared with the curves."""


class CurvePoint(NamedTuple):
    """A point of a curve in a chart."""

    curve: str
    x: float
    y: float
    text: str = ""
    """Tooltip of its dot."""
    marks: Marks = LINE_AND_DOT


def curve(
    name: str,
    x: Iterable[float],
    y: Iterable[float],
    *,
    every: int = 1,
    marks: Marks = LINE,
) -> list[CurvePoint]:
    """Points of a curve, one of every so many."""
    places = list(zip(x, y, strict=True))
    return [CurvePoint(name, x=a, y=b, marks=marks) for a, b in places[::every]]


def curve_chart(
    points: Sequence[CurvePoint],
    x: alt.X,
    y: alt.Y,
    title: str,
    *,
    colours: Sequence[str] = COLOURS,
    legend_title: str | None = None,
    dashed: bool = False,
) -> Chart:
    """Curves by their names; if `dashed`, curves that lie on each other are both seen.

    Args:
        points: of all curves.
        x: axis of the field "x:Q".
        y: axis of the field "y:Q".
        title: of the chart.
        colours: of the curves, in the order of their first points.
        legend_title: of the names.
        dashed: dash every second line.
    """
    names = list(dict.fromkeys(point.curve for point in points))
    scale = alt.Scale(domain=names, range=list(colours[: len(names)]))
    key = legend(legend_title)
    channels = {
        "x": x,
        "y": y,
        "color": alt.Color("curve:N", scale=scale, sort=names, legend=key),
    }
    if dashed:
        dashes = [[7, 5] if number % 2 else [1, 0] for number in range(len(names))]
        scale = alt.Scale(domain=names, range=dashes)
        channels["strokeDash"] = alt.StrokeDash("curve:N", scale=scale, sort=names)
    styles = {
        "line": alt.MarkDef("line", strokeWidth=2),
        "dot": alt.MarkDef("point", filled=True, size=50, opacity=1),
        "diamond": alt.MarkDef("point", shape="diamond", size=130, strokeWidth=2.5),
    }
    layers = []
    for mark, style in styles.items():
        rows = [
            {**point._asdict(), "x": float(point.x), "y": float(point.y)}
            for point in points
            if mark in point.marks
        ]
        if rows:
            text = {} if mark == "line" else {"description": "text:N"}
            chart = alt.Chart(alt.Data(values=rows), mark=style)
            layers.append(chart.encode(**channels, **text))
    return alt.layer(*layers).properties(width=WIDTH, height=HEIGHT, title=title)


def log_chart(
    points: Sequence[CurvePoint], x_title: str, y_title: str, title: str
) -> Chart:
    """Curves over two logarithmic axes."""
    x = LogAxis([point.x for point in points], x_title)
    y = LogAxis([point.y for point in points], y_title)
    return curve_chart(points, alt.X(**x.channel("x")), alt.Y(**y.channel("y")), title)


def angle_axis() -> alt.X:
    """The half turn from the stagnation point, with a tick every 30 degrees."""
    axis = alt.Axis(values=list(range(0, 181, 30)))
    scale = alt.Scale(domain=[0, 180], nice=False)
    title = "angle from the front [degrees]"
    return alt.X("x:Q", title=title, axis=axis, scale=scale)
