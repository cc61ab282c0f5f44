"""The charts of the comparison."""

from typing import Any

import altair as alt

from .axes import LogAxis, colour
from .config import FULL
from .labels import apart
from .record import Row


Point = dict[str, Any]
Chart = alt.Chart | alt.LayerChart | alt.FacetChart

WIDTH, HEIGHT = 640.0, 420.0
DOT = 90


def error_against_time(rows: list[Row], everyone: list[str], title: str) -> Chart:
    """Error against run time, both logarithmic: a point a structure and load.

    Args:
        rows: of one body.
        everyone: all labels of the comparison, for their colours.
        title: of the chart.
    """
    points = [_point(row) for row in rows if row["error"]["worst_rms_percent"] > 0]
    spans = [p[k] for p in points for k in ("fastest", "slowest")]
    across = LogAxis(spans, "run time [s], warm, with the surface map at saved times")
    up = LogAxis([p["error"] for p in points], "error, RMS at its worst time [%]")
    labels = list(dict.fromkeys(point["label"] for point in points))
    paint = colour(labels, everyone, legend=None)
    base = alt.Chart(alt.Data(values=points)).encode(y=alt.Y(**up.of("error")))
    spread = base.mark_rule(opacity=0.5).encode(
        x=alt.X(**across.of("fastest")), x2="slowest:Q", color=paint
    )
    full = alt.Scale(domain=[False, True], range=["circle", "diamond"])
    dots = base.mark_point(filled=True, opacity=1).encode(
        x=alt.X(**across.of("time")),
        color=paint,
        shape=alt.Shape("is_full:N", scale=full, legend=None),
        size=alt.condition("datum.is_full", alt.value(3 * DOT), alt.value(DOT)),
        description="text:N",
    )
    names = alt.Chart(alt.Data(values=_names(points, across, up)))
    names = names.mark_text(align="center", fontSize=12, fontWeight=600).encode(
        x=alt.X(**across.of("time")),
        y=alt.Y(**up.of("error")),
        text="label:N",
        color=paint,
    )
    chart = alt.layer(spread, dots, names)
    return chart.properties(width=WIDTH, height=HEIGHT, title=title)


def _point(row: Row) -> Point:
    error, run, ratio = row["error"], row["run_time_s"], row["times_faster"]
    return {
        "label": row["label"],
        "time": run["median"],
        "fastest": run["fastest"],
        "slowest": run["slowest"],
        "error": error["worst_rms_percent"],
        "is_full": row["label"] == FULL,
        "text": f"{row['label']}, sun on {row['load']}: error "
        f"{error['worst_rms_percent']:.3g} %, {run['median']:.3g} s, "
        f"{ratio['median']:.3g} times faster ({ratio['least']:.3g} to "
        f"{ratio['most']:.3g}), {row['nodes']} nodes",
    }


def _names(points: list[Point], across: LogAxis, up: LogAxis) -> list[Point]:
    """A name above the points of each structure, clear of the other names."""
    groups: dict[str, list[Point]] = {}
    for point in points:
        groups.setdefault(point["label"], []).append(point)
    times = [sorted(p["time"] for p in g)[len(g) // 2] for g in groups.values()]
    tops = [max(p["error"] for p in g) for g in groups.values()]
    place = lambda time, error: (across.pixels(time, WIDTH), up.pixels(error, HEIGHT))
    spots = [place(time, top) for time, top in zip(times, tops, strict=True)]
    heights = apart(list(groups), spots, [place(p["time"], p["error"]) for p in points])
    return [
        {"label": label, "time": time, "error": up.value(height, HEIGHT)}
        for label, time, height in zip(groups, times, heights, strict=True)
    ]


def _lines(
    points: list[Point], everyone: list[str], x: alt.X, y_title: str, title: str
) -> Chart:
    """A line a label through points of `x`, `value` and `label`; values logarithmic."""
    labels = list(dict.fromkeys(point["label"] for point in points))
    legend = alt.Legend(title=None, labelLimit=260)
    up = LogAxis([point["value"] for point in points], y_title)
    return (
        alt.Chart(alt.Data(values=points))
        .mark_line(point=alt.OverlayMarkDef(size=45), strokeWidth=2)
        .encode(
            x=x,
            y=alt.Y(**up.of("value")),
            color=colour(labels, everyone, legend=legend),
            description="text:N",
        )
        .properties(width=WIDTH, height=HEIGHT, title=title)
    )


def error_over_time(rows: list[Row], everyone: list[str], title: str) -> Chart:
    """The error of each structure at every saved time, for one load."""
    points = [
        {
            "label": row["label"],
            "time": time,
            "value": value,
            "text": f"{row['label']}, {time:g} s: {value:.3g} %",
        }
        for row in rows
        for time, value in zip(
            row["error"]["times"], row["error"]["rms_percent"], strict=True
        )
        if value > 0
    ]
    axis = alt.Axis(values=sorted({point["time"] for point in points}), format=".4~r")
    x = alt.X("time:Q", title="time [s]", axis=axis)
    return _lines(points, everyone, x, "error, RMS [%]", title)


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
    everyone = ["hollow empty", "", "hollow innermost"]
    title = f"{rows[0]['body']}: error against levels, sun on {rows[0]['load']}"
    y_title = "error, RMS at its worst time [%]"
    return _lines(points, everyone, alt.X(**axis.of("x")), y_title, title)


def by_thickness(local: list[Row], everyone: list[str]) -> Chart:
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
    return _lines(points, everyone, x, "RMS difference [K]", title)


def _range(low: int, high: int) -> str:
    return str(low) if low == high else f"{low}-{high}"
