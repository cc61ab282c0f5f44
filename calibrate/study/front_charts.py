"""Charts of error against run time, memory and nodes, with the front as a line.

In a page their points have tooltips with pictures, by a small script without network
requests.
"""

import base64
import html
import json
import math
import re
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TypedDict

import altair as alt

from jaxthermo.report.chart import POINT_AREA, Chart, LogAxis, legend
from jaxthermo.report.templates import Html

from .front import Cost, Measure, Point, front
from .wording import sentence


_WIDTH = 760.0
_HEIGHT = 460.0
_GREY = "#b9bec8"
_HUES = (
    "#17358c",
    "#0b6e5f",
    "#b8500a",
    "#66228f",
    "#4c7a12",
    "#a31621",
    "#2a7fb8",
    "#c79a12",
    "#8c5a2b",
    "#5b6270",
)
_RIVAL_SHAPES = ("cross", "diamond", "triangle-up", "triangle-down", "square")
_RIVAL_COLOUR = "#d1352b"
_MARK_COLOUR = "#5a606c"
_BLACK = "#14171d"
_NUMBER_SIZE = 16.0
"""Width and height of the number of a point [pixels]."""

_ERROR_TITLES: dict[Measure, str] = {
    "rms_percent": "error against the reference, RMS [%]",
    "rms_kelvin": "error against the reference, RMS [K]",
    "p99_percent": "error that 99 % of the surface stays below [%]",
    "p99_kelvin": "error that 99 % of the surface stays below [K]",
}
_COSTS: dict[Cost, tuple[str, float]] = {
    "time_s": ("run time [s]", 1.0),
    "memory_bytes": ("memory of the solver, estimated [MB]", 1e-6),
    "nodes": ("nodes", 1.0),
}

Marks = Sequence[tuple[str, float]]
"""Vertical lines with a text at a run time [s]."""


class _Dot(TypedDict):
    """A point in a chart."""

    cost: float
    error: float
    text: str
    """Text of its tooltip."""
    label: str
    """Label on the first axis of the sweep."""
    kind: str
    number: str
    """Number on the front; empty for other points."""


def error_against(
    cost: Cost,
    points: Sequence[Point],
    rivals: Sequence[Point] = (),
    error: Measure = "rms_percent",
    title: str = "",
    marks: Marks = (),
) -> Chart | None:
    """Error against a cost, both logarithmic; None without any point."""
    points = [p for p in points if _is_shown(p, cost, error)]
    rivals = [p for p in rivals if _is_shown(p, cost, error)]
    if not points:
        return None
    best = front(points, cost=cost, error=error)
    label, scale = _COSTS[cost]

    def dot(point: Point, number: str = "") -> _Dot:
        return {
            "cost": (point.cost(cost) or 0.0) * scale,
            "error": point.errors[error],
            "text": sentence(point),
            "label": _label(point),
            "kind": point.kind,
            "number": number,
        }

    beaten = [dot(p) for p in points if p not in best]
    on_front = [dot(p, str(n)) for n, p in enumerate(best, 1)]
    rival_dots = [dot(p) for p in rivals]
    lines = [{"cost": at * scale, "text": text} for text, at in marks]
    dots = [*beaten, *on_front, *rival_dots]
    costs = [dot["cost"] for dot in dots]
    costs += [line["cost"] for line in lines]
    across = LogAxis(costs, label)
    up = LogAxis([d["error"] for d in dots], _ERROR_TITLES[error])
    x = alt.X(**across.channel("cost"))

    def drawn(rows: Sequence[_Dot]) -> alt.Chart:
        y = alt.Y(**up.channel("error"))
        return alt.Chart(alt.Data(values=rows)).encode(x=x, y=y)

    tip = alt.Description("text:N")
    grey = drawn(beaten).encode(tip)
    coloured = drawn(on_front).encode(tip, color=_colour(points, best))
    layers = [
        grey.mark_point(filled=True, color=_GREY, size=POINT_AREA * 0.55, opacity=0.9),
        # A step: between two points the smallest error is that of the cheaper one.
        drawn(on_front).mark_line(
            interpolate="step-after", color=_BLACK, strokeWidth=1.5, opacity=0.75
        ),
        coloured.mark_point(filled=True, size=POINT_AREA * 1.6, opacity=1),
    ]
    if rival_dots:
        shaped = drawn(rival_dots).encode(tip, shape=_shape(rivals))
        layers.append(
            shaped.mark_point(
                size=POINT_AREA * 0.8, stroke=_RIVAL_COLOUR, strokeWidth=1.8, opacity=1
            )
        )
    if lines:
        base = alt.Chart(alt.Data(values=lines)).encode(x=x)
        named = base.encode(y=alt.value(0), text="text:N")
        layers += [
            base.mark_rule(strokeDash=[4, 4], color=_MARK_COLOUR),
            named.mark_text(
                angle=270,
                align="right",
                baseline="bottom",
                dx=-6,
                dy=-3,
                color=_MARK_COLOUR,
            ),
        ]
    numbers = drawn(_apart(on_front, across=across, up=up)).encode(text="number:N")
    layers.append(numbers.mark_text(dx=11, dy=-9, fontSize=12, color=_BLACK))
    chart = alt.LayerChart(layer=layers)
    chart = chart.resolve_scale(color="independent", shape="shared")
    return chart.properties(width=_WIDTH, height=_HEIGHT, title=title)


def _is_shown(point: Point, cost: Cost, error: Measure) -> bool:
    return (point.cost(cost) or 0) > 0 and 0 < point.errors[error] < math.inf


def _label(point: Point) -> str:
    return str(next(iter(point.choice.values()), ""))


def _colour(points: Sequence[Point], best: Sequence[Point]) -> alt.Color:
    """A colour for each label of the first axis, the same in all charts."""
    labels = list(dict.fromkeys(map(_label, points)))
    hues = dict(zip(labels, cycle(_HUES), strict=False))
    on_front = list(dict.fromkeys(map(_label, best)))
    scale = alt.Scale(domain=on_front, range=[hues[label] for label in on_front])
    axis = next(iter(points[0].choice), "").replace("_", " ")
    title = f"{axis}, on the front" if axis else "on the front"
    return alt.Color("label:N", scale=scale, sort=None, legend=legend(title))


def _shape(rivals: Sequence[Point]) -> alt.Shape:
    kinds = list(dict.fromkeys(rival.kind for rival in rivals))
    scale = alt.Scale(domain=kinds, range=list(_RIVAL_SHAPES[: len(kinds)]))
    return alt.Shape("kind:N", scale=scale, sort=None, legend=legend("beside it"))


def _apart(dots: Sequence[_Dot], across: LogAxis, up: LogAxis) -> list[_Dot]:
    """Points whose numbers do not cover each other; of a crowd the first one."""
    separate: list[_Dot] = []
    for dot in dots:
        near = (
            _WIDTH * across.distance(dot["cost"], placed["cost"]) < _NUMBER_SIZE
            and _HEIGHT * up.distance(dot["error"], placed["error"]) < _NUMBER_SIZE
            for placed in separate
        )
        if not any(near):
            separate.append(dot)
    return separate


_MARK = re.compile(
    r'<path ([^>]*?aria-label="([^"]*)"[^>]*?)><title>.*?</title></path>'
)

_STYLE = """<style>
#tip { position: absolute; display: none; z-index: 9; max-width: 26rem;
  background: var(--page); border: 1px solid var(--rule); border-radius: 4px;
  padding: .5rem .7rem;
  box-shadow: 0 2px 10px rgba(20, 23, 29, .18); font-size: 13px; pointer-events: none; }
#tip img { margin: .3rem 0 0; }
[data-tip] { cursor: pointer; }
[data-tip]:hover { stroke: #14171d; stroke-width: 2.5; }
</style>"""

# Pictures are in the page once, in the table that the script reads.
_SCRIPT = """<div id="tip"></div><script>
const tips = TABLE;
const box = document.getElementById("tip");
for (const mark of document.querySelectorAll("[data-tip]")) {
  for (const title of mark.querySelectorAll("title")) title.remove();
  mark.addEventListener("mousemove", event => {
    const [text, picture] = tips[mark.dataset.tip];
    box.textContent = text;
    if (picture) {
      const image = document.createElement("img");
      image.src = "data:image/png;base64," + picture;
      box.append(image);
    }
    box.style.display = "block";
    const right = event.pageX + 16 + box.offsetWidth < document.body.offsetWidth + 200;
    box.style.left = (right ? event.pageX + 14 : event.pageX - 14 - box.offsetWidth)
      + "px";
    box.style.top = event.pageY + 14 + "px";
  });
  mark.addEventListener("mouseleave", () => { box.style.display = "none"; });
}
</script>"""


def numbered(chart: Html, points: Sequence[Point]) -> Html:
    """Chart whose marks of the points have the numbers of their tooltips.

    Without the script the browser shows the text alone.
    """
    number = {text: n for n, text in enumerate(_pictures_by_text(points))}

    def marked(path: re.Match[str]) -> str:
        tip = number.get(html.unescape(path[2]))
        if tip is None:
            return path[0]
        return path[0].replace("<path ", f'<path data-tip="{tip}" ', 1)

    return Html(_MARK.sub(marked, chart))


def tooltips(points: Sequence[Point], folder: Path) -> Html:
    """Style, texts, pictures of the sweep's folder, and script of all tooltips."""
    table = json.dumps(
        [
            [text, _embedded_picture(folder, name)]
            for text, name in _pictures_by_text(points).items()
        ]
    )
    # "</" would end the script inside a text.
    return Html(_STYLE + _SCRIPT.replace("TABLE", table.replace("</", "<\\/")))


def _pictures_by_text(points: Sequence[Point]) -> dict[str, str | None]:
    """File of the picture by text of the tooltip; of equal texts the last one."""
    return {sentence(point): point.picture for point in points}


def _embedded_picture(folder: Path, name: str | None) -> str | None:
    """A picture of a row as base64; None without one."""
    if name is None or not (folder / name).is_file():
        return None
    return base64.b64encode((folder / name).read_bytes()).decode("ascii")
