"""Section 5.3: the broad phase of contact in scenes of more and more boxes."""

import numpy as np

import jaxthermo as jt
from jaxthermo.report.sheet import Legend, Tile, sheet
from jaxthermo.report.table import Table

from ...harness.present import Rows, table_of
from ..exhibit import Exhibit, Finding, Picture, Plot, Row, Verdict
from ..line_chart import log_chart, point
from ..pruning import Pairs, box_scene, measure_pruning
from ..shaded import Colour, camera_on, in_world, shaded


_COUNTS, _QUICK_COUNTS = (10, 20, 40, 80, 160), (10, 20, 40)
# Of the picture.
_SHOWN = 40
_EDGE, _DIRECTION = 480, (-0.5, 0.8, -0.45)
_TOUCHES, _KEPT, _LEFT_OUT = (226, 120, 40), (240, 212, 96), (170, 178, 190)
_STAGES = {
    "possible": "all pairs",
    "after_boxes": "boxes overlap",
    "after_views": "no view separates",
    "touching": "touch",
}


def _picture(pairs: Pairs) -> Picture:
    bodies = box_scene(_SHOWN)
    touching, kept = (
        {box for pair in each for box in pair} for each in reversed(pairs)
    )
    parts: list[tuple[jt.Mesh, Colour]] = []
    for number, body in enumerate(bodies):
        near = _KEPT if number in kept else _LEFT_OUT
        parts.append((in_world(body), _TOUCHES if number in touching else near))
    points = np.concatenate([mesh.vertices for mesh, _ in parts])
    seen, _ = shaded(parts, camera_on(points, _DIRECTION, _EDGE))
    legend = Legend(
        (
            ("touches another box", _TOUCHES),
            ("searched in vain", _KEPT),
            ("left out", _LEFT_OUT),
        )
    )
    alone = _SHOWN - len(kept)
    tile = Tile(seen, f"{_SHOWN} boxes", f"{alone} are in no pair that is searched")
    caption = "The scene of 40 boxes by what the broad phase makes of each."
    return Picture("section-5.3-scene", sheet([tile], legend, "Broad phase"), caption)


def _chart(rows: Rows) -> Plot:
    points = [
        point(name, row["bodies"], row[key], f"{row['bodies']} boxes: {row[key]} pairs")
        for key, name in _STAGES.items()
        for row in rows
    ]
    chart = log_chart(points, "boxes in the scene", "pairs", "Pairs left to search")
    caption = (
        "All pairs grow with the square of the boxes; those that are left, at an equal "
        "density, with their number."
    )
    return Plot("section-5.3-pairs", chart, caption)


def _table(rows: Rows) -> Table:
    columns = [
        ("boxes", "{bodies}"),
        *((name, f"{{{key}}}") for key, name in _STAGES.items()),
        ("lost", "{lost}"),
        ("left out", lambda row: f"{1 - row['after_views'] / row['possible']:.1%}"),
        ("broad phase", "{broad_s:.2f} s"),
        ("search", "{search_s:.2f} s"),
        ("search of all", "{search_of_all_pairs_s:.2f} s"),
    ]
    return table_of(rows, columns, "Pairs of boxes", left=())


def _measure(quick: bool) -> Finding:
    counts = _QUICK_COUNTS if quick else _COUNTS
    found = {count: measure_pruning(count) for count in counts}
    rows = [row for row, _ in found.values()]
    last, lost = rows[-1], sum(row["lost"] for row in rows)
    touching = sum(row["touching"] for row in rows)
    out = {row["bodies"]: 1 - row["after_views"] / row["possible"] for row in rows}
    tests = last["possible"] / last["after_views"]
    sharper = 1 - last["after_views"] / last["after_boxes"]
    time = last["search_of_all_pairs_s"] / (last["broad_s"] + last["search_s"])
    power = np.polyfit(np.log(counts), np.log([r["after_views"] for r in rows]), 1)[0]
    reason = (
        f"Of {touching} touching pairs in scenes of {counts[0]} to {counts[-1]} boxes "
        f"the broad phase loses {lost}, against a search of every pair. Of "
        f"{last['bodies']} boxes it leaves out {out[counts[-1]]:.1%} of the pairs, "
        f"{tests:.0f} times fewer to search; those that are left grow with the number "
        f"of boxes to the power of {power:.1f}, all pairs with its square. Views along "
        f"three axes, the thesis' CULLIDE, leave out {sharper:.0%} of the pairs whose "
        "bounding boxes overlap."
    )
    shown = tuple(
        Row(
            f"pairs left out of {row['possible']}, {row['bodies']} boxes",
            None,
            f"{out[row['bodies']]:.1%}",
            f"{row['after_views']} searched, {row['touching']} touch, "
            f"{row['lost']} lost",
        )
        for row in rows
    )
    shown += (
        Row(
            "pairs that views leave out of those of boxes",
            "more precise than boxes",
            f"{sharper:.1%}",
        ),
        Row(
            f"time of a search of all pairs over both phases', {last['bodies']} boxes",
            None,
            time,
        ),
    )
    chosen = (
        ("boxes", "bricks, cubes and rods, turned at random; a third of each"),
        ("density", "the same at every number, so that some touch"),
        ("threshold", "one voxel, 2 cm; boxes of 0.1 to 1 m"),
    )
    right = lost == 0 < touching and sharper > 0
    verdict = Verdict.REPRODUCED if right else Verdict.CONTRADICTED
    parts = (_picture(found[_SHOWN][1]), _chart(rows), _table(rows))
    return Finding(verdict, reason, shown, {}, chosen, parts, {"rows": rows})


EXHIBIT = Exhibit(
    name="section-5.3-broad-phase",
    title="pairs of bodies that need not be searched",
    place="5.3",
    claims=("C19",),
    measure=_measure,
)
