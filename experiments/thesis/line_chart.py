"""Charts of lines, and axes and colours that several exhibits share."""

from collections.abc import Sequence
from typing import TypedDict

import altair as alt

from jaxthermo.report.chart import Chart, LogAxis, legend


# Told apart without any kind of cone: Okabe and Ito (2008).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
WIDTH = 560
HEIGHT = 360

SHADES = ("#440154", "#3b528b", "#21918c", "#5ec962", "#b8860b", "#e8743b", "#c23b22")
"""Colours of curves in an order, such as of their Reynolds number."""


class Point(TypedDict):
    """A row of a chart."""

    curve: str
    x: float
    y: float
    text: str
    mark: bool
    """True for a point on no line."""


def log_chart(points: Sequence[Point], x_title: str, y_title: str, title: str) -> Chart:
    """Lines with points over two logarithmic axes; marked points stand alone."""
    x = LogAxis([point["x"] for point in points], x_title)
    y = LogAxis([point["y"] for point in points], y_title)
    return _lines(points, alt.X(**x.channel("x")), alt.Y(**y.channel("y")), title)


def point(
    curve: str, x: float | int, y: float | int, text: str = "", mark: bool = False
) -> Point:
    """A row of a chart."""
    return Point(
        curve=curve,
        x=float(x),
        y=float(y),
        text=text,
        mark=mark,
    )


def _lines(points: Sequence[Point], x: alt.X, y: alt.Y, title: str) -> Chart:
    names = list(dict.fromkeys(row["curve"] for row in points))
    scale = alt.Scale(domain=names, range=[*COLOURS][: len(names)])
    colour = alt.Color("curve:N", scale=scale, sort=names, legend=legend())
    lines, alone = (
        alt.Chart(
            alt.Data(values=[row for row in points if row["mark"] == is_mark])
        ).encode(x=x, y=y, color=colour)
        for is_mark in (False, True)
    )
    dots = lines.mark_point(filled=True, size=50, opacity=1)
    diamonds = alone.mark_point(shape="diamond", size=130, strokeWidth=2.5)
    chart = alt.layer(
        lines.mark_line(strokeWidth=2),
        dots.encode(description="text:N"),
        diamonds.encode(description="text:N"),
    )
    return chart.properties(width=WIDTH, height=HEIGHT, title=title)


def angle_axis() -> alt.X:
    """The half turn from the stagnation point, with a tick every 30 degrees."""
    axis = alt.Axis(values=list(range(0, 181, 30)))
    scale = alt.Scale(domain=[0, 180], nice=False)
    title = "angle from the front [degrees]"
    return alt.X("angle:Q", title=title, axis=axis, scale=scale)
