"""Claims C02 and C03: what one body radiates at another, by their distance (5.1)."""

from typing import Any

import altair as alt
import numpy as np
from rich.table import Table

from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.pose import Pose
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.radiation.patches import group_patches
from jaxthermo.physics.radiation.view_factors import (
    DEFAULT_DIRECTIONS,
    PatchedBody,
    view_factors,
)
from jaxthermo.reference.view_factor import parallel_rectangles
from jaxthermo.report.chart import Chart, LogAxis
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize


HOT, COLD = 400.0, 300.0
"""The thesis' 100 K of difference [K]."""
THESIS_FLUX = 31.15
"""[W/m^2] at THESIS_DISTANCE."""
THESIS_DISTANCE = 10.0
"""[m]"""
SUN = 1000.0
"""What the thesis compares with [W/m^2]."""
GAPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Between two cubes, in sizes of one."""
VOXELS = 20
"""Of a cube along an edge."""
PATCHES = 96
EXCESS = STEFAN_BOLTZMANN * (HOT**4 - COLD**4)
"""Of black emission at the two temperatures [W/m^2]."""


def measure_thesis_flux() -> dict[str, Any]:
    """C02: 31.15 W/m^2 at 10 m, beside what a black square metre radiates there."""
    square = EXCESS * parallel_rectangles(1.0, 1.0, THESIS_DISTANCE)
    small = EXCESS / (np.pi * THESIS_DISTANCE**2)
    slip = EXCESS * np.pi / THESIS_DISTANCE**2
    return {
        "thesis_W_m2": THESIS_FLUX,
        "two_squares_of_1_m_W_m2": square,
        "small_emitter_E_over_pi_R2_W_m2": small,
        "E_pi_over_R2_W_m2": slip,
        "thesis_over_right": THESIS_FLUX / small,
        "pi_squared": float(np.pi**2),
        "edge_of_squares_that_give_it_m": _edge_for(THESIS_FLUX),
    }


def _edge_for(flux: float) -> float:
    """Of two squares 10 m apart that exchange so much, by bisection [m]."""
    low, high = 1e-3, 1e3
    for _ in range(100):
        middle = np.sqrt(low * high)
        found = EXCESS * parallel_rectangles(middle, middle, THESIS_DISTANCE)
        low, high = (middle, high) if found < flux else (low, middle)
    return float(low)


def measure_neighbours(
    gaps: tuple[float, ...] = GAPS, directions: int = DEFAULT_DIRECTIONS
) -> list[dict[str, Any]]:
    """C03: two black cubes of 1 m, 100 K apart, face to face.

    The flux onto the side of the cold one that faces the hot one, by the closed form
    and by the view factors of the voxelized cubes.

    Args:
        gaps: between them, in sizes of one.
        directions: views from the one to the other.
    """
    cube = voxelize(box((1.0, 1.0, 1.0)), 1.0 / VOXELS)
    return [_neighbours(cube, gap, directions) for gap in gaps]


def _neighbours(cube: VoxelGrid, gap: float, directions: int) -> dict[str, Any]:
    exact = parallel_rectangles(1.0, 1.0, gap)
    bodies = tuple(_body(cube, shift) for shift in (0.0, 1.0 + gap))
    count = bodies[0].patches.count
    views = view_factors(bodies, directions)
    found = float(views.between[:count, count:].sum())
    # An insulated wall is as warm as what it sees: hot neighbour and surroundings.
    wall = (exact * HOT**4 + (1 - exact) * COLD**4) ** 0.25
    return {
        "gap_sizes": gap,
        "view_factor": exact,
        "view_factor_of_voxels": found,
        "error_of_voxels": found / exact - 1,
        "flux_W_m2": EXCESS * exact,
        "flux_of_voxels_W_m2": EXCESS * found,
        "share_of_100_K_excess": exact,
        "share_of_sun": EXCESS * exact / SUN,
        "insulated_wall_missed_K": float(wall - COLD),
    }


def _body(cube: VoxelGrid, shift: float) -> PatchedBody:
    pose = Pose(translation=(shift, 0.0, 0.0))
    patches = group_patches(
        cube.fragment_position,
        cube.fragment_normal,
        cube.fragment_area,
        cube.lattice,
        PATCHES,
    )
    return PatchedBody(pose.to_world(cube.mesh.triangles), patches, pose)


def reach_of_ten_percent() -> float:
    """The gap, in sizes, up to which a tenth of the view is the other cube."""
    low, high = 0.01, 100.0
    for _ in range(100):
        middle = np.sqrt(low * high)
        more = parallel_rectangles(1.0, 1.0, middle) > 0.1
        low, high = (middle, high) if more else (low, middle)
    return float(low)


def neighbour_chart(rows: list[dict[str, Any]]) -> Chart:
    """Flux against gap: closed form as a line, voxels as points, both claims as rules.

    Args:
        rows: of `measure_neighbours`.
    """
    gaps = np.geomspace(rows[0]["gap_sizes"], rows[-1]["gap_sizes"], 60)
    line = [
        {"gap": g, "flux": EXCESS * parallel_rectangles(1.0, 1.0, g)}
        for g in gaps.tolist()
    ]
    dots = [
        {
            "gap": row["gap_sizes"],
            "flux": row["flux_of_voxels_W_m2"],
            "text": f"{row['gap_sizes']:g} sizes: {row['flux_of_voxels_W_m2']:.4g} "
            "W/m^2",
        }
        for row in rows
    ]
    levels = [
        {"flux": SUN, "text": "sun on the ground, 1000"},
        {"flux": THESIS_FLUX, "text": "thesis at 10 m, 31.15"},
    ]
    across = LogAxis([float(g) for g in gaps], "gap between two cubes [sizes of one]")
    up = LogAxis([SUN, line[-1]["flux"]], "net flux onto the facing side [W/m²]")
    x, y = alt.X(**across.channel("gap")), alt.Y(**up.channel("flux"))
    data = lambda values: alt.Chart(alt.Data(values=values))
    rule = data(levels).mark_rule(strokeDash=[5, 4], color="#7a808c").encode(y=y)
    text = data(levels).mark_text(align="right", dx=-6, dy=-7, fontSize=12)
    marks = data(dots).mark_point(filled=True, size=70, opacity=1, color="#c1272d")
    chart = alt.layer(
        rule,
        text.encode(y=y, x=alt.value(640), text="text:N"),
        data(line).mark_line(color="#20242c", strokeWidth=2).encode(x=x, y=y),
        marks.encode(x=x, y=y, description="text:N"),
    )
    title = "A black cube 100 K hotter: line, closed form; points, voxels"
    return chart.properties(width=640, height=380, title=title)


COLUMNS = (
    "gap / size", "F", "F, voxels", "error", "W/m^2", "of the sun's 1000 W/m^2",
    "insulated wall misses",
)  # fmt: skip


def neighbour_cells(row: dict[str, Any]) -> list[str]:
    """One row of the table, as text."""
    return [
        f"{row['gap_sizes']:g}",
        f"{row['view_factor']:.5f}",
        f"{row['view_factor_of_voxels']:.5f}",
        f"{row['error_of_voxels']:+.2%}",
        f"{row['flux_W_m2']:.4g}",
        f"{row['share_of_sun']:.1%}",
        f"{row['insulated_wall_missed_K']:.3g} K",
    ]


def neighbour_table(rows: list[dict[str, Any]]) -> Table:
    """For the terminal."""
    table = Table(title="C03: two black cubes, 400 K and 300 K, face to face")
    for name in COLUMNS:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*neighbour_cells(row))
    return table
