"""Claims on convection (5.4): C20, C21, the averages, bodies as cylinders (ch. 3)."""

from pathlib import Path
from typing import Any

from rich.console import Console

from jaxthermo.atomic import replacing
from jaxthermo.geometry.shapes import figurine
from jaxthermo.report import page
from jaxthermo.report.chart import write_chart
from jaxthermo.voxels.cylinders import MAX_DIAMETER_RATIO

from ..harness.meshes import thesis_meshes
from . import (
    convection_cooling as cooling,
    convection_numbers as numbers,
    convection_parts as parts,
)


HEIGHT = 160
"""Height of the bodies that are divided into cylinders [voxels]."""
TITLE = "Convection: the thesis' claims"


def run(folder: Path, height: int = HEIGHT) -> dict[str, Any]:
    """C20, C21 and what the choice of the average changes, with `report.html`.

    Args:
        folder: for charts, pictures and the page.
        height: of the bodies that are divided into cylinders, in voxels.
    """
    console = Console()
    curves = numbers.measure_local()
    console.print(numbers.local_table(curves).rich())
    averages = numbers.measure_averages()
    console.print(numbers.average_table(averages).rich())
    cooled = cooling.measure_cooling(folder)
    console.print(cooling.choice_table(cooled).rich())
    meshes = {"figurine": figurine(), **thesis_meshes()}
    divided = parts.measure_parts(meshes, height, folder)
    console.print(parts.part_table(divided).rich())
    sections = [
        *_local(curves, folder),
        *_averages(averages, folder),
        *_cooling(cooled, folder),
        *_parts(divided, folder),
    ]
    with replacing(folder / "report.html") as path:
        path.write_text(page.document(TITLE, sections), encoding="utf-8")
    return {
        "C20": curves,
        "averages": averages,
        "C21": cooled,
        "cylinders": divided,
        "files": sorted(p.name for p in folder.iterdir() if p.suffix != ".json"),
    }


def _local(curves: list[dict[str, Any]], folder: Path) -> list[page.Section]:
    charts = {
        "local_slow": numbers.local_chart(numbers.SLOW, "Slow flow, Pr 0.71"),
        "local_fast": numbers.local_chart(
            numbers.FAST, "Fast flow, as figure 5.6 (points: recalled, ±15 %)"
        ),
        "local_shape": numbers.shape_chart(),
    }
    worst = max(abs(row["average_mismatch"]) for row in curves)
    return [
        page.heading("C20: the local Nusselt number around a cylinder"),
        page.paragraph(
            "Figure 5.6 as an average times 1 + Σ c_k cos kθ, k to 16, with c_k by "
            "the logarithm of Re. Whatever the c_k, the average around the cylinder is "
            f"the one that was chosen, here to {worst:.0e} of itself."
        ),
        page.paragraph(
            "Lines: the model. Points to Re 40: a computed steady flow. Points from "
            "Re 7.08e4 up: written down from memory of the published figure, ±15 %: "
            "they show what the model was made from, and prove nothing. Between, the "
            "front is a laminar boundary layer and the rear is fitted to the numbers.",
            note=True,
        ),
        *(write_chart(chart, folder / name) for name, chart in charts.items()),
        numbers.local_table(curves),
    ]


def _averages(rows: list[dict[str, Any]], folder: Path) -> list[page.Section]:
    return [
        page.heading("Which average?"),
        page.paragraph(
            "The average is the wind's choice (`average`). Where all are in their "
            "range they part by 4 % at Re 4e3, 10 % at 1e4, 22 % at 3e4; at 2e5 the "
            "largest is 1.3 times the smallest. Numbers in brackets are outside the "
            "range that the correlation is given for; profile rests on recalled curves "
            "from Re 7e4 on, where it goes up and down by 2 %."
        ),
        write_chart(numbers.average_chart(), folder / "averages"),
        numbers.average_table(rows),
    ]


def _cooling(found: dict[str, Any], folder: Path) -> list[page.Section]:
    return [
        page.heading("C21: cooling by the direction of the normal"),
        page.paragraph(
            f"A cylinder of {1e3 * found['diameter_m']:g} mm at {cooling.HOT:g} K in "
            f"air of {cooling.AIR:g} K that flows at {found['speed_m_s']:g} m/s, Re "
            f"{found['Re']:.3g}. After {found['times_s'][2]:g} s the temperatures of "
            "the side's sectors and the local Nusselt number correlate by "
            f"{found['correlation_of_temperature_and_number']:.2f}, their ranks by "
            f"{found['rank_correlation']:.2f}."
        ),
        write_chart(cooling.cooling_chart(found), folder / "cooling_by_angle"),
        page.picture(folder / "cooling.png", "frames of the cylinder, wind from left"),
        page.paragraph(
            "Surface temperatures, each frame on its own scale; the wind comes from "
            "the left, as in figure 5.8.",
            note=True,
        ),
        page.paragraph(
            f"What the choices change after {found['compared_at_s']:g} s. The fixed h "
            "takes as much heat from the whole surface at first as the wind does; the "
            "range that it leaves on the side is the voxels' own."
        ),
        cooling.choice_table(found),
    ]


def _parts(divided: list[dict[str, Any]], folder: Path) -> list[page.Section]:
    pictures = [
        page.picture(folder / body["picture"], f"{body['mesh']} as cylinders")
        for body in divided
    ]
    return [
        page.heading("Bodies as cylinders"),
        page.paragraph(
            f"Found in {divided[0]['height_voxels']} voxels of height: connected parts "
            "of slices across the body's longest axis, joined where their diameters "
            f"differ by less than a factor of {MAX_DIAMETER_RATIO:g}. The diameter is "
            "that of the "
            "cylinder of a part's length and volume. Colours: the part each fragment "
            "belongs to; outlines: the cylinders."
        ),
        *pictures,
        parts.part_table(divided),
    ]
