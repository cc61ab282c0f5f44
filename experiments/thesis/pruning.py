"""Boxes in a scene, and the pairs of them that are left to search for contact (5.3)."""

from functools import cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.contact.rays import PlacedGrid, require_shallow
from jaxthermo.physics.contact.search import (
    broad_phase,
    contacts_between,
    find_contacts,
)

from ..harness.timing import timed_call


# A turned rod fills little of its bounding box: boxes alone prune it badly.
_SIZES = ((0.5, 0.4, 0.3), (0.4, 0.4, 0.4), (0.1, 0.1, 1.0))
_PITCH = 0.02
# Edge of the scene's cube over the cube root of the number of boxes [m]: so dense that
# some touch at every count, and so that each has as many neighbours.
_SPACING = 0.7
_SEED = 7


@cache
def box_scene(count: int) -> tuple[PlacedGrid, ...]:
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
        body = PlacedGrid(grid, jt.Pose((x, y, z), rows), f"{len(bodies)}")
        if all(_is_shallow(body, other) for other in bodies):
            bodies.append(body)
    return tuple(bodies)


def _is_shallow(body: PlacedGrid, other: PlacedGrid) -> bool:
    try:
        require_shallow(body, other, _PITCH)
    except jt.InputError:
        return False
    return True


class Pairs(NamedTuple):
    """Pairs of boxes of a scene."""

    kept: set[tuple[int, int]]
    """Left by the broad phase."""
    touching: set[tuple[int, int]]
    """In contact, of all pairs."""


def measure_pruning(count: int) -> tuple[dict[str, Any], Pairs]:
    """Numbers of pairs after boxes, after views and after the search, with times."""
    bodies = box_scene(count)
    # Once before the clock, for what is compiled.
    contacts_between(bodies)
    broad, broad_time = timed_call(lambda: broad_phase(bodies))
    kept = {(i, j) for i, j in broad.pairs.tolist()}
    search = lambda pair: find_contacts(bodies[pair[0]], bodies[pair[1]]).count
    of = lambda pairs: {pair for pair in pairs if search(pair)}
    found, search_time = timed_call(lambda: of(kept))
    # The slow reference: every pair is searched, so that none can be lost.
    every = [*combinations(range(len(bodies)), 2)]
    expected, every_time = timed_call(lambda: of(every))
    row = {
        "bodies": len(bodies),
        "possible": broad.possible,
        "after_boxes": broad.overlapping_boxes,
        "after_views": len(kept),
        "touching": len(expected),
        "lost": len(expected - found),
        "broad_s": broad_time,
        "search_s": search_time,
        "search_of_all_pairs_s": every_time,
    }
    return row, Pairs(kept, expected)
