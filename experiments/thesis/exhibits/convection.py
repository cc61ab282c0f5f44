"""5.4: the local Nusselt number around a cylinder, and the choice of its average."""

from collections.abc import Sequence

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.physics.convection.nusselt import AVERAGES, profile
from jaxthermo.report.chart import Chart, LogAxis

from ...harness.line_chart import (
    DOT,
    LINE,
    SHADES,
    CurvePoint,
    angle_axis,
    curve,
    curve_chart,
)
from ..exhibit import Finding, Numbers, Verdict, exhibit
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
            "local-shape": _chart(
                _curves(_SHAPES, over_mean=True),
                "local over average Nusselt number",
                "The shape by Reynolds number",
            ),
        },
    )


def _curves(numbers: Sequence[float], *, over_mean: bool = False) -> list[CurvePoint]:
    """A line of the local number for each Reynolds number."""
    points = []
    for reynolds in numbers:
        scale = mean_number(reynolds) if over_mean else 1.0
        local = local_number(DEGREES, reynolds) / scale
        points += curve(_name(reynolds), DEGREES, local, marks=LINE)
    return points


def _local_chart(numbers: Sequence[float], title: str) -> Chart:
    """Curves of the local Nusselt number and the points they were made from."""
    text = "Re {Re}, {theta_deg} degrees: Nu {Nu}, {provenance}"
    dots = [
        CurvePoint(
            curve=_name(float(row["Re"])),
            x=float(row["theta_deg"]),
            y=float(row["Nu"]),
            text=text.format_map(row),
            marks=DOT,
        )
        for row in tabulated()
        # The computed ones stand every five degrees, which is more than one can see.
        if float(row["Re"]) in numbers
        and (row["provenance"] != "computed" or float(row["theta_deg"]) % 15 == 0)
    ]
    return _chart([*_curves(numbers), *dots], "local Nusselt number", title)


def _chart(points: Sequence[CurvePoint], y_title: str, title: str) -> Chart:
    return curve_chart(
        points=points,
        x=angle_axis(),
        y=alt.Y("y:Q", title=y_title),
        title=title,
        colours=(*SHADES, "#7a7f89"),
        legend_title="Re",
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


def measure_averages() -> list[Numbers]:
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
    points = []
    for average, row in zip(AVERAGES, numbers, strict=True):
        # Far below its range a correlation says nothing.
        lowest = 0.0 if average.nusselt is profile else average.min_reynolds / 20
        is_shown = reynolds >= lowest
        share = row / numbers[0]
        points += curve(average.name, reynolds[is_shown], share[is_shown], marks=LINE)
    x = LogAxis(reynolds.tolist(), "Reynolds number")
    y_title = "average over churchill_bernstein"
    return curve_chart(
        points=points,
        x=alt.X(**x.channel("x")),
        y=alt.Y("y:Q", title=y_title, scale=alt.Scale(zero=False)),
        title="Three averages",
        colours=_COLOURS,
    )
