"""Section 6.1: cells of a cube in irregular levels, n² log n or n²."""

import numpy as np

from jaxthermo.report.chart import Chart

from ..counting import count_cubes, cube_table
from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..line_chart import log_chart, point


# Powers of 2: cubes of 8 to 256 voxels a side, reduced to 128.
_POWERS, _QUICK_POWERS = range(3, 9), range(3, 8)


def _measure(quick: bool) -> Finding:
    found = count_cubes(_QUICK_POWERS if quick else _POWERS)
    rows, slope = found["rows"], found["slope_of_the_largest"]
    quadratic = abs(slope - 2) < abs(slope - found["slope_claimed_there"])
    verdict = Verdict.CONTRADICTED if quadratic else Verdict.DIFFERENT
    reason = (
        f"Between the two largest cubes the cells grow with n to the power of "
        f"{slope:.3f}; n² log n would be {found['slope_claimed_there']:.3f}. Every "
        "level halves the resolution and so has a quarter of the cells of the one "
        "before: the sum is 4/3 of the shell however many levels there are, n² "
        "without a logarithm. Read otherwise, with as many cells in every level, "
        "n² log n would come out, but not from cells that grow. Both are far below "
        "n³: the claim's direction holds, and fewer cells than claimed are needed."
    )
    over_shell = rows[-1]["cells_over_shell"]
    note = "here of a cube, whose limit is 4/3; in the thesis of table 6.1"
    shown = (
        Row("power of n, largest two", found["slope_claimed_there"], slope, "n² log n"),
        Row("irregular cells over the shell's", 3.2 / 2.5, over_shell, note),
    )
    parts = (
        Plot(
            "cubes",
            _chart(rows),
            "The claim is drawn through the count of the largest cube.",
        ),
        cube_table(found),
    )
    return Finding(verdict, reason, shown, parts=parts, numbers=found)


def _chart(rows: list[dict]) -> Chart:
    points = []
    side = np.array([row["side_voxels"] for row in rows], float)
    curves = {
        "irregular levels": [row["cells"] for row in rows],
        "shell": [row["shell"] for row in rows],
        "n³": side**3,
        "n² log n, as claimed": side**2 * np.log(side),
    }
    last = rows[-1]["cells"]
    claimed = curves["n² log n, as claimed"]
    curves["n² log n, as claimed"] = last * np.asarray(claimed) / claimed[-1]
    for curve, values in curves.items():
        for n, value in zip(side, values, strict=True):
            points.append(point(curve, n, value, f"{curve}: {value:,.0f}"))
    title = "C05: cells of a cube of side n"
    return log_chart(points, "voxels along an edge", "cells", title)


EXHIBIT = Exhibit(
    name="section-6.1-cubes",
    title="cells of a cube in irregular levels",
    place="6.1",
    claims=("C05",),
    measure=_measure,
)
