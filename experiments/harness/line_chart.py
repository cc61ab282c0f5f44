"""Charts of curves, with axes and colours that several exhibits share."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import altair as alt

from jaxthermo.report.chart import COLOURS, Chart, LogAxis, legend
from jaxthermo.report.numbers import significant


_WIDTH = 560
_HEIGHT = 360

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
    """Tooltip of its dot; the curve and both values if it is empty."""
    marks: Marks = LINE_AND_DOT

    @property
    def values(self) -> dict[str, str | float]:
        """Fields of the data of a chart."""
        x = float(self.x)
        y = float(self.y)
        text = self.text or f"{self.curve}, {significant(x)}: {significant(y)}"
        return {"curve": self.curve, "x": x, "y": y, "text": text}


def curves(
    rows: Iterable[Mapping[str, Any]], x: str, y: Mapping[str, str]
) -> list[CurvePoint]:
    """Curves of a table, by the column `x` of it.

    Args:
        rows: of the table.
        x: name of the column that all curves have in common.
        y: names of columns by those of their curves.
    """
    table = list(rows)
    return [
        CurvePoint(name, x=row[x], y=row[column])
        for name, column in y.items()
        for row in table
    ]


def curve(
    name: str,
    x: Iterable[float],
    y: Iterable[float],
    *,
    every: int = 1,
    marks: Marks = LINE_AND_DOT,
) -> list[CurvePoint]:
    """Points of a curve: the first one and each `every`-th after it."""
    pairs = list(zip(x, y, strict=True))
    return [CurvePoint(name, x=a, y=b, marks=marks) for a, b in pairs[::every]]


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
        solid = [1, 0]
        broken = [7, 5]
        patterns = [broken if number % 2 else solid for number in range(len(names))]
        scale = alt.Scale(domain=names, range=patterns)
        channels["strokeDash"] = alt.StrokeDash("curve:N", scale=scale, sort=names)
    styles = {
        "line": alt.MarkDef("line", strokeWidth=2),
        "dot": alt.MarkDef("point", filled=True, size=50, opacity=1),
        "diamond": alt.MarkDef("point", shape="diamond", size=130, strokeWidth=2.5),
    }
    layers = []
    for mark, style in styles.items():
        rows = [point.values for point in points if mark in point.marks]
        if rows:
            text = {} if mark == "line" else {"description": "text:N"}
            chart = alt.Chart(alt.Data(values=rows), mark=style)
            layers.append(chart.encode(**channels, **text))
    return alt.layer(*layers).properties(width=_WIDTH, height=_HEIGHT, title=title)


def log_chart(
    points: Sequence[CurvePoint], x_title: str, y_title: str, title: str
) -> Chart:
    """Curves over two logarithmic axes."""
    x = LogAxis([point.x for point in points], x_title)
    y = LogAxis([point.y for point in points], y_title)
    return curve_chart(
        points, x=alt.X(**x.channel("x")), y=alt.Y(**y.channel("y")), title=title
    )


def angle_axis() -> alt.X:
    """The half turn from the stagnation point, with a tick every 30 degrees."""
    axis = alt.Axis(values=list(range(0, 181, 30)))
    scale = alt.Scale(domain=[0, 180], nice=False)
    title = "angle from the front [degrees]"
    return alt.X("x:Q", title=title, axis=axis, scale=scale)
