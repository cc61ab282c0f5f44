"""Claims on radiation (5.1): C02, C03, C04, and occlusion on and off."""

from pathlib import Path
from typing import Any

from rich.console import Console

from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.chart import write_chart
from jaxthermo.report.table import Cell, Table

from . import radiation_bodies as bodies, radiation_light as light
from .radiation_occlusion import show_occlusion


HEIGHT = 110
"""Of the figurine, in voxels."""
TITLE = "Radiation: the thesis' claims"


def run(folder: Path, height: int = HEIGHT) -> dict[str, Any]:
    """C02, C03, C04 and the pictures of occlusion, with `report.html`.

    Args:
        folder: for the chart, the pictures and the page.
        height: of the figurine, in voxels.
    """
    console = Console()
    flux = bodies.measure_thesis_flux()
    rows = bodies.measure_neighbours()
    console.print(bodies.neighbour_table(rows))
    lit = light.measure_light()
    console.print(light.light_table(lit))
    shown = show_occlusion(folder, height)
    reach = bodies.reach_of_ten_percent()
    sections = [
        *_thesis_flux(flux),
        *_neighbours(rows, reach, folder),
        *_light(lit),
        *_occlusion(shown, folder),
    ]
    with replacing(folder / "report.html") as path:
        path.write_text(page.document(TITLE, sections), encoding="utf-8")
    return {
        "C02": flux,
        "C03": {"rows": rows, "ten_percent_up_to_sizes": reach},
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


def _neighbours(rows: list[dict], reach: float, folder: Path) -> list[page.Section]:
    chart = write_chart(bodies.neighbour_chart(rows), folder / "neighbours")
    return [
        page.heading("C03: other bodies do not matter"),
        page.paragraph(
            "At 10 m, less so than the thesis says; near by they do. Two black cubes "
            "of 1 m stand face to face, 400 K and 300 K, in surroundings at 300 K. Up "
            f"to a gap of {reach:.2f} sizes more than a tenth of the view is the other "
            "cube. The last column is what an insulated black wall on the cold side "
            "would miss of its temperature, were the neighbour left out."
        ),
        Table(list(bodies.COLUMNS), [bodies.neighbour_cells(r) for r in rows]),
        chart,
    ]


def _light(lit: dict[str, Any]) -> list[page.Section]:
    night = lit["terminator"]
    cells = [
        [
            *light.light_cells(c),
            Cell("1 %" if c["passes"] else "over", c["passes"]),
        ]
        for c in lit["checks"]
    ]
    return [
        page.heading("C04: shadow map and Lambert's cosine"),
        Table([*light.COLUMNS, "within"], cells),
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
