"""Figure 5.7: flow around a cylinder, which sheds vortices that do not hit another."""

from jaxthermo.report.sheet import enlarged

from ..exhibit import Exhibit, Finding, Picture, Verdict
from ..wake import speed_sheet, speed_tiles
from ..wake_flows import chosen, narrow_and_wide
from ..wake_pair import measure_pair, pair_table


_EDGE = 600


def _measure(quick: bool) -> Finding:
    _, wide = narrow_and_wide(quick)
    pairs = measure_pair()
    lowest, number = min(row["factor"] for row in pairs), wide.row["strouhal"]
    reason = (
        "At Re 100 the cylinder sheds vortices with a Strouhal number of "
        f"{number:.3f}, as figure 5.7 shows; dark is slow. The thesis applies the "
        "same cylinder to every body wherever it stands, and says so. A second "
        "cylinder in the wake, by the fitted wake of this package, takes "
        f"{lowest:.0%} to {max(row['factor'] for row in pairs):.0%} of the heat."
    )
    tiles = [
        tile.__class__(enlarged(tile.pixels, _EDGE), tile.label)
        for tile in speed_tiles(wide.run, "one moment", "mean")
    ]
    picture = speed_sheet(tiles, "Figure 5.7: a cylinder in cross-flow")
    parts = (
        Picture("cross_flow", picture, "Wind from the left; bright is fast."),
        pair_table(pairs),
    )
    return Finding(
        Verdict.REPRODUCED,
        reason,
        chosen=chosen(quick),
        parts=parts,
        numbers={"strouhal": number, "pairs": pairs},
    )


EXHIBIT = Exhibit(
    name="figure-5.7",
    title="flow around a cylinder",
    place="5.4, figure 5.7",
    claims=(),
    measure=_measure,
)
