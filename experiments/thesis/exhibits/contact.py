"""5.3: areas of contact by resolution and threshold, and the textures behind them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image

from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.report.chart import Chart
from jaxthermo.report.sheet import Legend, Tile, enlarged, sheet
from jaxthermo.voxels.textures import depth_colours, packed_images

from ..contact import (
    BALL,
    BALL_VOXEL,
    COARSE,
    CYLINDERS,
    FIXED,
    SHOWN,
    ContactRow,
    Touching,
    ball_on_plate,
    by_resolution,
    by_threshold,
    cap_area,
    contact_areas,
    rendered,
    touching_texels,
    two_cylinders,
)
from ..exhibit import Finding, Verdict, exhibit
from ..line_chart import log_chart, point
from ..shaded import BODIES, box_corners, camera_on, in_world, shaded, with_box


# Voxels across.
_QUICK = (8, COARSE, 32, SHOWN)
_FULL = (*_QUICK, 128, 256)
# Largest error of an area at the finest resolution [%].
_MAX_ERROR_PERCENT = 2.0
_METHODS = {"texels_a": "by texels", "rays": "by rays"}
# Of a picture [px]; with x to the left, as textures of z have it.
_EDGE = 300
_DIRECTION = (0.3, -0.8, -0.5)
_SURFACE = (150, 184, 208)
_CONTACT = (226, 120, 40)
_NOTHING = (16, 17, 20)
_LEGEND = Legend(
    (("in contact", _CONTACT), ("surface", _SURFACE), ("no surface", _NOTHING))
)


@exhibit("figure-5.4", "5.3, figure 5.4")
def _areas_of_contact(quick: bool) -> Finding:
    """Find the contact of two cylinders and of a ball on a plate."""
    resolutions = _QUICK if quick else _FULL
    rows = by_resolution(resolutions)
    thresholds = by_threshold()
    lens = [row for row in rows if row["case"] == CYLINDERS]
    disc = [row for row in rows if row["case"] == BALL]
    within_voxel = [row for row in rows if row["case"] == BALL_VOXEL]
    worst = max(
        abs(row["error_percent"][method])
        for row in (lens[-1], disc[-1])
        for method in _METHODS
    )
    grid = two_cylinders(SHOWN).a.grid
    coarse = next(row for row in disc if row["voxels_across"] == COARSE)
    # Of a plate thinner than the threshold.
    thin = contact_areas(ball_on_plate(SHOWN, FIXED, FIXED / 2), FIXED)
    two_sided = coarse["texels_b"] / coarse["texels_a"]
    return Finding(
        # Areas are found, but hang on a threshold.
        Verdict.DIFFERENT if worst < _MAX_ERROR_PERCENT else Verdict.CONTRADICTED,
        {
            "by_resolution": rows,
            "by_threshold": thresholds,
            "lens": lens[-1],
            "disc": disc[-1],
            "within_voxel": [within_voxel[0]["rays"], within_voxel[-1]["rays"]],
            "compared": len(grid.fragment_area) / grid.solid_count,
            "two_sided": two_sided,
            "two_sided_difference": abs(two_sided - 1),
            "thin_plate_over_exact": thin.texels_b / cap_area(FIXED),
        },
        {
            "figure-5.4": _cylinder_textures(),
            "figure-5.4-plate": _plate_textures(
                sorted({COARSE, SHOWN, resolutions[-1]})
            ),
            "figure-5.4-error": _error_chart(lens + disc),
            "figure-5.4-threshold": _threshold_chart(thresholds),
        },
    )


def _error_chart(rows: Sequence[ContactRow]) -> Chart:
    points = [
        point(
            f"{row['case']}, {method}",
            row["voxels_across"],
            abs(row["error_percent"][key]),
            f"{row['voxels_across']} voxels: {row['error_percent'][key]:+.2g} %",
        )
        for row in rows
        for key, method in _METHODS.items()
    ]
    title = "Area of contact against the closed form"
    return log_chart(points, "voxels across", "error of the area [%]", title)


def _threshold_chart(rows: Sequence[ContactRow]) -> Chart:
    closed_forms = []
    by_rays = []
    for row in rows:
        threshold = row["threshold"]
        text = f"{row['case']}: {row['rays']:.4f}"
        closed_forms.append(
            point(f"{row['case']}, closed form", threshold, row["exact"])
        )
        by_rays.append(point("found by rays", threshold, row["rays"], text, mark=True))
    return log_chart(
        closed_forms + by_rays,
        "threshold of depth / radius",
        "area of contact / radius²",
        "Area of contact over the threshold",
    )


def _cylinder_textures() -> Image.Image:
    """The steps of the figure, from the bodies to the texture of A."""
    touching = two_cylinders(SHOWN)
    a, b = touching
    grid = a.grid
    height = grid.lattice.to_cells(grid.fragment_position)[:, 2]
    texture = enlarged(packed_images(grid, 2, _grey(height, grid))[-1], _EDGE)
    layers = rendered(a, b, 2)
    background = np.array(_NOTHING, np.uint8)
    of_b = layers.image(0, _grey(layers.depth, grid), background)
    texels = touching_texels(a, b, a.pitch)
    tiles = [
        Tile(_bodies(touching, len(texture)), "A, with B on top", "and the box of A"),
        # Of the two layers of A along z the last one is the face that B stands on.
        Tile(texture, "voxelized texture of A", "depth, last z layer"),
        Tile(enlarged(of_b[::-1, ::-1], _EDGE), "B in the box of A", "depth, first"),
        _texture_tile(a, texels, "texture T_A"),
    ]
    title = f"Two cylinders in contact, {SHOWN} voxels across"
    return sheet(tiles, _LEGEND, title, columns=4)


def _grey(depth: np.ndarray, grid: Any) -> np.ndarray:
    # One scale for both bodies, from the bottom of A to the top of B.
    return depth_colours(1 - np.clip(depth / (2 * grid.lattice.shape[2]), 0, 1))


def _bodies(touching: Touching, size: int) -> np.ndarray:
    bounds = touching.a.world_bounds
    meshes = [in_world(body) for body in touching]
    points = np.concatenate([box_corners(bounds), *(mesh.vertices for mesh in meshes)])
    camera = camera_on(points, _DIRECTION, size)
    bodies, _ = shaded([*zip(meshes, BODIES, strict=True)], camera)
    return with_box(bodies, camera, bounds)


def _texture_tile(body: PlacedGrid, texels: np.ndarray, name: str) -> Tile:
    colours = np.array([_SURFACE, _CONTACT], np.uint8)[texels.astype(int)]
    layer = packed_images(body.grid, 2, colours)[-1]
    return Tile(enlarged(layer, _EDGE), name, f"{np.count_nonzero(texels)} in contact")


def _plate_textures(resolutions: Sequence[int]) -> Image.Image:
    """The texture of a plate under a ball, at several resolutions."""
    tiles = []
    for voxels in resolutions:
        ball, plate = ball_on_plate(voxels, FIXED)
        texels = touching_texels(plate, ball, FIXED)
        tiles.append(_texture_tile(plate, texels, f"{voxels} voxels across the ball"))
    title = "Texture of a plate under a ball, within 1/16 of its radius"
    return sheet(tiles, _LEGEND, title)
