"""Chapter 3: bodies as cylinders, of which the thesis takes the convection."""

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.image.colour.annotate import contact_sheet
from jaxthermo.raster.views import OrthographicView
from jaxthermo.voxels.cylinders import CylinderParts, cylinder_parts

from ...harness.meshes import thesis_meshes, voxels_high
from ..exhibit import Finding, Numbers, Verdict, exhibit


# Hues of the parts, told apart side by side; a body with more than eight repeats them.
_COLOURS = np.array(
    [[86, 156, 214], [230, 140, 60], [110, 190, 110], [214, 96, 96]]
    + [[170, 130, 210], [200, 180, 80], [90, 190, 190], [220, 130, 180]],
    np.uint8,
)
_PAPER = (16, 17, 20)
_INK = (236, 236, 238)
# Height of a picture, about [px].
_TALL = 560
# Level views, so that z is up in every picture; two, since parts hide each other.
_VIEWS = {"looking along +y": (0.0, 1.0, 0.0), "looking along -x": (-1.0, 0.0, 0.0)}
# Pixel over pitch: a fragment paints two by two pixels, which leaves no holes.
_PIXEL = 0.8


@exhibit("section-3-cylinders", "3")
def _bodies_as_cylinders(quick: bool) -> Finding:
    """Divide bodies into the cylinders that stand for them in wind."""
    height = 60 if quick else 160
    pictures = {}
    rows: list[Numbers] = []
    for name, mesh in {"figurine": figurine(), **thesis_meshes()}.items():
        grid = voxels_high(mesh, height)
        division = cylinder_parts(grid)
        tiles = [picture_of_parts(grid, division, view) for view in _VIEWS]
        file = f"cylinders_{name.lower().replace(' ', '_')}"
        pictures[file] = contact_sheet(tiles, len(tiles))
        rows += [{"body": name, **row} for row in division.rows()]
    return Finding(
        Verdict.NOT_REPRODUCIBLE, {"height_voxels": height, "rows": rows}, pictures
    )


def picture_of_parts(
    grid: jt.VoxelGrid, division: CylinderParts, view_name: str
) -> Image.Image:
    """Fragments in the colours of their parts, and the outlines of the cylinders."""
    view = _upright_view(grid, _VIEWS[view_name])
    pixels = _painted(grid, division, view)
    factor = max(1, round(_TALL / view.height))
    large = pixels.repeat(factor, axis=0).repeat(factor, axis=1)
    image = Image.fromarray(np.ascontiguousarray(large))
    draw = ImageDraw.Draw(image)
    for number, cylinder in enumerate(division.cylinders):
        corners = _outline(cylinder, view) * factor
        bright = (128 + _COLOURS[number % len(_COLOURS)] // 2).tolist()
        draw.line([tuple(c) for c in corners], fill=tuple(bright), width=2)
    font = ImageFont.load_default(size=max(12, image.height // 34))
    draw.text((8, 6), view_name, fill=_INK, font=font)
    return image


def _painted(
    grid: jt.VoxelGrid, division: CylinderParts, view: OrthographicView
) -> UInt8[np.ndarray, "h w 3"]:
    raster = view.project(grid.fragment_position)
    facing = -(grid.fragment_normal @ view.frame[2])
    visible = np.flatnonzero(facing > 0)
    # Painted from the back to the front.
    visible = visible[np.argsort(-raster[visible, 2], kind="stable")]
    light = 0.35 + 0.65 * facing[visible, None]
    colour = _COLOURS[division.fragment[visible] % len(_COLOURS)] * light
    pixels = np.full((view.height, view.width, 3), _PAPER, np.uint8)
    row = raster[visible, 1].astype(int)
    column = raster[visible, 0].astype(int)
    for down, right in ((1, 1), (1, 0), (0, 1), (0, 0)):
        pixels[row + down, column + right] = colour.astype(np.uint8)
    return pixels


def _upright_view(
    grid: jt.VoxelGrid, direction: tuple[float, float, float]
) -> OrthographicView:
    down = np.array([0.0, 0.0, -1.0])
    frame = np.stack([np.cross(down, direction), down, np.asarray(direction)])
    corners = grid.mesh.triangles.reshape(-1, 3) @ frame.T
    pixel = _PIXEL * grid.pitch
    # A margin of four pixels, for outlines that are wider than the body.
    size = np.ptp(corners, axis=0)[:2] / pixel
    width, height = np.ceil(size).astype(int) + 8
    corner = corners.min(0) - np.array([4.0, 4.0, 0.0]) * pixel
    return OrthographicView(frame, corner, pixel, int(width), int(height))


def _outline(cylinder: jt.Cylinder, view: OrthographicView) -> Float[np.ndarray, "5 2"]:
    """A closed rectangle around what one sees of a cylinder [pixels]."""
    axis = cylinder.direction
    normal = np.cross(axis, view.frame[2])
    # A cylinder seen end on has no direction across: it becomes a point.
    across = normal / max(np.linalg.norm(normal), 1e-9) * cylinder.diameter / 2
    along = axis * (cylinder.length or 0.0) / 2
    middle = np.asarray(cylinder.axis_point)
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))
    corners = np.stack([middle + a * along + b * across for a, b in signs])
    return view.project(corners)[:, :2]
