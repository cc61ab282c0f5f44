"""Claims on contact (5.3): C18, area by resolution; C19, pruning; a ball on a head."""

import time
from pathlib import Path
from typing import Any

import altair as alt
import numpy as np
from rich.console import Console

from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.image.annotate import write_png
from jaxthermo.image.contact_texture import contact_images, where_covered
from jaxthermo.image.palette import palette_table
from jaxthermo.physics.contact.rays import PlacedGrid, require_shallow
from jaxthermo.physics.contact.search import (
    broad_phase,
    contacts_between,
    find_contacts,
)
from jaxthermo.report.chart import LogAxis, write_chart
from jaxthermo.report.numbers import seconds
from jaxthermo.report.sheet import ColourBar, Tile, sheet
from jaxthermo.report.table import Table
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize

from ..harness.meshes import thesis_meshes
from .contact_head import balls_on_heads, head_table


RESOLUTIONS = (8, 16, 32, 64, 128, 256)
"""Voxels across the ball; the thesis shows 16 and 256."""
SHOWN = (16, 64, 256)
FIXED = 1 / 16
"""The threshold that stays, in radii of the ball."""
TILE = 320
"""Edge of a picture, about [px]."""

KINDS = {"one voxel": None, "1/16 radius": FIXED}
"""Thresholds by name."""


def cap_area(threshold: float) -> float:
    """Area of a plane within a threshold of a ball of radius 1 that touches it."""
    return float(np.pi * (1 - (1 - threshold) ** 2))


def ball_on_plate(voxels: int) -> tuple[PlacedGrid, PlacedGrid]:
    """A ball of radius 1, off the lattice's symmetry, on a plate of its pitch."""
    pitch = 2.0 / voxels
    # The facets stay well under a voxel.
    mesh = sphere(1.0, min(int(np.log2(voxels)) + 1, 7))
    # As wide as the widest contact, and four voxels thick.
    width = 2.2 * float(np.sqrt(2 * max(pitch, FIXED))) + 4 * pitch
    plate = voxelize(box((width, width, 4 * pitch)), pitch)
    where = (0.013 * pitch, 0.21 * pitch, -float(mesh.bounds[0, 2]))
    return (
        PlacedGrid(voxelize(mesh, pitch), Pose(where), "ball"),
        PlacedGrid(plate, Pose((0.0, 0.0, -2 * pitch)), "plate"),
    )


def measure_areas(resolutions: tuple[int, ...] = RESOLUTIONS) -> list[dict[str, Any]]:
    """Contact area against the cap's, with either body as the first."""
    rows = []
    for voxels in resolutions:
        ball, plate = ball_on_plate(voxels)
        for kind, threshold in KINDS.items():
            find_contacts(ball, plate, threshold)
            start = time.perf_counter()
            pairs = find_contacts(ball, plate, threshold)
            seconds = time.perf_counter() - start
            swapped = float(find_contacts(plate, ball, threshold).area.sum())
            exact = cap_area(threshold or ball.pitch)
            area = float(pairs.area.sum())
            rows.append(
                {
                    "voxels_across": voxels,
                    "threshold": kind,
                    "pairs": pairs.count,
                    "area": area,
                    "area_exact": exact,
                    "error_percent": 100 * (area / exact - 1),
                    "swapped_percent": 100 * (swapped / area - 1),
                    "time_s": seconds,
                }
            )
    return rows


def area_table(found: list[dict[str, Any]]) -> Table:
    """Contact areas against the exact ones, by threshold and resolution."""
    columns = ("threshold", "voxels", "pairs", "area", "exact", "error", "swapped")
    rows = [
        [
            row["threshold"],
            str(row["voxels_across"]),
            str(row["pairs"]),
            f"{row['area']:.5f}",
            f"{row['area_exact']:.5f}",
            f"{row['error_percent']:+.2f} %",
            f"{row['swapped_percent']:+.2f} %",
            seconds(row["time_s"]),
        ]
        for row in sorted(found, key=lambda row: row["threshold"])
    ]
    title = "C18: contact of a ball of radius 1 on a plate"
    caption = "exact: area of the plate that is nearer than the threshold"
    return Table((*columns, "time"), rows, title, caption)


def area_chart(rows: list[dict[str, Any]], path: Path) -> None:
    """Area against resolution, measured and exact, as `path`.svg and .png."""
    across = LogAxis([row["voxels_across"] for row in rows], "voxels across the ball")
    up = LogAxis([row["area"] for row in rows], "area of contact / radius^2")
    points = [
        {
            "x": row["voxels_across"],
            "area": row["area"],
            "exact": row["area_exact"],
            "threshold": f"within {row['threshold']}",
            "text": f"{row['voxels_across']} voxels, within {row['threshold']}: "
            f"{row['area']:.4f}, {row['error_percent']:+.2f} % off",
        }
        for row in rows
    ]
    base = alt.Chart(alt.Data(values=points)).encode(
        x=alt.X(**across.channel("x")),
        color=alt.Color(
            "threshold:N",
            legend=alt.Legend(title=None, orient="bottom-left", offset=12),
            scale=alt.Scale(range=["#2166ac", "#c1272d"]),
        ),
    )
    lines = base.mark_line(strokeDash=[5, 4]).encode(y=alt.Y(**up.channel("exact")))
    dots = base.mark_point(filled=True, size=80, opacity=1).encode(
        y=alt.Y(**up.channel("area")), description="text:N"
    )
    title = "Ball on a plate: found (dots), exact (dashed)"
    write_chart(
        alt.layer(lines, dots).properties(width=560, height=380, title=title), path
    )


def area_sheet(path: Path, resolutions: tuple[int, ...] = SHOWN) -> None:
    """The plate's contact texture at several resolutions, after figure 5.3."""
    tiles = []
    for voxels in resolutions:
        ball, plate = ball_on_plate(voxels)
        pairs = find_contacts(ball, plate, FIXED)
        values = where_covered(pairs.coverage_b, pairs.coverage_b)
        top = contact_images(plate.grid, values)["z_contact"][-1]
        factor = max(1, round(TILE / len(top)))
        error = 100 * (pairs.area.sum() / cap_area(FIXED) - 1)
        tiles.append(
            Tile(
                top.repeat(factor, axis=0).repeat(factor, axis=1),
                f"{voxels} voxels across the ball",
                f"{pairs.count} pairs, area {error:+.2f} %",
            )
        )
    bar = ColourBar(
        palette_table("iron"),
        ((0.0, "0"), (0.5, "1/2"), (1.0, "1")),
        "fraction of each fragment in contact; grey: none",
    )
    write_png(path, sheet(tiles, bar, "A ball on a plate, within 1/16 of its radius"))


COUNTS = (10, 20, 40, 80)
"""Bodies in a scene."""
PITCH = 0.02
SPACING = 0.7
"""Edge of the scene's cube over the cube root of the number of bodies [m]."""
SEED = 7


def shapes() -> list[VoxelGrid]:
    """A box, a ball and a rod; a turned rod fills little of its bounding box."""
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
    return [_measure_scene(scene(count, random)) for count in counts]


def _measure_scene(bodies: tuple[PlacedGrid, ...]) -> dict[str, Any]:
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


def pruning_table(found: list[dict[str, Any]]) -> Table:
    """Pairs that remain after each phase, and the time of each phase."""
    numbers = ("bodies", "possible", "after_boxes", "after_views", "touching", "lost")
    durations = ("broad_s", "broad_and_search_s", "search_of_all_pairs_s")
    rows = [
        [*(str(row[k]) for k in numbers), *(f"{row[k]:.2f} s" for k in durations)]
        for row in found
    ]
    columns = ("bodies", "pairs", "boxes", "views", "touch", "lost", "broad")
    columns += ("and search", "search all")
    return Table(columns, rows, "C19: pairs of bodies left to search", left=())


HEIGHT = 60
"""Height of the heads [voxels]."""


def run(folder: Path, height: int = HEIGHT) -> dict[str, Any]:
    """C18 and C19, and the contact textures of figure 5.5.

    Args:
        folder: for the charts and pictures.
        height: of the heads, in voxels.
    """
    console = Console()
    areas = measure_areas()
    console.print(area_table(areas).rich())
    area_chart(areas, folder / "contact_area")
    area_sheet(folder / "contact_area_layers.png")
    pruning = measure_pruning()
    console.print(pruning_table(pruning).rich())
    heads = balls_on_heads(thesis_meshes(), height, folder)
    console.print(head_table(heads).rich())
    return {"C18": areas, "C19": pruning, "heads": heads}
