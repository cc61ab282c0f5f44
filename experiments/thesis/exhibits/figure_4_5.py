"""Figure 4.5: depth, normal, largest component and preserved area of a sphere."""

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.report.sheet import Legend, Tile, enlarged, sheet
from jaxthermo.voxels.textures import AXIS_COLOURS, layer_images

from ..exhibit import Exhibit, Finding, Picture
from ..layers import judged, storage, storage_rows


# Of the sphere [m], and voxels across it.
_RADIUS, _ACROSS = 0.25, 96


def _picture(grid: jt.VoxelGrid):
    images = layer_images(grid)
    depth, normal, dominant = (
        images[f"x_{kind}"][0] for kind in ("depth", "normal", "dominant")
    )
    along_x = (dominant == AXIS_COLOURS[0]).all(axis=-1)
    # The dark of the other images, which is in their corners.
    kept = np.where(along_x[..., None], dominant, dominant[0, 0])
    shown = (
        (depth, "(a) depth", "bright is near"),
        (normal, "(b) normal n", "(n + 1) / 2 as red, green, blue"),
        (dominant, "(c) largest |n|", "red x, green y, blue z"),
        (kept, "(d) preserved", "along x"),
    )
    tiles = [Tile(enlarged(image, 260), name, note) for image, name, note in shown]
    red, green, blue = ((int(r), int(g), int(b)) for r, g, b in AXIS_COLOURS[:3])
    entries = (("x", red), ("y", green), ("z", blue))
    legend = Legend(entries, "axis with the largest component of the normal")
    return sheet(tiles, legend, "First texture of a sphere along x", columns=4)


def _measure(_: bool) -> Finding:
    pitch = 2 * _RADIUS / _ACROSS
    grid = jt.voxelize(sphere(_RADIUS, subdivisions=6), pitch, "dominant_axis")
    found = storage(grid)
    verdict, reason = judged("Sphere", found)
    # 6 max |n| over 3 |n|, averaged over the directions, of a sphere.
    exact = _kept_of_a_sphere()
    reason += (
        f" {found['stored_over_peeled']:.1%} of the texels are kept, {exact:.1%} of an "
        "exact sphere."
    )
    caption = (
        "The texture along x as the figure has it: (a) depth, (b) normal, (c) red, "
        "green or blue where the normal's largest component is along x, y or z, (d) "
        "what is preserved along x."
    )
    return Finding(
        verdict,
        reason,
        storage_rows(found),
        chosen=(("sphere", f"{_ACROSS} voxels across"),),
        parts=(Picture("figure-4.5", _picture(grid), caption),),
        numbers=found,
    )


def _kept_of_a_sphere() -> float:
    """Mean of max |n| over that of |n_x| + |n_y| + |n_z|, over all directions."""
    count = 400
    z = (np.arange(count) + 0.5) / count
    angle = (np.arange(count) + 0.5) / count * np.pi / 2
    across = np.sqrt(1 - z**2)[:, None]
    x, y = across * np.cos(angle), across * np.sin(angle)
    largest = np.maximum(np.maximum(x, y), z[:, None])
    return float(largest.mean() / (x + y + z[:, None]).mean())


EXHIBIT = Exhibit(
    name="figure-4.5",
    title="largest component of the normal on a sphere",
    place="4.2, figure 4.5",
    claims=("C09",),
    measure=_measure,
)
