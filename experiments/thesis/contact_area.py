"""Claim C18 and figure 5.3: the area of contact of a ball on a plate, by resolution."""

import time
from pathlib import Path
from typing import Any

import altair as alt
import numpy as np
from rich.table import Table

from jaxthermo.geometry.pose import Pose
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.image.annotate import write_png
from jaxthermo.image.contact_texture import contact_images, where_covered
from jaxthermo.image.palette import palette_table
from jaxthermo.physics.contact.bodies import PlacedGrid
from jaxthermo.physics.contact.search import find_contacts
from jaxthermo.report.chart import LogAxis, write_chart
from jaxthermo.report.sheet import ColourBar, Tile, sheet
from jaxthermo.voxels.voxelize import voxelize


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
    """Of a plane nearer to a ball of radius 1 that touches it than the threshold."""
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
    """Contact area against the cap's, whichever body is looked at first."""
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


def area_table(rows: list[dict[str, Any]]) -> Table:
    """For the terminal."""
    table = Table(title="C18: contact of a ball of radius 1 on a plate")
    for head in ("threshold", "voxels", "pairs", "area", "exact", "off", "swapped"):
        table.add_column(head, justify="left" if head == "threshold" else "right")
    table.add_column("time", justify="right")
    for row in sorted(rows, key=lambda row: row["threshold"]):
        table.add_row(
            row["threshold"],
            str(row["voxels_across"]),
            str(row["pairs"]),
            f"{row['area']:.5f}",
            f"{row['area_exact']:.5f}",
            f"{row['error_percent']:+.2f} %",
            f"{row['swapped_percent']:+.2f} %",
            f"{1e3 * row['time_s']:.0f} ms",
        )
    table.caption = "exact: what of the plate is nearer than the threshold"
    return table


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
        "share of each fragment in contact; grey: none",
    )
    write_png(path, sheet(tiles, bar, "A ball on a plate, within 1/16 of its radius"))
