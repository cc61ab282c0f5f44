"""Chapter 3: bodies as cylinders, of which the thesis takes the convection."""

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw
from scipy.spatial import KDTree

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.image.surface.visible import VisiblePoints
from jaxthermo.report.sheet import Legend, Tile, sheet
from jaxthermo.voxels.cylinders import CylinderParts, cylinder_parts

from ...harness.meshes import thesis_meshes, voxels_high
from ..exhibit import Finding, Numbers, Verdict, exhibit
from ..shaded import camera_on, lit, on_picture


# Hues of the parts, told apart side by side; a body with more than eight repeats them.
_COLOURS = np.array(
    [[86, 156, 214], [230, 140, 60], [110, 190, 110], [214, 96, 96]]
    + [[170, 130, 210], [200, 180, 80], [90, 190, 190], [220, 130, 180]],
    np.uint8,
)
# Edge of a picture [px].
_EDGE = 560
# Level views, so that z is up in every picture; two, since parts hide each other.
_VIEWS = {"looking along +y": (0.0, 1.0, 0.0), "looking along -x": (-1.0, 0.0, 0.0)}


@exhibit("section-3-cylinders", "3")
def _bodies_as_cylinders(quick: bool) -> Finding:
    """Divide bodies into the cylinders that stand for them in wind."""
    height = 60 if quick else 160
    pictures = {}
    rows: list[Numbers] = []
    for name, mesh in {"figurine": figurine(), **thesis_meshes()}.items():
        grid = voxels_high(mesh, height)
        division = cylinder_parts(grid)
        tiles = [Tile(picture_of_parts(grid, division, view), view) for view in _VIEWS]
        legend = Legend((), "colours: parts of the body; lines: their cylinders")
        file = f"cylinders_{name.lower().replace(' ', '_')}"
        pictures[file] = sheet(tiles, legend, f"{name} as cylinders")
        rows += [{"body": name, **row} for row in division.rows()]
    return Finding(
        Verdict.NOT_REPRODUCIBLE, {"height_voxels": height, "rows": rows}, pictures
    )


def picture_of_parts(
    grid: jt.VoxelGrid, division: CylinderParts, view_name: str
) -> UInt8[np.ndarray, "h w 3"]:
    """A body in the colours of its parts, and the outlines of the cylinders."""
    direction = _VIEWS[view_name]
    outlines = [_outline(one, np.array(direction)) for one in division.cylinders]
    points = np.concatenate([grid.mesh.vertices, *outlines])
    camera = camera_on(points, direction, _EDGE)
    fragments = KDTree(grid.fragment_position)

    def colours_of_parts(seen: VisiblePoints) -> UInt8[np.ndarray, "p 3"]:
        _, nearest = fragments.query(seen.position)
        return _COLOURS[division.fragment[nearest] % len(_COLOURS)]

    image = Image.fromarray(lit([grid.mesh], camera, colours_of_parts))
    draw = ImageDraw.Draw(image)
    for number, outline in enumerate(outlines):
        corners = on_picture(outline, camera)
        dark = (_COLOURS[number % len(_COLOURS)] // 2).tolist()
        draw.line(corners.ravel().tolist(), fill=tuple(dark), width=2)
    return np.asarray(image)


def _outline(
    cylinder: jt.Cylinder, ahead: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "5 3"]:
    """A closed rectangle around what one sees of a cylinder from a direction [m]."""
    axis = cylinder.direction
    normal = np.cross(axis, ahead)
    # A cylinder seen end on has no direction across: it becomes a point.
    across = normal / max(np.linalg.norm(normal), 1e-9) * cylinder.diameter / 2
    along = axis * (cylinder.length or 0.0) / 2
    middle = np.asarray(cylinder.axis_point)
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))
    return np.stack([middle + a * along + b * across for a, b in signs])
