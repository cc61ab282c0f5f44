"""Claims on radiation (5.1): C02, C03, C04, and occlusion on and off."""

from pathlib import Path
from typing import Any

import altair as alt
import numpy as np
from rich.console import Console

from jaxthermo.atomic import replacing
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.radiation.patches import group_patches
from jaxthermo.physics.radiation.view_factors import (
    DEFAULT_DIRECTIONS,
    PatchedBody,
    view_factors,
)
from jaxthermo.reference.view_factor import parallel_rectangles
from jaxthermo.report import page
from jaxthermo.report.chart import Chart, LogAxis, write_chart
from jaxthermo.report.table import Table
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize

from . import radiation_light as light
from .radiation_occlusion import show_occlusion


HOT, COLD = 400.0, 300.0
"""The thesis' 100 K of difference [K]."""
THESIS_FLUX = 31.15
"""[W/m^2] at THESIS_DISTANCE."""
THESIS_DISTANCE = 10.0
"""[m]"""
SUN = 1000.0
"""Irradiance of the sun, with which the thesis compares [W/m^2]."""
GAPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Between two cubes, in sizes of one."""
VOXELS = 20
"""Voxels along the edge of a cube."""
PATCHES = 96
EXCESS = STEFAN_BOLTZMANN * (HOT**4 - COLD**4)
"""Difference of black emission at the two temperatures [W/m^2]."""


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
    """Edge of two squares 10 m apart that exchange a given flux, by bisection [m]."""
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


def ten_percent_gap() -> float:
    """The gap, in sizes, up to which a tenth of the view is the other cube."""
    low, high = 0.01, 100.0
    for _ in range(100):
        middle = np.sqrt(low * high)
        more = parallel_rectangles(1.0, 1.0, middle) > 0.1
        low, high = (middle, high) if more else (low, middle)
    return float(low)


def neighbour_chart(rows: list[dict[str, Any]]) -> Chart:
    """Flux against gap: closed form (line), voxels (points) and claims (rules)."""
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


def neighbour_table(found: list[dict[str, Any]]) -> Table:
    """View factors and fluxes between the two cubes, by their gap."""
    columns = ("gap / size", "F", "F, voxels", "error", "W/m^2")
    columns += ("of the sun's 1000 W/m^2", "insulated wall misses")
    rows = [
        [
            f"{row['gap_sizes']:g}",
            f"{row['view_factor']:.5f}",
            f"{row['view_factor_of_voxels']:.5f}",
            f"{row['error_of_voxels']:+.2%}",
            f"{row['flux_W_m2']:.4g}",
            f"{row['share_of_sun']:.1%}",
            f"{row['insulated_wall_missed_K']:.3g} K",
        ]
        for row in found
    ]
    return Table(columns, rows, "C03: two black cubes, 400 K and 300 K, face to face")


FIGURINE_HEIGHT = 110
"""Height of the figurine [voxels]."""
TITLE = "Radiation: the thesis' claims"


def run(folder: Path, height: int = FIGURINE_HEIGHT) -> dict[str, Any]:
    """C02, C03, C04 and the pictures of occlusion, with `report.html`.

    Args:
        folder: for the chart, the pictures and the page.
        height: of the figurine, in voxels.
    """
    console = Console()
    flux = measure_thesis_flux()
    rows = measure_neighbours()
    console.print(neighbour_table(rows).rich())
    lit = light.measure_light()
    console.print(light.light_table(lit).rich())
    shown = show_occlusion(folder, height)
    gap = ten_percent_gap()
    sections = [
        *_thesis_flux(flux),
        *_neighbour_sections(rows, gap, folder),
        *_light(lit),
        *_occlusion(shown, folder),
    ]
    with replacing(folder / "report.html") as path:
        path.write_text(page.document(TITLE, sections), encoding="utf-8")
    return {
        "C02": flux,
        "C03": {"rows": rows, "ten_percent_up_to_sizes": gap},
        "C04": lit,
        "occlusion": shown,
        "files": ["report.html", "neighbours.svg", "neighbours.png"],
    }


def _thesis_flux(flux: dict[str, Any]) -> list[page.Section]:
    return [
        page.heading("C02: 31.15 W/m² at 10 m"),
        page.paragraph(
            "The thesis lets a body 100 K hotter send 31.15 W/m² over 10 m and fills "
            "Table 5.1 with it. Two black squares of 1 m, 400 K and 300 K, exchange "
            f"{flux['two_squares_of_1_m_W_m2']:.3g} W/m² there: "
            f"{flux['thesis_over_right']:.2f} times less. That is pi squared, 9.87: "
            "E pi / R² stands where Lambert's law has E / (pi R²)."
        ),
        Table(
            ["at 10 m", "W/m²"],
            [
                ["thesis", f"{flux['thesis_W_m2']:.2f}"],
                ["E pi / R²", f"{flux['E_pi_over_R2_W_m2']:.2f}"],
                [
                    "E A / (pi R²), 1 m²",
                    f"{flux['small_emitter_E_over_pi_R2_W_m2']:.3f}",
                ],
                ["two squares of 1 m, exact", f"{flux['two_squares_of_1_m_W_m2']:.4f}"],
            ],
        ),
        page.paragraph(
            "Squares that exchange as much would have edges of "
            f"{flux['edge_of_squares_that_give_it_m']:.2f} m. All rates of Table 5.1 "
            "are too high by the same factor.",
            note=True,
        ),
    ]


def _neighbour_sections(
    rows: list[dict], gap: float, folder: Path
) -> list[page.Section]:
    chart = write_chart(neighbour_chart(rows), folder / "neighbours")
    return [
        page.heading("C03: other bodies do not matter"),
        page.paragraph(
            "At 10 m, less so than the thesis says; near by they do. Two black cubes "
            "of 1 m stand face to face, 400 K and 300 K, in surroundings at 300 K. Up "
            f"to a gap of {gap:.2f} sizes more than a tenth of the view is the other "
            "cube. The last column is what an insulated black wall on the cold side "
            "would miss of its temperature, were the neighbour left out."
        ),
        neighbour_table(rows),
        chart,
    ]


def _light(lit: dict[str, Any]) -> list[page.Section]:
    night = lit["terminator"]
    return [
        page.heading("C04: shadow map and Lambert's cosine"),
        light.light_table(lit),
        page.paragraph(
            "The ball's night begins at 90°: the last fragment with any light stands "
            f"at {night['last_lit_degrees']:.2f}°, the first that is not lit in full "
            f"at {night['first_shaded_degrees']:.2f}°. The edge of a shadow is right "
            "to half a voxel as the source sees it."
        ),
    ]


def _occlusion(shown: dict[str, Any], folder: Path) -> list[page.Section]:
    ball = shown["ball_on_plane"]
    made: list[page.Section] = [
        page.heading("Ambient occlusion, on and off"),
        page.paragraph(
            f"The figurine, {shown['height_voxels']} voxels high: "
            f"{shown['fragments']} fragments in {shown['directions']} directions in "
            f"{shown['time_s']:.1f} s. The mean view factor to the surroundings is "
            f"{shown['view_factor_mean']:.3f}. After half an hour the surface is "
            f"{shown['warmer_mean_K']:.2f} K warmer on average with occlusion, "
            f"{shown['warmer_most_K']:.1f} K at most: the robe is cast hollow, and "
            "without occlusion its inside, too, emits to the sky. What hides the "
            "surroundings counts as being as warm as the surface that sees it."
        ),
    ]
    made += [page.picture(folder / name, name) for name in shown["pictures"]]
    made.append(
        page.paragraph(
            "On a plane below a ball, against the closed form: rays are off by "
            f"{ball['rays_rms']:.3f} RMS, the screen-space variant by "
            f"{ball['screen_rms']:.3f}, the two from each other over the whole image "
            f"by {ball['screen_less_rays_rms']:.3f}; on the figurine by "
            f"{shown['screen_less_rays_rms']:.3f}, since the image shows no backs and "
            f"looks no farther than the radius it is given."
        )
    )
    return made
