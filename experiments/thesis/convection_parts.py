"""Bodies as combinations of cylinders (ch. 3): the parts found, listed and drawn."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.image.annotate import contact_sheet, write_png
from jaxthermo.raster.views import OrthographicView
from jaxthermo.report.table import Table
from jaxthermo.voxels.cylinders import Cylinder, CylinderParts, cylinder_parts
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize


COLOURS = np.array(
    [[86, 156, 214], [230, 140, 60], [110, 190, 110], [214, 96, 96]]
    + [[170, 130, 210], [200, 180, 80], [90, 190, 190], [220, 130, 180]],
    np.uint8,
)
PAPER, INK = (16, 17, 20), (236, 236, 238)
TALL = 560
"""Height of a picture, about [px]."""
WAYS = {"looking along +y": (0.0, 1.0, 0.0), "looking along -x": (-1.0, 0.0, 0.0)}
"""Level, so that z is up in every picture."""
PIXEL = 0.8
"""Pixel over pitch: a fragment paints two by two pixels, which leaves no holes."""


def measure_parts(meshes: dict[str, Mesh], height: int, folder: Path) -> list[dict]:
    """The cylinders of each body, and a picture of them."""
    found = []
    for name, mesh in meshes.items():
        grid = voxelize(mesh, float(np.ptp(mesh.bounds[:, 2])) / height)
        parts = cylinder_parts(grid)
        file = f"cylinders_{name.lower().replace(' ', '_')}.png"
        tiles = [parts_picture(grid, parts, way, words) for words, way in WAYS.items()]
        write_png(folder / file, contact_sheet(tiles, len(tiles)))
        found.append(
            {
                "mesh": name,
                "height_voxels": height,
                "parts": parts.rows(),
                "picture": file,
            }
        )
    return found


def parts_picture(
    grid: VoxelGrid, parts: CylinderParts, direction: tuple, words: str
) -> Image.Image:
    """The fragments by the colour of their part, and the outlines of the cylinders."""
    view = _upright_view(grid, direction)
    pixels = _painted(grid, parts, view)
    factor = max(1, round(TALL / view.height))
    large = pixels.repeat(factor, axis=0).repeat(factor, axis=1)
    image = Image.fromarray(np.ascontiguousarray(large))
    draw = ImageDraw.Draw(image)
    for number, cylinder in enumerate(parts.cylinders):
        corners = _outline(cylinder, view) * factor
        bright = (128 + COLOURS[number % len(COLOURS)] // 2).tolist()
        draw.line([tuple(c) for c in corners], fill=tuple(bright), width=2)
    font = ImageFont.load_default(size=max(12, image.height // 34))
    draw.text((8, 6), words, fill=INK, font=font)
    return image


def _painted(
    grid: VoxelGrid, parts: CylinderParts, view: OrthographicView
) -> UInt8[np.ndarray, "h w 3"]:
    seen = view.project(grid.fragment_position)
    facing = -(grid.fragment_normal @ view.frame[2])
    shown = np.flatnonzero(facing > 0)
    # Painted from the back to the front.
    shown = shown[np.argsort(-seen[shown, 2], kind="stable")]
    light = 0.35 + 0.65 * facing[shown, None]
    colour = COLOURS[parts.fragment[shown] % len(COLOURS)] * light
    pixels = np.zeros((view.height, view.width, 3), np.uint8)
    pixels[:] = PAPER
    row, column = (seen[shown, axis].astype(int) for axis in (1, 0))
    for down, right in ((1, 1), (1, 0), (0, 1), (0, 0)):
        pixels[row + down, column + right] = colour.astype(np.uint8)
    return pixels


def _upright_view(grid: VoxelGrid, direction: tuple) -> OrthographicView:
    """Along a level direction, with z upwards and pixels to spare."""
    down = np.array([0.0, 0.0, -1.0])
    frame = np.stack([np.cross(down, direction), down, np.asarray(direction)])
    seen = grid.mesh.triangles.reshape(-1, 3) @ frame.T
    low, pixel = seen.min(0), PIXEL * grid.pitch
    size = np.ceil(np.ptp(seen, axis=0)[:2] / pixel).astype(int) + 8
    corner = low - np.array([4.0, 4.0, 0.0]) * pixel
    return OrthographicView(frame, corner, pixel, int(size[0]), int(size[1]))


def _outline(cylinder: Cylinder, view: OrthographicView) -> Float[np.ndarray, "5 2"]:
    """A closed rectangle around what one sees of a cylinder [pixels]."""
    axis = cylinder.direction
    across = np.cross(axis, view.frame[2])
    across = across / max(np.linalg.norm(across), 1e-9) * cylinder.diameter / 2
    along = axis * (cylinder.length or 0.0) / 2
    middle = np.asarray(cylinder.axis_point)
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))
    corners = np.stack([middle + a * along + b * across for a, b in signs])
    return view.project(corners)[:, :2]


def part_table(found: list[dict[str, Any]]) -> Table:
    """The cylinders of each body, the largest first."""
    rows = [
        [
            body["mesh"],
            str(row["part"]),
            f"{1e3 * row['diameter_m']:.1f}",
            f"{1e3 * row['length_m']:.1f}",
            "({:.2f}, {:.2f}, {:.2f})".format(*row["axis"]),
            f"{row['fragments']:,}",
        ]
        for body in found
        for row in body["parts"]
    ]
    columns = ("body", "part", "diameter [mm]", "length [mm]", "axis", "fragments")
    return Table(columns, rows, "Bodies as cylinders")
