"""Claim C20, the local Nusselt number (figure 5.6), and the three averages."""

import csv
import functools
from pathlib import Path
from typing import Any

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.physics.convection.cross_flow import local_nusselt
from jaxthermo.physics.convection.nusselt import AVERAGES, cylinder_table, profile
from jaxthermo.report.chart import Chart, LogAxis
from jaxthermo.report.table import Table


DATA = Path(__file__).with_name("data") / "nu_local_cylinder.csv"
PRANDTL = 0.71
DEGREES = np.arange(0.0, 180.5, 0.5)

SLOW, FAST = (1.0, 5.0, 10.0, 20.0, 40.0), (7.08e4, 1.013e5, 1.4e5, 1.7e5, 2.19e5)
SHAPES = (1.0, 10.0, 40.0, 1e3, 1e4, 3e4, 1.013e5, 2.19e5)

WIDTH, HEIGHT = 560.0, 360.0
SHADES = ("#440154", "#3b528b", "#21918c", "#5ec962", "#b8860b", "#e8743b", "#c23b22")

Point = dict[str, Any]


@jax.jit
def _around(reynolds, degrees):
    """Local numbers, and the average of angles that are even all around."""
    every = lambda angles: jnp.full(angles.shape, reynolds)
    at = lambda angles: local_nusselt(
        jnp.cos(jnp.radians(angles)),
        every(angles),
        jnp.full(angles.shape, PRANDTL),
        profile,
    )
    even = jnp.arange(64, dtype=degrees.dtype) * (360.0 / 64)
    return at(degrees), at(even).mean()


def around(reynolds: float) -> tuple[np.ndarray, float]:
    """Local numbers at `DEGREES` on the level of `profile`, and their average."""
    with jax.enable_x64(True):
        local, mean = _around(reynolds, jnp.asarray(DEGREES))
        return np.asarray(local), float(mean)


@functools.cache
def tabulated() -> list[dict[str, str]]:
    """Published points from which the shape was made, at low and at high Re."""
    with DATA.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def measure_local() -> list[dict[str, Any]]:
    """Each knot: how the average is kept, the minima, the distance from the data."""
    table = cylinder_table()
    return [
        _measure(float(reynolds), float(average), bool(recalled))
        for reynolds, average, recalled in zip(
            table.reynolds, table.average, table.recalled, strict=True
        )
    ]


def _measure(reynolds: float, average: float, recalled: bool) -> dict[str, Any]:
    local, mean = around(reynolds)
    inner = (local[1:-1] < local[:-2]) & (local[1:-1] <= local[2:])
    known = [row for row in tabulated() if float(row["Re"]) == reynolds]
    at = [np.interp(float(row["theta_deg"]), DEGREES, local) for row in known]
    off = [abs(a - float(row["Nu"])) for a, row in zip(at, known, strict=True)]
    return {
        "Re": reynolds,
        "average": average,
        "average_mismatch": mean / average - 1,
        "front_over_sqrt_Re": float(local[0] / np.sqrt(reynolds)),
        "rear_over_front": float(local[-1] / local[0]),
        "minima_deg": [float(d) for d in DEGREES[1:-1][inner]],
        "off_data_of_average": max(off) / average if off else None,
        "recalled": recalled,
    }


def local_table(found: list[dict[str, Any]]) -> Table:
    """The local number at the tabulated Reynolds numbers."""
    columns = ("Re", "average", "mismatch", "minima [deg]", "off the points", "")
    rows = [
        [
            f"{row['Re']:g}",
            f"{row['average']:.4g}",
            f"{row['average_mismatch']:.0e}",
            ", ".join(f"{d:.0f}" for d in row["minima_deg"]) or "none",
            ""
            if row["off_data_of_average"] is None
            else f"{100 * row['off_data_of_average']:.2g} %",
            "recalled, +-15 %" if row["recalled"] else "",
        ]
        for row in found
    ]
    return Table(columns, rows, "C20: local Nusselt number at the tabulated Re")


def local_chart(numbers: tuple[float, ...], title: str) -> Chart:
    """Curves of the local Nusselt number and the points they were made from."""
    lines = [
        {"Re": _name(re), "angle": float(d), "Nu": float(nu)}
        for re in numbers
        for d, nu in zip(DEGREES, around(re)[0], strict=True)
    ]
    names = {float(row["Re"]) for row in tabulated()} & set(numbers)
    points = [
        {
            "Re": _name(float(row["Re"])),
            "angle": float(row["theta_deg"]),
            "Nu": float(row["Nu"]),
            "text": f"Re {row['Re']}, {row['theta_deg']} degrees: "
            f"Nu {row['Nu']}, {row['provenance']}",
        }
        for row in tabulated()
        # The computed ones stand every five degrees, which is more than one can see.
        if float(row["Re"]) in names
        and (row["provenance"] != "computed" or float(row["theta_deg"]) % 15 == 0)
    ]
    paint = _paint(numbers)
    y = alt.Y("Nu:Q", title="local Nusselt number")
    curves = (
        alt.Chart(alt.Data(values=lines))
        .mark_line(strokeWidth=2)
        .encode(x=_angle(), y=y, color=paint)
    )
    dots = (
        alt.Chart(alt.Data(values=points))
        .mark_point(filled=True, size=38, opacity=1)
        .encode(x=_angle(), y=y, color=paint, description="text:N")
    )
    return alt.layer(curves, dots).properties(width=WIDTH, height=HEIGHT, title=title)


def shape_chart() -> alt.Chart:
    """Local over average number, all over the range."""
    points = [
        {"Re": _name(re), "angle": float(d), "share": float(nu / mean)}
        for re in SHAPES
        for (local, mean) in [around(re)]
        for d, nu in zip(DEGREES, local, strict=True)
    ]
    return (
        alt.Chart(alt.Data(values=points))
        .mark_line(strokeWidth=2)
        .encode(
            x=_angle(),
            y=alt.Y("share:Q", title="local over average Nusselt number"),
            color=_paint(SHAPES),
        )
        .properties(width=WIDTH, height=HEIGHT, title="The shape by Reynolds number")
    )


def _angle() -> alt.X:
    axis = alt.Axis(values=list(range(0, 181, 30)))
    scale = alt.Scale(domain=[0, 180], nice=False)
    return alt.X(
        "angle:Q", title="angle from the front [degrees]", axis=axis, scale=scale
    )


def _name(reynolds: float) -> str:
    return f"{reynolds:,.0f}"


def _paint(numbers: tuple[float, ...]) -> alt.Color:
    names = [_name(re) for re in numbers]
    scale = alt.Scale(domain=names, range=[*SHADES, "#7a7f89"][: len(names)])
    return alt.Color("Re:N", title="Re", scale=scale, sort=None)


REYNOLDS = (1.0, 40.0, 1e3, 4e3, 1e4, 3e4, 7.08e4, 1.4e5, 2.19e5)
COLOURS = ("#17358c", "#b8500a", "#4c7a12")


def averages(reynolds: np.ndarray) -> np.ndarray:
    """Averages of each correlation [correlations, Re]."""
    with jax.enable_x64(True):
        re = jnp.asarray(reynolds, jnp.float64)
        pr = jnp.full_like(re, PRANDTL)
        return np.stack([np.asarray(a.nusselt(re, pr)) for a in AVERAGES])


def measure_averages() -> list[dict[str, Any]]:
    """The three averages at each Reynolds number."""
    found = averages(np.array(REYNOLDS))
    return [
        {
            "Re": re,
            **{a.name: float(v) for a, v in zip(AVERAGES, column, strict=True)},
            "largest_over_smallest": float(column.max() / column.min()),
            "outside": [
                a.name for a in AVERAGES if not a.min_reynolds <= re <= a.max_reynolds
            ],
        }
        for re, column in zip(REYNOLDS, found.T, strict=True)
    ]


def average_table(found: list[dict[str, Any]]) -> Table:
    """The averages; a number in brackets is outside the range of its correlation."""

    def cell(row: dict[str, Any], name: str) -> str:
        text = f"{row[name]:.4g}"
        return f"({text})" if name in row["outside"] else text

    rows = [
        [
            f"{row['Re']:g}",
            *(cell(row, a.name) for a in AVERAGES),
            f"{row['largest_over_smallest']:.3f}",
        ]
        for row in found
    ]
    columns = ("Re", *(a.name for a in AVERAGES), "largest / smallest")
    caption = "in brackets: outside the range the correlation is given for"
    return Table(columns, rows, "Average Nusselt numbers, Pr 0.71", caption)


def average_chart() -> alt.Chart:
    """The averages over Churchill and Bernstein's."""
    reynolds = np.geomspace(1.0, 2.5e5, 241)
    found = averages(reynolds)
    points = [
        {"Re": float(re), "share": float(v / base), "label": a.name}
        for a, row in zip(AVERAGES, found, strict=True)
        for re, v, base in zip(reynolds, row, found[0], strict=True)
        # Far below its range one of them says nothing.
        if re >= a.min_reynolds / 20 or a.nusselt is profile
    ]
    x = LogAxis([point["Re"] for point in points], "Reynolds number")
    scale = alt.Scale(domain=[a.name for a in AVERAGES], range=list(COLOURS))
    return (
        alt.Chart(alt.Data(values=points))
        .mark_line(strokeWidth=2)
        .encode(
            x=alt.X(**x.channel("Re")),
            y=alt.Y(
                "share:Q",
                title="average over churchill_bernstein",
                scale=alt.Scale(zero=False),
            ),
            color=alt.Color("label:N", title=None, scale=scale, sort=None),
        )
        .properties(width=560, height=300, title="Three averages")
    )
