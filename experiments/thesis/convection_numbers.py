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

from ..harness.present import Rows, table_of


_DATA = Path(__file__).with_name("data") / "nu_local_cylinder.csv"
# Air, as in figure 5.6.
_PRANDTL = 0.71
_DEGREES = np.arange(0.0, 180.5, 0.5)

# Reynolds numbers of the charts: those with computed points; those of figure 5.6; and
# some across the whole range, between which the shape is interpolated.
SLOW, FAST = (1.0, 5.0, 10.0, 20.0, 40.0), (7.08e4, 1.013e5, 1.4e5, 1.7e5, 2.19e5)
_SHAPES = (1.0, 10.0, 40.0, 1e3, 1e4, 3e4, 1.013e5, 2.19e5)

WIDTH = 560
HEIGHT = 360
SHADES = ("#440154", "#3b528b", "#21918c", "#5ec962", "#b8860b", "#e8743b", "#c23b22")


@jax.jit
def _around_both(reynolds, degrees):
    every = lambda angles: jnp.full(angles.shape, reynolds)
    at = lambda angles: local_nusselt(
        jnp.cos(jnp.radians(angles)),
        every(angles),
        jnp.full(angles.shape, _PRANDTL),
        profile,
    )
    # Evenly spaced angles average cos kθ to 0 exactly for every k below their number.
    even = jnp.arange(64, dtype=degrees.dtype) * (360.0 / 64)
    return at(degrees), at(even).mean()


def _around(reynolds: float) -> tuple[np.ndarray, float]:
    """Local numbers at `_DEGREES` on the level of `profile`, and their average."""
    # The mismatch of the average is rounding only, which float32 would hide.
    with jax.enable_x64(True):
        local, mean = _around_both(reynolds, jnp.asarray(_DEGREES))
        return np.asarray(local), float(mean)


@functools.cache
def _tabulated() -> list[dict[str, str]]:
    # Published points from which the shape was made, at low and at high Re.
    with _DATA.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def measure_local() -> Rows:
    """Each knot: how the average is kept, the minima, the distance from the data."""
    table = cylinder_table()
    knots = zip(table.reynolds, table.average, table.recalled, strict=True)
    return [_measure(float(re), float(mean), bool(known)) for re, mean, known in knots]


def _measure(reynolds: float, average: float, recalled: bool) -> dict[str, Any]:
    local, mean = _around(reynolds)
    inner = (local[1:-1] < local[:-2]) & (local[1:-1] <= local[2:])
    known = [row for row in _tabulated() if float(row["Re"]) == reynolds]
    at = [np.interp(float(row["theta_deg"]), _DEGREES, local) for row in known]
    off = [abs(a - float(row["Nu"])) for a, row in zip(at, known, strict=True)]
    return {
        "Re": reynolds,
        "average": average,
        "average_mismatch": mean / average - 1,
        # A laminar stagnation point keeps this constant over Re.
        "front_over_sqrt_Re": float(local[0] / np.sqrt(reynolds)),
        "rear_over_front": float(local[-1] / local[0]),
        "minima_deg": [float(d) for d in _DEGREES[1:-1][inner]],
        "off_data_of_average": max(off) / average if off else None,
        "recalled": recalled,
    }


def local_table(found: Rows) -> Table:
    """The local number at the tabulated Reynolds numbers."""
    minima = lambda degrees: ", ".join(f"{d:.0f}" for d in degrees)
    off = lambda part: "" if part is None else f"{100 * part:.2g} %"
    columns = [
        ("Re", "{Re:g}"),
        ("average", "{average:.4g}"),
        ("mismatch", "{average_mismatch:.0e}"),
        ("minima [deg]", lambda row: minima(row["minima_deg"]) or "none"),
        ("off the points", lambda row: off(row["off_data_of_average"])),
        ("", lambda row: "recalled, +-15 %" if row["recalled"] else ""),
    ]
    return table_of(found, columns, "C20: local Nusselt number at the tabulated Re")


def local_chart(numbers: tuple[float, ...], title: str) -> Chart:
    """Curves of the local Nusselt number and the points they were made from."""
    text = "Re {Re}, {theta_deg} degrees: Nu {Nu}, {provenance}"
    points = [
        {
            "Re": _name(float(row["Re"])),
            "angle": float(row["theta_deg"]),
            "value": float(row["Nu"]),
            "text": text.format_map(row),
        }
        for row in _tabulated()
        # The computed ones stand every five degrees, which is more than one can see.
        if float(row["Re"]) in numbers
        and (row["provenance"] != "computed" or float(row["theta_deg"]) % 15 == 0)
    ]
    curves = _curves(numbers, "local Nusselt number", lambda local, mean: local)
    dots = curves.mark_point(filled=True, size=38, opacity=1)
    dots = dots.encode(description="text:N").properties(data=alt.Data(values=points))
    return alt.layer(curves, dots).properties(width=WIDTH, height=HEIGHT, title=title)


def shape_chart() -> Chart:
    """Local over average number, all over the range."""
    share = lambda local, mean: local / mean
    curves = _curves(_SHAPES, "local over average Nusselt number", share)
    title = "The shape by Reynolds number"
    return curves.properties(width=WIDTH, height=HEIGHT, title=title)


def _curves(numbers: tuple[float, ...], y_title: str, value) -> alt.Chart:
    """A line for each Reynolds number over the angle from the front."""
    lines = [
        {"Re": _name(re), "angle": float(d), "value": float(v)}
        for re in numbers
        for d, v in zip(_DEGREES, value(*_around(re)), strict=True)
    ]
    names = [_name(re) for re in numbers]
    scale = alt.Scale(domain=names, range=[*SHADES, "#7a7f89"][: len(names)])
    return (
        alt.Chart(alt.Data(values=lines))
        .mark_line(strokeWidth=2)
        .encode(
            x=angle_axis(),
            y=alt.Y("value:Q", title=y_title),
            color=alt.Color("Re:N", title="Re", scale=scale, sort=None),
        )
    )


def angle_axis() -> alt.X:
    """The half turn from the stagnation point, with a tick every 30 degrees."""
    axis = alt.Axis(values=list(range(0, 181, 30)))
    scale = alt.Scale(domain=[0, 180], nice=False)
    title = "angle from the front [degrees]"
    return alt.X("angle:Q", title=title, axis=axis, scale=scale)


def _name(reynolds: float) -> str:
    return f"{reynolds:,.0f}"


# Ends of the correlations' ranges, and numbers where two or all three are valid.
_REYNOLDS = (1.0, 40.0, 1e3, 4e3, 1e4, 3e4, 7.08e4, 1.4e5, 2.19e5)
_COLOURS = ("#17358c", "#b8500a", "#4c7a12")


@jax.jit
def _every_average(reynolds):
    prandtl = jnp.full_like(reynolds, _PRANDTL)
    return jnp.stack([a.nusselt(reynolds, prandtl) for a in AVERAGES])


def _averages(reynolds: np.ndarray) -> np.ndarray:
    # Averages of each correlation [correlations, Re].
    with jax.enable_x64(True):
        return np.asarray(_every_average(np.asarray(reynolds, float)))


def measure_averages() -> Rows:
    """The three averages at each Reynolds number."""
    rows = []
    for re, column in zip(_REYNOLDS, _averages(np.array(_REYNOLDS)).T, strict=True):
        valid = {a.name: a.min_reynolds <= re <= a.max_reynolds for a in AVERAGES}
        rows.append(
            {
                "Re": re,
                **dict(zip(valid, column.tolist(), strict=True)),
                "largest_over_smallest": float(column.max() / column.min()),
                "outside": [name for name, inside in valid.items() if not inside],
            }
        )
    return rows


def average_table(found: Rows) -> Table:
    """The averages; a number in brackets is outside the range of its correlation."""

    def cell(row: dict[str, Any], name: str) -> str:
        text = f"{row[name]:.4g}"
        return f"({text})" if name in row["outside"] else text

    columns = [
        ("Re", "{Re:g}"),
        *((a.name, functools.partial(cell, name=a.name)) for a in AVERAGES),
        ("largest / smallest", "{largest_over_smallest:.3f}"),
    ]
    caption = "in brackets: outside the range the correlation is given for"
    return table_of(found, columns, "Average Nusselt numbers, Pr 0.71", caption)


def average_chart() -> Chart:
    """The averages over Churchill and Bernstein's."""
    reynolds = np.geomspace(1.0, 2.5e5, 241)
    found = _averages(reynolds)
    points = [
        {"Re": float(re), "share": float(v / base), "label": a.name}
        for a, row in zip(AVERAGES, found, strict=True)
        for re, v, base in zip(reynolds, row, found[0], strict=True)
        # Far below its range one of them says nothing.
        if re >= a.min_reynolds / 20 or a.nusselt is profile
    ]
    x = LogAxis([point["Re"] for point in points], "Reynolds number")
    scale = alt.Scale(domain=[a.name for a in AVERAGES], range=list(_COLOURS))
    y_title, near = "average over churchill_bernstein", alt.Scale(zero=False)
    return (
        alt.Chart(alt.Data(values=points))
        .mark_line(strokeWidth=2)
        .encode(
            x=alt.X(**x.channel("Re")),
            y=alt.Y("share:Q", title=y_title, scale=near),
            color=alt.Color("label:N", title=None, scale=scale, sort=None),
        )
        .properties(width=WIDTH, height=300, title="Three averages")
    )
