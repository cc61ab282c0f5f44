"""Figure 4.8: slices of a sphere as single shell, multi-level and irregular."""

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.report.sheet import Tile, sheet

from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..slices import Slice, level_legend


# Of the sphere [m]; voxels across it; levels of the multi-level one.
_RADIUS, _ACROSS, _LEVELS = 0.25, 40, 4


def _measure(_: bool) -> Finding:
    grid = jt.voxelize(
        sphere(_RADIUS, subdivisions=5), 2 * _RADIUS / _ACROSS, "dominant_axis"
    )
    irregular = jt.IrregularMultiLevel(grid)
    built = {
        "single shell": jt.SingleShell(grid),
        "multi-level": jt.MultiLevel(grid, levels=_LEVELS),
        "irregular multi-level": irregular,
    }
    tiles, most = [], 0
    for name, structure in built.items():
        shown = Slice(structure, 1, _ACROSS / 2 - 0.5)
        most = max(most, shown.levels)
        fraction = structure.node_count / grid.solid_count
        note = f"{structure.node_count:,} nodes, {fraction:.0%} of the voxels"
        tiles.append(Tile(shown.pixels, name, note))
    picture = sheet(tiles, level_legend(most), "Slices of a sphere", columns=3)
    cover = irregular.coverage()
    rows = (
        *(
            Row(f"nodes over voxels, {name}", None, s.node_count / grid.solid_count)
            for name, s in built.items()
        ),
        Row(
            "volume of irregular cells over the body's",
            "1, total capacity kept",
            irregular.capacity_ratio,
        ),
        Row("overlap of irregular cells over the body", "some", cover.overlap),
        Row("cracks between them", "some", cover.crack),
        Row("parts of them outside the body", None, cover.outside),
    )
    reason = (
        "The three structures are built as the figure has them: each level of the "
        "irregular one has cells twice as wide. They overlap in "
        f"{cover.overlap:.1%} of the sphere and leave {cover.crack:.1%} in cracks, so "
        f"that they hold {irregular.capacity_ratio:.3f} of its capacity: the total "
        "is not kept without scaling, which `keep_capacity` does."
    )
    chosen = (
        ("sphere", f"{_ACROSS} voxels across"),
        ("levels", f"{_LEVELS} of single voxels; as many irregular ones as fit"),
    )
    caption = (
        "From left to right: single shell, multi-level, irregular multi-level. Where "
        "cells overlap the smaller one is drawn above."
    )
    return Finding(
        Verdict.DIFFERENT,
        reason,
        rows,
        {"C15": (Verdict.REPRODUCED, _c15(irregular, cover))},
        chosen,
        (Picture("figure-4.8", picture, caption),),
        {
            "capacity_ratio": irregular.capacity_ratio,
            "overlap": cover.overlap,
            "crack": cover.crack,
            "outside": cover.outside,
            "nodes": {name: s.node_count for name, s in built.items()},
            "voxels": grid.solid_count,
        },
    )


def _c15(irregular: jt.IrregularMultiLevel, cover) -> str:
    return (
        f"On a sphere {cover.overlap:.1%} overlap and {cover.crack:.1%} cracks: "
        f"{irregular.capacity_ratio:.3f} of the capacity."
    )


EXHIBIT = Exhibit(
    name="figure-4.8",
    title="slices of the structures of a sphere",
    place="4.3, figure 4.8",
    claims=("C15",),
    measure=_measure,
)
