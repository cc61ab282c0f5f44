"""Figures 6.6 and 6.7: four speeds of wind, and their normalized wakes."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from jaxthermo.report.sheet import enlarged

from ...harness.present import Rows, table_of
from ..exhibit import Exhibit, Finding, Picture, Plot, Row, Verdict
from ..wake import flow_table, measure_collapse, speed_sheet, speed_tiles, tail_chart
from ..wake_flows import chosen, four_speeds


_EDGE = 500
# Curves that are this far apart, in rms, are one curve.
_ONE_CURVE = 0.03


def _measure_flows(quick: bool) -> Finding:
    flows = four_speeds(quick)
    sheds = [f.setup.speed for f in flows if f.row["strouhal"] is not None]
    steady = [f.setup.speed for f in flows if f.row["strouhal"] is None]
    words = lambda speeds: ", ".join(f"{speed:g}" for speed in speeds) or "none"
    reason = (
        "The thesis gives no viscosity, so that its Reynolds numbers are unknown. "
        f"With Re 100 at speed 1.0, vortices are shed at speeds {words(sheds)}, and "
        f"the flow is steady at {words(steady)}: a cylinder sheds above Re 47. Four "
        "speeds are four kinds of wake."
    )
    tiles = []
    for letter, flow in zip("abcd", flows, strict=True):
        name = f"({letter}) {flow.setup.speed:g} m/s"
        tiles += speed_tiles(flow.run, f"{name}, one moment", "mean")
    large = [tile.__class__(enlarged(tile.pixels, _EDGE), tile.label) for tile in tiles]
    sheet = speed_sheet(large, "Figure 6.6: four speeds in the wide pipe")
    caption = "Speeds over that of the undisturbed middle of the same flow."
    numbers = {f"{f.setup.speed:g}": f.row["strouhal"] for f in flows}
    return Finding(
        Verdict.NOT_REPRODUCIBLE,
        reason,
        chosen=chosen(quick),
        parts=(Picture("speeds", sheet, caption), flow_table([f.row for f in flows])),
        numbers={"strouhal": numbers},
    )


def _measure_curves(quick: bool) -> Finding:
    flows = four_speeds(quick)
    pairs = measure_collapse([flow.tail for flow in flows])
    stretched = _stretched([flow.tail.ratio for flow in flows])
    worst, nearest = (pick(row["rms"] for row in pairs) for pick in (max, min))
    apart = max(row["rms"] for row in stretched)
    ends = [flow.row["last"] for flow in flows]
    same = max(worst, apart) <= _ONE_CURVE
    verdict = Verdict.REPRODUCED if same else Verdict.CONTRADICTED
    reason = (
        "Normalized by the undisturbed speed the four curves lie "
        f"{nearest:.3f} to {worst:.3f} apart in rms, and stretched to 0 to 1 each up "
        f"to {apart:.3f}. A flow depends on its Reynolds number, and the four speeds "
        "have four. Curves are one where the speed changes at the same Re, which "
        "would need another fluid or another body. Towards the outlet all still rise "
        f"or stay, at {min(ends):.2f} to {max(ends):.2f} of the undisturbed speed."
    )
    columns = [
        ("speeds", lambda r: f"{r['speeds'][0]:g} and {r['speeds'][1]:g}"),
        ("rms apart", "{rms:.3f}"),
        ("largest", "{largest:.3f}"),
        ("rms, each from 0 to 1", "{stretched:.3f}"),
    ]
    both = zip(pairs, stretched, strict=True)
    lines = [{**row, "stretched": other["rms"]} for row, other in both]
    caption = "Mean speed behind the cylinder over the undisturbed one, wide pipe."
    chart = tail_chart([f.row for f in flows], [f.tail for f in flows])
    parts = (
        Plot("normalized", chart, caption),
        table_of(lines, columns, "Distance of the curves"),
    )
    rows = (Row("largest distance of two curves, rms", "one curve", worst),)
    numbers = {"pairs": pairs, "stretched": stretched}
    return Finding(verdict, reason, rows, {}, chosen(quick), parts, numbers)


def _stretched(ratios: Sequence[np.ndarray]) -> Rows:
    """Distances of curves, each stretched from its lowest value to its last."""
    above = [ratio - ratio.min() for ratio in ratios]
    curves = [curve / curve[-1] for curve in above]
    return [
        {"rms": float(np.sqrt(np.mean((a - b) ** 2)))}
        for a, b in combinations(curves, 2)
    ]


EXHIBITS = (
    Exhibit(
        name="figure-6.6",
        title="flow behind a cylinder at four speeds",
        place="6.2, figure 6.6",
        claims=(),
        measure=_measure_flows,
    ),
    Exhibit(
        name="figure-6.7",
        title="normalized wakes of four speeds",
        place="6.2, figure 6.7",
        claims=("C23",),
        measure=_measure_curves,
    ),
)
