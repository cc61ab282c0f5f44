"""Section 5.1: whether radiation from bodies that are no sources can be left out."""

from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..radiation import (
    measure_neighbours,
    neighbour_chart,
    neighbour_table,
    ten_percent_gap,
)


def _measure(_: bool) -> Finding:
    rows, gap = measure_neighbours(), ten_percent_gap()
    near, far = rows[0], rows[-1]
    reason = (
        "Between two black cubes of 1 m, 400 K and 300 K, the flux is "
        f"{near['flux_W_m2']:.3g} W/m² at a gap of {near['gap_sizes']:g} sizes, "
        f"{near['share_of_sun']:.0%} of the sun's 1000 W/m², and "
        f"{far['flux_W_m2']:.2g} W/m² at {far['gap_sizes']:g} sizes. Left out, an "
        f"insulated wall misses {near['insulated_wall_missed_K']:.3g} and "
        f"{far['insulated_wall_missed_K']:.2g} K. A neighbour fills a tenth of the "
        f"view up to {gap:.2g} sizes: the conclusion holds far away, not near."
    )
    shown = [
        Row(
            f"flux at a gap of {row['gap_sizes']:g} sizes [W/m²]",
            31.15 if row["gap_sizes"] == 10 else None,
            row["flux_W_m2"],
            f"voxels: {row['error_of_voxels']:+.2%}",
        )
        for row in rows
    ]
    chosen = (("bodies", "black cubes of 1 m face to face: the thesis names no size"),)
    caption = "Line: closed form. Points: the view factors of voxelized cubes."
    parts = (
        Plot("neighbours", neighbour_chart(rows), caption),
        neighbour_table(rows),
    )
    numbers = {"rows": rows, "ten_percent_up_to_sizes": gap}
    verdict = Verdict.CONTRADICTED if gap > 0.5 else Verdict.REPRODUCED
    return Finding(verdict, reason, tuple(shown), {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="section-5.1-neighbours",
    title="radiation from bodies that are no sources",
    place="5.1",
    claims=("C03",),
    measure=_measure,
)
