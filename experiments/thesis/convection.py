"""Claims on convection (5.4): C20, C21, the averages, bodies as cylinders (ch. 3)."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.image.colour.annotate import contact_sheet, write_png
from jaxthermo.physics.convection.nusselt import AVERAGES
from jaxthermo.raster.views import OrthographicView
from jaxthermo.report import page
from jaxthermo.report.chart import write_chart
from jaxthermo.report.table import Table
from jaxthermo.voxels.cylinders import (
    MAX_DIAMETER_RATIO,
    CylinderParts,
    cylinder_parts,
)

from ..harness.meshes import thesis_meshes, voxels_high
from ..harness.present import Rows, publish, table_of
from . import convection_cooling as cooling, convection_numbers as numbers


def run(folder: Path, height: int = 160) -> dict[str, Any]:
    """C20, C21, averages, and bodies of `height` voxels as cylinders: `report.html`."""
    curves, averages = numbers.measure_local(), numbers.measure_averages()
    cooled = _measure_cooling(folder)
    meshes = {"figurine": figurine(), **thesis_meshes()}
    divided = _measure_parts(meshes, height, folder)
    sections = [
        *_local(curves, folder),
        page.heading("Which average?"),
        "The average is the wind's choice (`average`). Where all are in their range "
        "they part by 4 % at Re 4e3, 10 % at 1e4, 22 % at 3e4; at 2e5 the largest is "
        "1.3 times the smallest. Numbers in brackets are outside the range that the "
        "correlation is given for; profile rests on recalled curves from Re 7e4 on, "
        "where it goes up and down by 2 %.",
        write_chart(numbers.average_chart(), folder / "averages"),
        numbers.average_table(averages),
        *_cooling(cooled, folder),
        *_parts(divided, folder),
    ]
    publish(folder, "Convection: the thesis' claims", sections)
    return {
        "C20": curves,
        "averages": averages,
        "C21": cooled,
        "cylinders": divided,
        "files": sorted(p.name for p in folder.iterdir() if p.suffix != ".json"),
    }


def _local(curves: Rows, folder: Path) -> list[page.Section]:
    fast = "Fast flow, as figure 5.6 (points: recalled, ±15 %)"
    charts = {
        "local_slow": numbers.local_chart(numbers.SLOW, "Slow flow, Pr 0.71"),
        "local_fast": numbers.local_chart(numbers.FAST, fast),
        "local_shape": numbers.shape_chart(),
    }
    worst = max(abs(row["average_mismatch"]) for row in curves)
    return [
        page.heading("C20: the local Nusselt number around a cylinder"),
        "Figure 5.6 as an average times 1 + Σ c_k cos kθ, k to 16, with c_k by the "
        "logarithm of Re. Whatever the c_k, the average around the cylinder is the one "
        f"that was chosen, here to {worst:.0e} of itself.",
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


def _measure_cooling(folder: Path) -> dict[str, Any]:
    """C21, the three averages and a fixed h on one cylinder."""
    case = cooling.cylinder_in_wind()
    runs = {a.name: case.run(cooling.wind(a.name)) for a in AVERAGES}
    first = runs[AVERAGES[0].name]
    write_png(folder / "cooling.png", cooling.cooling_sheet(case, first))
    choices = cooling.compare_choices(case, runs)
    return {**cooling.cooled_order(case, first), "choices": choices}


def _cooling(found: dict[str, Any], folder: Path) -> list[page.Section]:
    order = found["order"][1]
    title = "C21: a cylinder that cools in the wind, by angle"
    chart = cooling.cooling_chart(found, title)
    return [
        page.heading("C21: cooling by the direction of the normal"),
        f"A cylinder at {cooling.HOT:g} K in air of {cooling.AIR:g} K that flows at "
        f"{found['speed_m_s']:g} m/s, Re {found['Re']:.3g}. After "
        f"{order['time_s']:g} s the temperatures of the side's sectors and the local "
        f"Nusselt number correlate by {order['correlation']:.2f}, their ranks by "
        f"{order['rank_correlation']:.2f}.",
        write_chart(chart, folder / "cooling_by_angle"),
        page.picture(folder / "cooling.png", "frames of the cylinder, wind from left"),
        page.paragraph(
            "Surface temperatures less their mean at each time; the wind comes from "
            "the left, as in figure 5.8.",
            note=True,
        ),
        "What the choices change. The fixed h takes as much heat from the whole "
        "surface at first as the wind does; the range that it leaves on the side is "
        "the voxels' own.",
        cooling.choice_table(found),
    ]


def _parts(divided: Rows, folder: Path) -> list[page.Section]:
    return [
        page.heading("Bodies as cylinders"),
        f"Found in {divided[0]['height_voxels']} voxels of height: connected parts of "
        "slices across the body's longest axis, joined where their diameters differ "
        f"by less than a factor of {MAX_DIAMETER_RATIO:g}. The diameter is that of "
        "the cylinder of a part's length and volume. Colours: the part each fragment "
        "belongs to; outlines: the cylinders.",
        *(
            page.picture(folder / body["picture"], f"{body['mesh']} as cylinders")
            for body in divided
        ),
        _part_table(divided),
    ]


# Hues of the parts, told apart side by side; a body with more than eight repeats them.
_COLOURS = np.array(
    [[86, 156, 214], [230, 140, 60], [110, 190, 110], [214, 96, 96]]
    + [[170, 130, 210], [200, 180, 80], [90, 190, 190], [220, 130, 180]],
    np.uint8,
)
_PAPER, _INK = (16, 17, 20), (236, 236, 238)
# Height of a picture, about [px].
_TALL = 560
# Level views, so that z is up in every picture; two, since parts hide each other.
_VIEWS = {"looking along +y": (0.0, 1.0, 0.0), "looking along -x": (-1.0, 0.0, 0.0)}
# Pixel over pitch: a fragment paints two by two pixels, which leaves no holes.
_PIXEL = 0.8


def _measure_parts(meshes: dict[str, jt.Mesh], height: int, folder: Path) -> Rows:
    """The cylinders of each body, and a picture of them."""
    found = []
    for name, mesh in meshes.items():
        grid = voxels_high(mesh, height)
        parts = cylinder_parts(grid)
        file = f"cylinders_{name.lower().replace(' ', '_')}.png"
        tiles = [_parts_picture(grid, parts, view) for view in _VIEWS]
        write_png(folder / file, contact_sheet(tiles, len(tiles)))
        head = {"mesh": name, "height_voxels": height}
        found.append({**head, "parts": parts.rows(), "picture": file})
    return found


def _parts_picture(grid: jt.VoxelGrid, parts: CylinderParts, name: str) -> Image.Image:
    """Fragments in the colours of their parts, and the outlines of the cylinders."""
    view = _upright_view(grid, _VIEWS[name])
    pixels = _painted(grid, parts, view)
    factor = max(1, round(_TALL / view.height))
    large = pixels.repeat(factor, axis=0).repeat(factor, axis=1)
    image = Image.fromarray(np.ascontiguousarray(large))
    draw = ImageDraw.Draw(image)
    for number, cylinder in enumerate(parts.cylinders):
        corners = _outline(cylinder, view) * factor
        bright = (128 + _COLOURS[number % len(_COLOURS)] // 2).tolist()
        draw.line([tuple(c) for c in corners], fill=tuple(bright), width=2)
    font = ImageFont.load_default(size=max(12, image.height // 34))
    draw.text((8, 6), name, fill=_INK, font=font)
    return image


def _painted(
    grid: jt.VoxelGrid, parts: CylinderParts, view: OrthographicView
) -> UInt8[np.ndarray, "h w 3"]:
    seen = view.project(grid.fragment_position)
    facing = -(grid.fragment_normal @ view.frame[2])
    shown = np.flatnonzero(facing > 0)
    # Painted from the back to the front.
    shown = shown[np.argsort(-seen[shown, 2], kind="stable")]
    light = 0.35 + 0.65 * facing[shown, None]
    colour = _COLOURS[parts.fragment[shown] % len(_COLOURS)] * light
    pixels = np.full((view.height, view.width, 3), _PAPER, np.uint8)
    row, column = (seen[shown, axis].astype(int) for axis in (1, 0))
    for down, right in ((1, 1), (1, 0), (0, 1), (0, 0)):
        pixels[row + down, column + right] = colour.astype(np.uint8)
    return pixels


def _upright_view(grid: jt.VoxelGrid, direction: tuple) -> OrthographicView:
    down = np.array([0.0, 0.0, -1.0])
    frame = np.stack([np.cross(down, direction), down, np.asarray(direction)])
    seen = grid.mesh.triangles.reshape(-1, 3) @ frame.T
    low, pixel = seen.min(0), _PIXEL * grid.pitch
    # A margin of four pixels, for outlines that are wider than the body.
    size = np.ceil(np.ptp(seen, axis=0)[:2] / pixel).astype(int) + 8
    corner = low - np.array([4.0, 4.0, 0.0]) * pixel
    return OrthographicView(frame, corner, pixel, int(size[0]), int(size[1]))


def _outline(cylinder: jt.Cylinder, view: OrthographicView) -> Float[np.ndarray, "5 2"]:
    # A closed rectangle around what one sees of a cylinder [pixels].
    axis = cylinder.direction
    across = np.cross(axis, view.frame[2])
    # A cylinder seen end on has no direction across: it becomes a point.
    across = across / max(np.linalg.norm(across), 1e-9) * cylinder.diameter / 2
    along = axis * (cylinder.length or 0.0) / 2
    middle = np.asarray(cylinder.axis_point)
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))
    corners = np.stack([middle + a * along + b * across for a, b in signs])
    return view.project(corners)[:, :2]


def _part_table(found: Rows) -> Table:
    # The cylinders of each body, the largest first.
    rows = [{**row, "body": b["mesh"]} for b in found for row in b["parts"]]
    columns = [
        ("body", "{body}"),
        ("part", "{part}"),
        ("diameter [mm]", lambda row: f"{1e3 * row['diameter_m']:.1f}"),
        ("length [mm]", lambda row: f"{1e3 * row['length_m']:.1f}"),
        ("axis", "({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f})"),
        ("fragments", "{fragments:,}"),
    ]
    return table_of(rows, columns, "Bodies as cylinders")
