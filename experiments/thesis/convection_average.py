"""The three averages of the Nusselt number side by side."""

from typing import Any

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np
from rich.table import Table

from jaxthermo.physics.convection.nusselt import AVERAGES, profile
from jaxthermo.report.chart import LogAxis


REYNOLDS = (1.0, 40.0, 1e3, 4e3, 1e4, 3e4, 7.08e4, 1.4e5, 2.19e5)
PRANDTL = 0.71
COLOURS = ("#17358c", "#b8500a", "#4c7a12")


def averages(reynolds: np.ndarray) -> np.ndarray:
    """Of each correlation [correlations, Re]."""
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


def average_cells(rows: list[dict[str, Any]]) -> list[list[str]]:
    """As text; outside its range an average stands in brackets."""

    def cell(row: dict[str, Any], name: str) -> str:
        text = f"{row[name]:.4g}"
        return f"({text})" if name in row["outside"] else text

    return [
        [
            f"{row['Re']:g}",
            *(cell(row, a.name) for a in AVERAGES),
            f"{row['largest_over_smallest']:.3f}",
        ]
        for row in rows
    ]


HEADS = ["Re", *(a.name for a in AVERAGES), "largest / smallest"]


def average_table(rows: list[dict[str, Any]]) -> Table:
    """For the terminal."""
    table = Table(title="Average Nusselt numbers, Pr 0.71")
    for head in HEADS:
        table.add_column(head, justify="right")
    for cells in average_cells(rows):
        table.add_row(*cells)
    table.caption = "in brackets: outside the range the correlation is given for"
    return table


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
