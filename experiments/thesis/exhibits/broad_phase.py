"""5.3: pairs of boxes in a scene that are left to search for contact."""

from collections.abc import Mapping, Sequence, Set
from functools import cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.contact.overlap import require_shallow
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import (
    broad_phase,
    contacts_between,
    find_contacts,
)
from jaxthermo.report.chart import Chart
from jaxthermo.report.sheet import Legend, Tile, sheet
from jaxthermo.timing import timed_call

from ...harness.line_chart import curves, log_chart
from ...harness.power_law import power
from ..exhibit import Finding, Numbers, exhibit, judged
from ..shaded import camera_on, in_world, shaded


_QUICK_COUNTS = (10, 20, 40)
_COUNTS = (*_QUICK_COUNTS, 80, 160)
# Boxes in the picture.
_PICTURED = 40
# A turned rod fills little of its bounding box: boxes alone prune it badly.
_SIZES = (
    (0.5, 0.4, 0.3),
    (0.4, 0.4, 0.4),
    (0.1, 0.1, 1.0),
)
_PITCH = 0.02
# Edge of the scene's cube over the cube root of the number of boxes [m]: so dense that
# some touch at every count, and so that each has as many neighbours.
_SPACING = 0.7
_SEED = 7
_STAGES = {
    "all pairs": "possible",
    "boxes overlap": "after_boxes",
    "no view separates": "after_views",
    "touch": "touching",
}

_PairSet = Set[tuple[int, int]]


class _Pairs(NamedTuple):
    """Pairs of boxes of a scene."""

    searched: _PairSet
    """Pairs that the broad phase leaves."""
    touching: _PairSet
    """Pairs in contact, of all pairs."""


@exhibit("section-5.3-broad-phase", "5.3")
def _pairs_left_out(quick: bool) -> Finding:
    """Count pairs after boxes, after views and after the search, in several scenes."""
    counts = _QUICK_COUNTS if quick else _COUNTS
    measured = {count: measure_pruning(count) for count in counts}
    rows = [row for row, _ in measured.values()]
    last = rows[-1]
    lost = sum(row["lost"] for row in rows)
    touching = sum(row["touching"] for row in rows)
    sharper = 1 - last["after_views"] / last["after_boxes"]
    both_phases = last["broad_s"] + last["search_s"]
    left = [row["after_views"] for row in rows]
    is_right = lost == 0 < touching and sharper > 0
    return Finding(
        judged(is_right),
        {
            "rows": rows,
            "lost": lost,
            "touching": touching,
            "left_out": 1 - last["after_views"] / last["possible"],
            "times_fewer": last["possible"] / last["after_views"],
            "views_beyond_boxes": sharper,
            "power": power(counts, left),
            "times_faster": last["search_of_all_pairs_s"] / both_phases,
        },
        {
            "section-5.3-scene": _picture(measured[_PICTURED][1]),
            "section-5.3-pairs": _chart(rows),
        },
    )


@cache
def _box_scene(count: int) -> tuple[PlacedGrid, ...]:
    """Boxes in a cube at random positions and turns, none deep in another."""
    random = np.random.default_rng((_SEED, count))
    grids = [jt.voxelize(box(size), _PITCH) for size in _SIZES]
    edge = _SPACING * count ** (1 / 3)
    bodies: list[PlacedGrid] = []
    while len(bodies) < count:
        # Four normal numbers, made a unit quaternion, are an evenly distributed turn.
        turn = Rotation.from_quat(random.normal(size=4), scalar_first=True)
        rows = tuple(tuple(row) for row in turn.as_matrix().tolist())
        x, y, z = random.uniform(-edge / 2, edge / 2, 3).tolist()
        grid = grids[len(bodies) % len(grids)]
        candidate = PlacedGrid(grid, jt.Pose((x, y, z), rows), f"{len(bodies)}")
        if all(_is_shallow(candidate, body) for body in bodies):
            bodies.append(candidate)
    return tuple(bodies)


def _is_shallow(a: PlacedGrid, b: PlacedGrid) -> bool:
    try:
        require_shallow(a, b, _PITCH)
    except jt.InputError:
        return False
    return True


def measure_pruning(count: int) -> tuple[Numbers, _Pairs]:
    """Numbers of pairs after boxes, after views and after the search, with times."""
    bodies = _box_scene(count)
    # Once before the clock, for what is compiled.
    contacts_between(bodies)
    broad, broad_time = timed_call(lambda: broad_phase(bodies))
    searched = {(first, second) for first, second in broad.pairs.tolist()}

    def touching(pairs: _PairSet) -> _PairSet:
        return {
            (first, second)
            for first, second in pairs
            if find_contacts(bodies[first], bodies[second]).count
        }

    found_touching, search_time = timed_call(lambda: touching(searched))
    # The slow reference: every pair is searched, so that none can be lost.
    all_pairs = set(combinations(range(len(bodies)), 2))
    expected, slow_time = timed_call(lambda: touching(all_pairs))
    row = {
        "bodies": len(bodies),
        "possible": broad.possible,
        "after_boxes": broad.overlapping_boxes,
        "after_views": len(searched),
        "touching": len(expected),
        "lost": len(expected - found_touching),
        "broad_s": broad_time,
        "search_s": search_time,
        "search_of_all_pairs_s": slow_time,
    }
    return row, _Pairs(searched=searched, touching=expected)


def _picture(pairs: _Pairs) -> Image.Image:
    touching = {number for pair in pairs.touching for number in pair}
    searched = {number for pair in pairs.searched for number in pair}
    colours = {
        "touches another box": (226, 120, 40),
        "searched in vain": (240, 212, 96),
        "left out": (170, 178, 190),
    }
    coloured = []
    for number, body in enumerate(_box_scene(_PICTURED)):
        if number in touching:
            colour = colours["touches another box"]
        else:
            name = "searched in vain" if number in searched else "left out"
            colour = colours[name]
        coloured.append((in_world(body), colour))
    points = np.concatenate([mesh.vertices for mesh, _ in coloured])
    seen = shaded(coloured, camera_on(points, (-0.5, 0.8, -0.45), 480))
    note = f"{_PICTURED - len(searched)} are in no pair that is searched"
    tile = Tile(seen, f"{_PICTURED} boxes", note)
    return sheet([tile], Legend(tuple(colours.items())), "Broad phase")


def _chart(rows: Sequence[Mapping[str, Any]]) -> Chart:
    return log_chart(
        points=curves(rows, x="bodies", y=_STAGES),
        x_title="boxes in the scene",
        y_title="pairs",
        title="Pairs left to search",
    )
