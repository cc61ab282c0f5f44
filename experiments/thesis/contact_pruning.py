"""Claim C19: the broad phase prunes pairs of bodies, and loses none that touch."""

import time
from typing import Any

import numpy as np
from rich.table import Table

from jaxthermo.errors import InputError
from jaxthermo.geometry.pose import Pose
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.contact.bodies import PlacedGrid, require_shallow
from jaxthermo.physics.contact.search import (
    broad_phase,
    contacts_between,
    find_contacts,
)
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize


COUNTS = (10, 20, 40, 80)
"""Bodies in a scene."""
PITCH = 0.02
SPACING = 0.7
"""Edge of the scene's cube over the cube root of the number of bodies [m]."""
SEED = 7


def shapes() -> list[VoxelGrid]:
    """A box, a ball and a rod: turned rods are what boxes tell apart badly."""
    return [
        voxelize(mesh, PITCH)
        for mesh in (box((0.5, 0.4, 0.3)), sphere(0.25, 3), box((0.1, 0.1, 1.0)))
    ]


def scene(count: int, random: np.random.Generator) -> tuple[PlacedGrid, ...]:
    """Bodies in a cube at random places and turns, none deep in another."""
    grids, edge = shapes(), SPACING * count ** (1 / 3)
    bodies: list[PlacedGrid] = []
    while len(bodies) < count:
        quaternion = random.normal(size=4)
        x, y, z = random.uniform(-edge / 2, edge / 2, 3).tolist()
        grid = grids[len(bodies) % len(grids)]
        body = PlacedGrid(grid, Pose((x, y, z), _turn(quaternion)), f"{len(bodies)}")
        try:
            for other in bodies:
                require_shallow(body, other, PITCH)
        except InputError:
            continue
        bodies.append(body)
    return tuple(bodies)


def _turn(quaternion: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    w, x, y, z = (quaternion / np.linalg.norm(quaternion)).tolist()
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return tuple(tuple(row) for row in matrix.tolist())


def measure_pruning(counts: tuple[int, ...] = COUNTS) -> list[dict[str, Any]]:
    """Pairs left after boxes, after views and after the search, by number of bodies."""
    random = np.random.default_rng(SEED)
    return [_measure(scene(count, random)) for count in counts]


def _measure(bodies: tuple[PlacedGrid, ...]) -> dict[str, Any]:
    count = len(bodies)
    contacts_between(bodies)
    start = time.perf_counter()
    broad = broad_phase(bodies)
    pruned = time.perf_counter()
    found = set(contacts_between(bodies))
    searched = time.perf_counter()
    expected = {
        (i, j)
        for i in range(count)
        for j in range(i + 1, count)
        if find_contacts(bodies[i], bodies[j]).count
    }
    brute = time.perf_counter()
    return {
        "bodies": count,
        "possible": broad.possible,
        "after_boxes": broad.overlapping_boxes,
        "after_views": len(broad.pairs),
        "touching": len(expected),
        "lost": len(expected - found),
        "bodies_left": len(broad.bodies),
        "broad_s": pruned - start,
        "broad_and_search_s": searched - pruned,
        "search_of_all_pairs_s": brute - searched,
    }


def pruning_table(rows: list[dict[str, Any]]) -> Table:
    """For the terminal."""
    table = Table(title="C19: pairs of bodies left to search")
    heads = ("bodies", "pairs", "boxes", "views", "touch", "lost")
    for head in (*heads, "broad", "and search", "search all"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        numbers = ("bodies", "possible", "after_boxes", "after_views", "touching")
        seconds = ("broad_s", "broad_and_search_s", "search_of_all_pairs_s")
        table.add_row(
            *(str(row[k]) for k in (*numbers, "lost")),
            *(f"{row[k]:.2f} s" for k in seconds),
        )
    return table
