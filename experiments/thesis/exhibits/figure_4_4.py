"""Figure 4.4: the first layers of a sphere along x and z show one quarter twice."""

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.report.sheet import Legend, Tile, enlarged, sheet
from jaxthermo.voxels.lattice import peel_axes
from jaxthermo.voxels.surface import face_axes

from ..exhibit import Exhibit, Finding, Picture, Row, Verdict


# Of the sphere [m], and voxels across it.
_RADIUS, _ACROSS = 0.25, 96
_OWN, _SHARED, _NOTHING = (200, 202, 206), (226, 120, 40), (32, 34, 40)
_COLOURS = np.array([_OWN, _SHARED], np.uint8)


def _first_layers(grid: jt.VoxelGrid) -> dict[str, tuple[np.ndarray, float]]:
    """Images of the first layers along x and z, and the part that both show."""
    normals, _ = face_axes(grid.mesh)
    found = {}
    for name, axis, other in (("x", 0, 2), ("z", 2, 0)):
        layers = peel_axes(grid.mesh, grid.lattice)[axis]
        # Of a ball the first layer along an axis is where the normal is against it.
        shared = (normals[layers.triangle][:, other] < 0).astype(int)
        first = layers.layer == 0
        image = layers.image(0, _COLOURS[shared], np.array(_NOTHING, np.uint8))
        found[name] = image[::-1, ::-1], float(shared[first].mean())
    return found


def _measure(_: bool) -> Finding:
    pitch = 2 * _RADIUS / _ACROSS
    grid = jt.voxelize(sphere(_RADIUS, subdivisions=5), pitch, "dominant_axis")
    found = _first_layers(grid)
    tiles = [
        Tile(enlarged(image, 300), f"first layer along {name}", f"{part:.1%} is shared")
        for name, (image, part) in found.items()
    ]
    entries = (("only in this view", _OWN), ("in both views", _SHARED))
    picture = sheet(tiles, Legend(entries), "First layers of a sphere along x and z")
    parts = [part for _, part in found.values()]
    right = all(abs(part - 0.5) < 0.02 for part in parts)
    reason = (
        "Half of each first layer, a quarter of the sphere's surface, is in the other "
        f"one as well: {parts[0]:.1%} and {parts[1]:.1%} of the texels, exactly 1/2 of "
        "a sphere."
    )
    rows = tuple(
        Row(f"part of the first layer along {name} that is in the other", "a part", p)
        for name, (_, p) in found.items()
    )
    caption = "The same quarter of the sphere is stored along x and along z."
    return Finding(
        Verdict.REPRODUCED if right else Verdict.CONTRADICTED,
        reason,
        rows,
        chosen=(("sphere", f"{_ACROSS} voxels across"),),
        parts=(Picture("figure-4.4", picture, caption),),
        numbers={"shared": parts, "exact": 0.5},
    )


EXHIBIT = Exhibit(
    name="figure-4.4",
    title="overlap of two views of a sphere",
    place="4.2, figure 4.4",
    claims=(),
    measure=_measure,
)
