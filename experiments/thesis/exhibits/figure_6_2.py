"""Figure 6.2: overlaps and cracks of irregular levels, in two readings of the text."""

import numpy as np

import jaxthermo as jt
from jaxthermo.report.sheet import Tile, sheet

from ..bodies import AXES, buddha
from ..coverage import HEIGHT, LEVELS, measured, readings, regions
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..slices import Slice, cover_legend, cover_picture, level_legend, with_frames


# Of a voxel [px].
_EDGE = 4


def _plane(grid: jt.VoxelGrid) -> int:
    """Slice across the thesis' z with the most of the left hand."""
    hand = grid.solid & regions()["left hand"]
    return int(hand.sum(axis=(0, 2)).argmax())


def _frame(grid: jt.VoxelGrid) -> tuple[int, int, int, int]:
    """Left hand in a picture of a slice [px]."""
    x, _, z = np.nonzero(regions()["left hand"])
    high = grid.lattice.shape[2]
    ends = (x.min(), high - 1 - z.max(), x.max() + 1, high - z.min())
    left, top, right, bottom = (int(end) * _EDGE for end in ends)
    return left + 1, top + 1, right - 2, bottom


def _pictures(grid: jt.VoxelGrid) -> tuple[Picture, Picture]:
    plane, axis, frame = _plane(grid), AXES["z"], _frame(grid)
    cells = Slice(jt.IrregularMultiLevel(grid), axis, plane + 0.5, _EDGE)
    tile = Tile(with_frames(cells.pixels, [frame]), "cells by depth")
    covered = [
        Tile(
            with_frames(
                cover_picture(each.count[:, plane], grid.solid[:, plane], _EDGE),
                [frame],
            ),
            each.name,
            f"{each.levels} levels",
        )
        for each in readings()
    ]
    at = f"slice at {(plane + 0.5) * grid.pitch * 1e3:.0f} mm along z"
    shown = sheet([tile], level_legend(cells.levels), f"Levels, {at}")
    cover = sheet(covered, cover_legend(), f"Cells that cover a voxel, {at}")
    framed = "Framed: the part of the left hand."
    return (
        Picture(
            "figure-6.2-cells",
            shown,
            f"Cells of the irregular levels; smaller ones are drawn above. {framed}",
        ),
        Picture(
            "figure-6.2-cover",
            cover,
            "Overlaps and cracks in both readings; of the halved copies also without "
            f"those whose centre is outside. {framed}",
        ),
    )


def _measure(_: bool) -> Finding:
    statue = buddha()
    grid, found = statue.grid(HEIGHT, "dominant_axis"), measured()
    depth, copies = found["by depth"], found["halved copies"]
    kept = found["halved copies, centres inside"]
    hand, whole = depth["left hand"], depth["whole statue"]
    reason = (
        f"By depth {whole['overlap']:.1%} of the statue overlap and "
        f"{whole['crack']:.1%} are in cracks, and the two cancel: the capacity is "
        f"{whole['capacity']:.3f} of the body's, in the left hand "
        f"{hand['capacity']:.3f}. {LEVELS} levels do not fit so: {depth['levels']} "
        "reach the middle. A texture of 100 texels halves to a single one in "
        f"{LEVELS} levels, which is the other reading; then the capacity is "
        f"{copies['whole statue']['capacity']:.0f} times the body's, and "
        f"{kept['whole statue']['capacity']:.1f} times if copies with their centre "
        f"outside are dropped ({kept['left hand']['capacity']:.1f} in the left hand)."
    )
    rows = []
    for name, each in found.items():
        said = LEVELS if "levels" in each else None
        rows.append(Row(f"levels, {name}", said, each["levels"]))
        for at in regions():
            share = each[at]
            rows.append(
                Row(
                    f"capacity over the body's, {at}, {name}",
                    "over or not enough",
                    share["capacity"],
                    f"overlap {share['overlap']:.3g}, crack {share['crack']:.3g}, "
                    f"outside {share['outside']:.3g}",
                )
            )
    chosen = (
        *statue.stands_in,
        ("size", f"{HEIGHT} voxels high, as in the thesis, in both sizes of this page"),
        (
            "by depth",
            "level l has cells of 2^l voxels in what is deeper than 2^l - 1; as our "
            "structure has them",
        ),
        (
            "halved copies",
            "each level is the texture above at half size, moved inward by its width",
        ),
        ("left hand", "the part above 84 % of the height on the statue's left"),
    )
    numbers = {"thesis_levels": LEVELS, "readings": found}
    return Finding(
        Verdict.DIFFERENT, reason, tuple(rows), {}, chosen, _pictures(grid), numbers
    )


EXHIBIT = Exhibit(
    name="figure-6.2",
    title="cracks and overlaps of irregular levels",
    place="6.1, figure 6.2",
    claims=("C15",),
    measure=_measure,
)
