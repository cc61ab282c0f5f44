"""Charts of error against run time, memory and nodes, with the front as a line.

In a page their points have tooltips with pictures, by a small script without network
requests.
"""

import html
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from calibrate.study.front import Cost, Measure, Point, front
from jaxthermo.report.chart import POINT_AREA, Chart, LogAxis, legend
from jaxthermo.report.templates import Html

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

    def row(point: Point, **fields: str) -> dict[str, Any]:
        return _row(point, cost=cost, error=error, scale=scale) | fields

    beaten = [row(p) for p in points if p not in best]
    front_rows = [row(p, number=str(n)) for n, p in enumerate(best, 1)]
    rival_rows = [row(p, rival=p.kind) for p in rivals]
    marked = [{"cost": at * scale, "text": text} for text, at in marks]
    all_rows = [*beaten, *front_rows, *rival_rows]
    across = LogAxis([r["cost"] for r in (*all_rows, *marked)], label)
    up = LogAxis([r["error"] for r in all_rows], _ERROR_TITLES[error])
    x = alt.X(**across.channel("cost"))
    y = alt.Y(**up.channel("error"))
    layers = [_dots(beaten, x=x, y=y), _front_line(front_rows, x=x, y=y)]
    layers.append(_chosen(front_rows, x=x, y=y, paint=_paint(points)))
    if rival_rows:
        layers.append(_rivals(rival_rows, x=x, y=y))
    if marked:
        layers += _marks(marked, x)
    separate = _apart(front_rows, across=across, up=up)
    layers.append(_numbers(separate, x=x, y=y))
    chart = alt.layer(*layers).resolve_scale(color="independent", shape="shared")
    return chart.properties(width=_WIDTH, height=_HEIGHT, title=title)


def point_text(point: Point) -> str:
    """The text of a point's tooltip, which is the same in all charts."""
    return sentence(point)


def _is_shown(point: Point, cost: Cost, error: Measure) -> bool:
    value = point.cost(cost)
    finite = 0 < point.errors[error] < float("inf")
    return finite and value is not None and value > 0


def _row(point: Point, cost: Cost, error: Measure, scale: float) -> dict[str, Any]:
    return {
        "cost": (point.cost(cost) or 0.0) * scale,
        "error": point.errors[error],
        "text": point_text(point),
        "label": _label(point),
    }


def _label(point: Point) -> str:
    return str(next(iter(point.choice.values()), ""))


def _data(rows: list[dict[str, Any]]) -> alt.Chart:
    return alt.Chart(alt.Data(values=rows))


def _dots(rows: list[dict[str, Any]], x: alt.X, y: alt.Y) -> alt.Chart:
    base = _data(rows).mark_point(
        filled=True, color=_GREY, size=POINT_AREA * 0.55, opacity=0.9
    )
    return base.encode(x=x, y=y, description="text:N")


def _front_line(rows: list[dict[str, Any]], x: alt.X, y: alt.Y) -> alt.Chart:
    # A step: between two points the smallest error is that of the cheaper one.
    line = _data(rows).mark_line(
        interpolate="step-after", color=_BLACK, strokeWidth=1.5, opacity=0.75
    )
    return line.encode(x=x, y=y)


def _paint(points: Sequence[Point]) -> dict[str, str]:
    """A colour for each label of the first axis, the same in all charts."""
    labels = list(dict.fromkeys(_label(point) for point in points))
    return {label: _HUES[n % len(_HUES)] for n, label in enumerate(labels)}


def _chosen(
    rows: list[dict[str, Any]], x: alt.X, y: alt.Y, paint: dict[str, str]
) -> alt.Chart:
    labels = list(dict.fromkeys(row["label"] for row in rows))
    scale = alt.Scale(domain=labels, range=[paint[label] for label in labels])
    colour = alt.Color("label:N", scale=scale, sort=None, legend=legend("on the front"))
    dots = _data(rows).mark_point(filled=True, size=POINT_AREA * 1.6, opacity=1)
    return dots.encode(x=x, y=y, color=colour, description="text:N")


def _apart(
    rows: list[dict[str, Any]], across: LogAxis, up: LogAxis
) -> list[dict[str, Any]]:
    """Points whose numbers do not cover each other; of a crowd the first one."""
    separate: list[dict[str, Any]] = []
    for row in rows:
        near = (
            _WIDTH * across.distance(row["cost"], placed["cost"]) < _NUMBER_SIZE
            and _HEIGHT * up.distance(row["error"], placed["error"]) < _NUMBER_SIZE
            for placed in separate
        )
        if not any(near):
            separate.append(row)
    return separate


def _numbers(rows: list[dict[str, Any]], x: alt.X, y: alt.Y) -> alt.Chart:
    text = _data(rows).mark_text(dx=11, dy=-9, fontSize=12, color=_BLACK)
    return text.encode(x=x, y=y, text="number:N")


def _rivals(rows: list[dict[str, Any]], x: alt.X, y: alt.Y) -> alt.Chart:
    names = list(dict.fromkeys(row["rival"] for row in rows))
    scale = alt.Scale(domain=names, range=list(_RIVAL_SHAPES[: len(names)]))
    shape = alt.Shape("rival:N", scale=scale, sort=None, legend=legend("beside it"))
    dots = _data(rows).mark_point(
        size=POINT_AREA * 0.8, stroke=_RIVAL_COLOUR, strokeWidth=1.8, opacity=1
    )
    return dots.encode(x=x, y=y, shape=shape, description="text:N")


def _marks(rows: list[dict[str, Any]], x: alt.X) -> list[alt.Chart]:
    base = _data(rows)
    rule = base.mark_rule(strokeDash=[4, 4], color="#5a606c").encode(x=x)
    text = base.mark_text(
        angle=270, align="right", baseline="bottom", dx=-6, dy=-3, color="#5a606c"
    )
    return [rule, text.encode(x=x, y=alt.value(0), text="text:N")]


_MARK = re.compile(
    r'<path ([^>]*?aria-label="([^"]*)"[^>]*?)><title>.*?</title></path>'
)

_STYLE = """<style>
#tip { position: absolute; display: none; z-index: 9; max-width: 26rem;
  background: #fff; border: 1px solid #c8ccd4; border-radius: 4px; padding: .5rem .7rem;
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


def numbered(chart: Html, texts: Sequence[str]) -> Html:
    """Chart whose marks with one of the texts have the number of its tooltip.

    Without the script the browser shows the text alone.
    """
    number = {text: n for n, text in enumerate(texts)}

    def marked(path: re.Match[str]) -> str:
        tip = number.get(html.unescape(path[2]))
        if tip is None:
            return path[0]
        return path[0].replace("<path ", f'<path data-tip="{tip}" ', 1)

    return Html(_MARK.sub(marked, chart))


def tooltips(texts: Sequence[str], pictures: Mapping[str, str]) -> Html:
    """Style, texts, pictures (base64 of PNG, by text) and script of all tooltips."""
    table = json.dumps([[text, pictures.get(text)] for text in texts])
    # "</" would end the script inside a text.
    return Html(_STYLE + _SCRIPT.replace("TABLE", table.replace("</", "<\\/")))
