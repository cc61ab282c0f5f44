"""Charts of the comparison; colours stay with their structure in all of them."""

from typing import Any

import altair as alt

from jaxthermo.report.chart import POINT_AREA, Chart, LogAxis, legend

from ..harness.record import Row
from .config import FULL, LINKS


# The darkest and the lightest of each kind of structure.
_SHADES = {
    FULL: ("#14171d", "#14171d"),
    LINKS: ("#868d99", "#868d99"),
    "single_shell": ("#a31621", "#f2877a"),
    "multi_level": ("#b8500a", "#f5b942"),
    "irregular_multi_level": ("#4c7a12", "#a9cf62"),
    "octree": ("#0b6e5f", "#58c4b0"),
    "aggregate": ("#17358c", "#6db1f2"),
    "shell_over_core": ("#66228f", "#c78be6"),
}
# Shades of kinds that are not listed.
_OTHER = ("#6b4423", "#cfa27c")
# Between the two, where a kind has one structure only.
_ALONE = 0.3

Paint = dict[str, str]
"""The colour of each label."""


def colours(kinds: dict[str, str]) -> Paint:
    """A hue for each kind of structure, and in it a shade for each label."""
    paint = {}
    for kind in dict.fromkeys(kinds.values()):
        labels = [label for label in kinds if kinds[label] == kind]
        for i, label in enumerate(labels):
            fraction = i / (len(labels) - 1) if len(labels) > 1 else _ALONE
            paint[label] = _mixed(*_SHADES.get(kind, _OTHER), fraction)
    return paint


def _mixed(dark: str, light: str, fraction: float) -> str:
    ends = [[int(text[i : i + 2], 16) for i in (1, 3, 5)] for text in (dark, light)]
    mixed = (round(a + fraction * (b - a)) for a, b in zip(*ends, strict=True))
    return "#" + "".join(f"{value:02x}" for value in mixed)


def _colour(shown: list[str], paint: Paint, **how: Any) -> alt.Color:
    # Only labels that are shown, in that order: all would outgrow the chart.
    scale = alt.Scale(domain=shown, range=[paint[label] for label in shown])
    return alt.Color("label", type="nominal", scale=scale, sort=None, **how)


_Point = dict[str, Any]

WIDTH, HEIGHT = 640.0, 420.0

# One for each load.
_SHAPES = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross")


def error_against_time(rows: list[Row], paint: Paint, title: str) -> Chart:
    """Error against run time, both logarithmic: a point a structure and load."""
    points = [_point(row) for row in rows if row["error"]["worst_rms_percent"] > 0]
    spans = [p[k] for p in points for k in ("fastest", "slowest")]
    across = LogAxis(spans, "run time [s], warm, with the surface map at saved times")
    up = LogAxis([p["error"] for p in points], "error, RMS at its worst time [%]")
    labels, loads = ([*dict.fromkeys(p[k] for p in points)] for k in ("label", "load"))
    shapes = alt.Scale(domain=loads, range=_SHAPES[: len(loads)])
    base = alt.Chart(alt.Data(values=points)).encode(
        y=alt.Y(**up.channel("error")), color=_colour(labels, paint, legend=legend())
    )
    spread = base.mark_rule(opacity=0.5).encode(
        x=alt.X(**across.channel("fastest")), x2="slowest:Q"
    )
    # Outlines, so that points which meet show each other.
    dots = base.mark_point(size=POINT_AREA, strokeWidth=2.5, opacity=1).encode(
        x=alt.X(**across.channel("median")),
        shape=alt.Shape("load:N", scale=shapes, sort=None, legend=legend("sun on")),
        description="text:N",
    )
    return alt.layer(spread, dots).properties(width=WIDTH, height=HEIGHT, title=title)


def _point(row: Row) -> _Point:
    text = (
        "{label}, sun on {load}: error {error[worst_rms_percent]:.3g} %, "
        "{run_time_s[median]:.3g} s, {times_faster[median]:.3g} times faster "
        "({times_faster[least]:.3g} to {times_faster[most]:.3g}), {nodes} nodes"
    )
    head = {"label": row["label"], "load": row["load"], **row["run_time_s"]}
    error = row["error"]["worst_rms_percent"]
    return {**head, "error": error, "text": text.format_map(row)}


def _lines(
    points: list[_Point], paint: Paint, x: alt.X, y_title: str, title: str
) -> Chart:
    # A line a label through points of `x`, `value` and `label`. Logarithmic, since the
    # errors of good and bad structures lie decades apart.
    labels = list(dict.fromkeys(point["label"] for point in points))
    up = LogAxis([point["value"] for point in points], y_title)
    return (
        alt.Chart(alt.Data(values=points))
        .mark_line(point=alt.OverlayMarkDef(size=45), strokeWidth=2)
        .encode(
            x=x,
            y=alt.Y(**up.channel("value")),
            color=_colour(labels, paint, legend=legend()),
            description="text:N",
        )
        .properties(width=WIDTH, height=HEIGHT, title=title)
    )


def error_over_time(rows: list[Row], paint: Paint, title: str) -> Chart:
    """The error of each structure at every saved time, for one load."""
    series = ("times", "rms_percent")
    points = [
        {
            "label": row["label"],
            "time": time,
            "value": value,
            "text": f"{row['label']}, {time:g} s: {value:.3g} %",
        }
        for row in rows
        for time, value in zip(*map(row["error"].get, series), strict=True)
        if value > 0
    ]
    axis = alt.Axis(values=sorted({point["time"] for point in points}), format=".4~r")
    # Points at the ends of the time stand clear of the frame.
    scale = alt.Scale(padding=16, nice=False, zero=False)
    x = alt.X("time:Q", title="time [s]", axis=axis, scale=scale)
    return _lines(points, paint, x, "error, RMS [%]", title)


def by_levels(rows: list[Row]) -> Chart:
    """The error against how many levels there are."""
    points = [
        {
            "label": f"hollow {row['hollow']}",
            "x": row["levels"],
            "value": row["error"]["worst_rms_percent"],
            "text": f"{row['levels']} levels, {row['nodes']} nodes, hollow "
            f"{row['hollow']}: {row['error']['worst_rms_percent']:.3g} %",
        }
        for row in rows
        if "refused" not in row
    ]
    axis = LogAxis([point["x"] for point in points], "levels, up to all there are")
    paint = colours(dict.fromkeys((p["label"] for p in points), "multi_level"))
    title = f"{rows[0]['body']}: error against levels, sun on {rows[0]['load']}"
    y_title = "error, RMS at its worst time [%]"
    return _lines(points, paint, alt.X(**axis.channel("x")), y_title, title)


def by_thickness(local: list[Row], paint: Paint) -> Chart:
    """The error on parts of the surface, by how thick the body is there."""
    points = [
        {
            "label": row["label"],
            "x": _range(*part["voxels"]),
            "value": part["rms_kelvin"],
            "text": f"{row['label']}, {_range(*part['voxels'])} voxels thick, "
            f"{100 * part['area_share']:.0f} % of the area: "
            f"{part['rms_kelvin']:.2g} K",
        }
        for row in local
        for part in row["parts"]
        if part["rms_kelvin"] > 0
    ]
    axis = alt.Axis(labelAngle=0)
    x = alt.X("x:N", title="thickness under the surface [voxels]", sort=None, axis=axis)
    title = f"Error by thickness of the body, at {local[0]['time_s']:g} s"
    return _lines(points, paint, x, "RMS difference [K]", title)


def _range(low: int, high: int) -> str:
    return str(low) if low == high else f"{low}-{high}"
