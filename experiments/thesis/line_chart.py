"""Charts of lines over logarithmic axes, as several exhibits show them."""

from collections.abc import Sequence
from typing import Any

import altair as alt

from jaxthermo.report.chart import Chart, LogAxis, legend


# Told apart without any kind of cone: Okabe and Ito (2008).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
WIDTH, HEIGHT = 560, 360

Points = list[dict[str, Any]]
"""Rows with "curve", "x", "y" and "text"; with "mark" true for a point on no line."""


def log_chart(points: Points, x_title: str, y_title: str, title: str) -> Chart:
    """Lines with points over two logarithmic axes; marked points stand alone."""
    x = LogAxis([point["x"] for point in points], x_title)
    y = LogAxis([point["y"] for point in points], y_title)
    return _lines(points, alt.X(**x.channel("x")), alt.Y(**y.channel("y")), title)


def point(
    curve: str, x: float | int, y: float | int, text: str = "", mark: bool = False
) -> dict:
    """A row of a chart."""
    return {"curve": curve, "x": float(x), "y": float(y), "text": text, "mark": mark}


def _lines(points: Points, x: alt.X, y: alt.Y, title: str) -> Chart:
    names = list(dict.fromkeys(each["curve"] for each in points))
    scale = alt.Scale(domain=names, range=[*COLOURS][: len(names)])
    colour = alt.Color("curve:N", scale=scale, sort=names, legend=legend())
    of = lambda mark: alt.Chart(
        alt.Data(values=[each for each in points if each["mark"] == mark])
    ).encode(x=x, y=y, color=colour)
    lines, alone = of(False), of(True)
    dots = lines.mark_point(filled=True, size=50, opacity=1)
    layers: Sequence[alt.Chart] = (
        lines.mark_line(strokeWidth=2),
        dots.encode(description="text:N"),
        alone.mark_point(shape="diamond", size=130, strokeWidth=2.5).encode(
            description="text:N"
        ),
    )
    chart = alt.layer(*layers)
    return chart.properties(width=WIDTH, height=HEIGHT, title=title)
