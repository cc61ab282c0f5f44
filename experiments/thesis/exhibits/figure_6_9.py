"""Figures 6.9 and 6.11: voxels kept over the resolution, of both bodies."""

from collections.abc import Callable
from functools import partial
from typing import Any

from jaxthermo.report.table import Table

from ...harness.present import table_of
from ..bodies import statue
from ..exhibit import Exhibit, Finding, Note, Plot, Row, Verdict, skipped
from ..line_chart import log_chart, point
from ..resolution import count_rows


_HEIGHTS = (50, 100, 150, 200, 250, 350, 450, 550)
_QUICK_HEIGHTS = (50, 100, 150, 200, 250)
_FIGURES = {"figure-6.9": "Happy Buddha", "figure-6.11": "Max Planck"}
_LEAST, _MOST = 0.10, 0.25
# What is kept, and of what; the thesis says neither.
_CURVES = {
    "shell, of the body's voxels": "shell_of_body",
    "irregular, of the body's voxels": "irregular_of_body",
    "shell, of the box": "shell_of_box",
    "irregular, of the box": "irregular_of_box",
    "shell, texels of the box": "texels_shell_of_box",
    "irregular, texels of the box": "texels_irregular_of_box",
}


def _measure(name: str, quick: bool) -> Finding:
    if statue(name) is None:
        return skipped(f"the mesh of {name} is not in JAXTHERMO_MESHES")
    rows = count_rows([name], _QUICK_HEIGHTS if quick else _HEIGHTS)
    last, high = rows[-1], rows[-1]["height_voxels"]
    within = [
        row["height_voxels"]
        for row in rows
        if _LEAST <= row["irregular_of_body"] <= _MOST
    ]
    listed = ", ".join(map(str, within)) or "none"
    reason = (
        "What is kept falls as one over the resolution, so that no range of percents "
        "holds: irregular levels keep "
        f"{rows[0]['irregular_of_body']:.0%} of the body's voxels at "
        f"{rows[0]['height_voxels']} voxels high and "
        f"{last['irregular_of_body']:.1%} at {high}. Between 10 and 25 % they lie at "
        f"{listed}. Texels over cells of the box, as the thesis' table counts, are "
        f"{last['texels_irregular_of_box']:.1%} at {high}."
    )
    columns = [
        ("high", "{height_voxels}"),
        ("body", "{body:,}"),
        ("shell", "{shell:,}"),
        ("/ body", "{shell_of_body:.1%}"),
        ("/ box", "{shell_of_box:.1%}"),
        ("irregular", "{irregular:,}"),
        ("/ body", "{irregular_of_body:.1%}"),
        ("/ box", "{irregular_of_box:.1%}"),
        ("texels", "{texels_shell:,}"),
        ("/ box", "{texels_shell_of_box:.1%}"),
        ("occupied", "{fill:.0%}"),
    ]
    x, y = "voxels along up", "kept, as a fraction"
    chart = log_chart(_points(rows), x, y, f"{name}: compression over the resolution")
    caption = (
        "Occupied voxels over those of the body and of its box, and allocated texels "
        "over the cells of the box."
    )
    parts: tuple[Any, ...] = (
        Plot(f"compression_{name.lower().replace(' ', '_')}", chart, caption),
        table_of(rows, columns, "Voxels kept"),
    )
    claims: dict[str, tuple[Verdict, str]] = {}
    if name == "Max Planck":
        comparison, claims["C26"], note = _compared(high)
        parts += (comparison, note)
    shown = _thesis_rows(name, last)
    chosen = (
        ("resolution", "voxels along up: the text gives no axis of the figure"),
        ("texels of inner levels", "the shell's times the sum of 1/4 per level"),
    )
    numbers = {"rows": rows}
    return Finding(Verdict.DIFFERENT, reason, shown, claims, chosen, parts, numbers)


def _points(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [
        point(curve, row["height_voxels"], row[key], f"{curve}: {row[key]:.1%}")
        for curve, key in _CURVES.items()
        for row in rows
    ]


def _thesis_rows(name: str, last: dict[str, Any]) -> tuple[Row, ...]:
    ours = f"{last['irregular_of_body']:.1%}"
    rows = [Row("kept of the voxels (chapter 3)", "10~25 %", ours, "of the body")]
    if name == "Happy Buddha":
        box = f"{last['texels_irregular_of_box']:.1%}"
        note = "texels of irregular levels over the box; 3.2e6 of 2.8e7 are 11.4 %"
        rows.append(Row("kept of the voxels (6.3)", "only 10 %", box, note))
    return tuple(rows)


def _compared(height: int) -> tuple[Table, tuple[Verdict, str], Note]:
    """C26: both bodies as high, and in a box of as many cells."""
    (buddha,) = count_rows(["Happy Buddha"], (height,))
    (planck,) = count_rows(["Max Planck"], (height,))
    as_large = round(height * (buddha["box"] / planck["box"]) ** (1 / 3))
    (smaller,) = count_rows(["Max Planck"], (as_large,))
    named = {
        f"Happy Buddha, {height} high": buddha,
        f"Max Planck, {height} high": planck,
        f"Max Planck, {as_large} high: as many cells": smaller,
    }
    rows = [{**row, "name": name} for name, row in named.items()]
    layers = lambda key: lambda row: "/".join(map(str, row[key]))
    columns = [
        ("", "{name}"),
        ("box", "{box:,}"),
        ("body", "{body:,}"),
        ("layers peeled", layers("layers_peeled")),
        ("packed", layers("layers_packed")),
        ("shell", "{shell:,}"),
        ("irregular", "{irregular:,}"),
        ("texels", "{texels_shell:,}"),
    ]
    fewer = smaller["shell"] < buddha["shell"]
    layered = sum(planck["layers_packed"]) < sum(buddha["layers_packed"])
    verdict = Verdict.DIFFERENT if fewer and layered else Verdict.CONTRADICTED
    reason = (
        "The head has fewer layers at any resolution "
        f"({sum(planck['layers_packed'])} packed ones, the Buddha "
        f"{sum(buddha['layers_packed'])}). In a box of as many cells its shell has "
        f"{smaller['shell']:,} voxels to the Buddha's {buddha['shell']:,}; at the same "
        f"height it is wider and has {planck['shell']:,}, and its full volume "
        f"{planck['body'] / buddha['body']:.1f} times as many. Time follows the "
        "voxels (figures 6.8 and 6.10), so the claim holds for the same number of "
        "cells, not for the same height."
    )
    note = Note(
        "The thesis finds 8/14/8 layers for the Buddha and 4/5/4 for the head along "
        "x, y, z of the files; z is up here."
    )
    title = "C26: a simpler shape"
    return table_of(rows, columns, title), (verdict, reason), note


def _exhibit(figure: str, name: str) -> Exhibit:
    measure: Callable[[bool], Finding] = partial(_measure, name)
    title, number = f"{name}: voxels kept", figure.split("-")[1]
    claims = ("C06", "C26") if name == "Max Planck" else ("C06",)
    return Exhibit(figure, title, f"6.3, figure {number}", claims, measure)


EXHIBITS = tuple(_exhibit(*item) for item in _FIGURES.items())
