"""5.4: the local Nusselt number around a cylinder, and the choice of its average."""

from collections.abc import Callable, Sequence
from typing import Any

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.physics.convection.nusselt import AVERAGES, profile
from jaxthermo.report.chart import Chart, LogAxis

from ..exhibit import Finding, Verdict, exhibit
from ..line_chart import HEIGHT, SHADES, WIDTH, angle_axis
from ..nusselt import (
    DEGREES,
    FAST,
    PRANDTL,
    local_number,
    mean_number,
    measure_knots,
    tabulated,
)


# Reynolds numbers with computed points; and some across the whole range, between which
# the shape is interpolated.
_SLOW = (1.0, 5.0, 10.0, 20.0, 40.0)
_SHAPES = (1.0, 10.0, 40.0, 1e3, 1e4, 3e4, 1.013e5, 2.19e5)
# Ends of the correlations' ranges, and numbers where two or all three are valid.
_REYNOLDS = (1.0, 40.0, 1e3, 4e3, 1e4, 3e4, 7.08e4, 1.4e5, 2.19e5)
_COLOURS = ("#17358c", "#b8500a", "#4c7a12")


@exhibit("figure-5.6", "5.4, figure 5.6")
def _local_nusselt_number(_: bool) -> Finding:
    """Measure the local number at the knots of its table."""
    rows = measure_knots()
    first = {
        count: min(row["Re"] for row in rows if len(row["minima_deg"]) == count)
        for count in (1, 2)
    }
    fast_title = "Fast flow, as in figure 5.6 (points: recalled, ±15 %)"
    return Finding(
        Verdict.DIFFERENT,
        {
            "rows": rows,
            "worst_mismatch": max(abs(row["average_mismatch"]) for row in rows),
            "first_with_minima": first,
        },
        {
            "local-fast": _local_chart(FAST, fast_title),
            "local-slow": _local_chart(_SLOW, "Slow flow, Pr 0.71"),
            "local-shape": _curves(
                _SHAPES,
                lambda re: local_number(DEGREES, re) / mean_number(re),
                "local over average Nusselt number",
            ).properties(
                width=WIDTH, height=HEIGHT, title="The shape by Reynolds number"
            ),
        },
    )


def _local_chart(numbers: Sequence[float], title: str) -> Chart:
    """Curves of the local Nusselt number and the points they were made from."""
    text = "Re {Re}, {theta_deg} degrees: Nu {Nu}, {provenance}"
    points = [
        {
            "Re": _name(float(row["Re"])),
            "angle": float(row["theta_deg"]),
            "value": float(row["Nu"]),
            "text": text.format_map(row),
        }
        for row in tabulated()
        # The computed ones stand every five degrees, which is more than one can see.
        if float(row["Re"]) in numbers
        and (row["provenance"] != "computed" or float(row["theta_deg"]) % 15 == 0)
    ]
    curves = _curves(
        numbers, lambda re: local_number(DEGREES, re), "local Nusselt number"
    )
    dots = curves.mark_point(filled=True, size=38, opacity=1)
    dots = dots.encode(description="text:N").properties(data=alt.Data(values=points))
    return alt.layer(curves, dots).properties(width=WIDTH, height=HEIGHT, title=title)


def _curves(
    numbers: Sequence[float],
    values: Callable[[float], Float[np.ndarray, " a"]],
    y_title: str,
) -> alt.Chart:
    """A line for each Reynolds number over the angle from the front."""
    lines = [
        {"Re": _name(reynolds), "angle": float(degrees), "value": float(value)}
        for reynolds in numbers
        for degrees, value in zip(DEGREES, values(reynolds), strict=True)
    ]
    names = [_name(reynolds) for reynolds in numbers]
    scale = alt.Scale(domain=names, range=[*SHADES, "#7a7f89"][: len(names)])
    chart = alt.Chart(alt.Data(values=lines)).mark_line(strokeWidth=2)
    return chart.encode(
        x=angle_axis(),
        y=alt.Y("value:Q", title=y_title),
        color=alt.Color("Re:N", title="Re", scale=scale, sort=None),
    )


def _name(reynolds: float) -> str:
    return f"{reynolds:,.0f}"


@exhibit("section-5.4-averages", "5.4")
def _averages_of_the_number(_: bool) -> Finding:
    """Compare the three averages that a wind may have."""
    return Finding(
        Verdict.NOT_REPRODUCIBLE,
        {"rows": measure_averages()},
        {"averages": _average_chart()},
    )


@jax.jit
def _all_averages(reynolds):
    prandtl = jnp.full_like(reynolds, PRANDTL)
    return jnp.stack([average.nusselt(reynolds, prandtl) for average in AVERAGES])


def _averages(reynolds: Sequence[float]) -> Float[np.ndarray, "correlations re"]:
    with jax.enable_x64(True):
        return np.asarray(_all_averages(np.asarray(reynolds, float)))


def measure_averages() -> list[dict[str, Any]]:
    """The three averages at each Reynolds number, and those out of their range."""
    return [
        {
            "Re": reynolds,
            **{
                average.name: float(number)
                for average, number in zip(AVERAGES, numbers, strict=True)
            },
            "largest_over_smallest": float(numbers.max() / numbers.min()),
            "outside": [
                average.name
                for average in AVERAGES
                if not average.min_reynolds <= reynolds <= average.max_reynolds
            ],
        }
        for reynolds, numbers in zip(_REYNOLDS, _averages(_REYNOLDS).T, strict=True)
    ]


def _average_chart() -> Chart:
    """The averages over Churchill and Bernstein's."""
    reynolds = np.geomspace(1.0, 2.5e5, 241)
    numbers = _averages(reynolds.tolist())
    points = [
        {"Re": float(re), "share": float(number / base), "label": average.name}
        for average, row in zip(AVERAGES, numbers, strict=True)
        for re, number, base in zip(reynolds, row, numbers[0], strict=True)
        # Far below its range a correlation says nothing.
        if re >= average.min_reynolds / 20 or average.nusselt is profile
    ]
    x = LogAxis([row["Re"] for row in points], "Reynolds number")
    scale = alt.Scale(domain=[a.name for a in AVERAGES], range=list(_COLOURS))
    y_scale = alt.Scale(zero=False)
    chart = alt.Chart(alt.Data(values=points)).mark_line(strokeWidth=2)
    return chart.encode(
        x=alt.X(**x.channel("Re")),
        y=alt.Y("share:Q", title="average over churchill_bernstein", scale=y_scale),
        color=alt.Color("label:N", title=None, scale=scale, sort=None),
    ).properties(width=WIDTH, height=300, title="Three averages")
