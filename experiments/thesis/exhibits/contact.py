"""5.3: areas of contact by resolution and threshold, and the textures behind them.

The thesis compares depths texel by texel: a texel of A is in contact if B, rendered
along the same axis into A's pixels, has a depth within a threshold of its own. The
library follows 4 x 4 rays for each voxel through both bodies, and requires that the
surfaces face each other, for a distance normal to them. Closed forms judge both.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool
from PIL import Image

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, cylinder, sphere
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import find_contacts
from jaxthermo.raster.fragments import DepthLayers, peel
from jaxthermo.report.chart import Chart
from jaxthermo.report.sheet import Legend, Tile, enlarged, sheet
from jaxthermo.voxels.lattice import pixel_axes
from jaxthermo.voxels.textures import depth_colours, packed_images

from ...harness.line_chart import ALONE, CurvePoint, curve, log_chart
from ..exhibit import Finding, Numbers, exhibit, judged
from ..shaded import BODIES, box_corners, camera_on, in_world, shaded, with_box


# Voxels across: the coarse resolution of the thesis.
_COARSE = 16
# Voxels across in pictures.
_SHOWN = 64
# Threshold that stays at all resolutions [radii]: convergence shows only there.
_FIXED = 1 / 16
_CYLINDERS = "cylinders"
_BALL = "ball on a plate"
_BALL_VOXEL = "ball on a plate, within a voxel"
_THRESHOLDS = (1 / 64, 1 / 32, _FIXED, 1 / 8, 1 / 4)
# Voxels across.
_QUICK = (8, _COARSE, 32, _SHOWN)
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


class _Touching(NamedTuple):
    """Two bodies that touch, as voxels."""

    a: PlacedGrid
    b: PlacedGrid


@exhibit("figure-5.4", "5.3, figure 5.4")
def _areas_of_contact(quick: bool) -> Finding:
    """Find the contact of two cylinders and of a ball on a plate."""
    resolutions = _QUICK if quick else _FULL
    rows = _by_resolution(resolutions)
    thresholds = _by_threshold()
    lens = [row for row in rows if row["case"] == _CYLINDERS]
    disc = [row for row in rows if row["case"] == _BALL]
    within_voxel = [row for row in rows if row["case"] == _BALL_VOXEL]
    worst = max(
        abs(row["error_percent"][method])
        for row in (lens[-1], disc[-1])
        for method in _METHODS
    )
    grid = two_cylinders(_SHOWN).a.voxels
    coarse = next(row for row in disc if row["voxels_across"] == _COARSE)
    # Of a plate thinner than the threshold.
    thin = contact_areas(_ball_on_plate(_SHOWN, _FIXED, _FIXED / 2), _FIXED)
    two_sided = coarse["texels_b"] / coarse["texels_a"]
    return Finding(
        # Areas are found, but hang on a threshold.
        judged(False, different=worst < _MAX_ERROR_PERCENT),
        {
            "by_resolution": rows,
            "by_threshold": thresholds,
            "lens": lens[-1],
            "disc": disc[-1],
            "within_voxel": [within_voxel[0]["rays"], within_voxel[-1]["rays"]],
            "compared": len(grid.fragment_area) / grid.solid_count,
            "two_sided": two_sided,
            "two_sided_difference": abs(two_sided - 1),
            "thin_plate_over_exact": thin.texels_b / _cap_area(_FIXED),
        },
        {
            "figure-5.4": _cylinder_textures(),
            "figure-5.4-plate": _plate_textures(
                sorted({_COARSE, _SHOWN, resolutions[-1]})
            ),
            "figure-5.4-error": _error_chart(lens + disc),
            "figure-5.4-threshold": _threshold_chart(thresholds),
        },
    )


def _error_chart(rows: Sequence[Numbers]) -> Chart:
    points = [
        CurvePoint(
            f"{row['case']}, {method}",
            x=row["voxels_across"],
            y=abs(row["error_percent"][key]),
        )
        for row in rows
        for key, method in _METHODS.items()
    ]
    return log_chart(
        points=points,
        x_title="voxels across",
        y_title="error of the area [%]",
        title="Area of contact against the closed form",
    )


def _threshold_chart(rows: Sequence[Numbers]) -> Chart:
    points = [
        CurvePoint(f"{row['case']}, closed form", x=row["threshold"], y=row["exact"])
        for row in rows
    ]
    thresholds = [row["threshold"] for row in rows]
    by_rays = [row["rays"] for row in rows]
    points += curve("found by rays", thresholds, by_rays, marks=ALONE)
    return log_chart(
        points=points,
        x_title="threshold of depth / radius",
        y_title="area of contact / radius²",
        title="Area of contact over the threshold",
    )


def _cylinder_textures() -> Image.Image:
    """The steps of the figure, from the bodies to the texture of A."""
    touching = two_cylinders(_SHOWN)
    a, b = touching
    grid = a.voxels
    height = grid.lattice.to_cells(grid.fragment_position)[:, 2]
    texture = enlarged(packed_images(grid, 2, _grey(height, grid))[-1], _EDGE)
    layers = _rendered(a, b, 2)
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
    title = f"Two cylinders in contact, {_SHOWN} voxels across"
    return sheet(tiles, _LEGEND, title, columns=4)


def _grey(depth: np.ndarray, grid: Any) -> np.ndarray:
    # One scale for both bodies, from the bottom of A to the top of B.
    height = 2 * grid.lattice.shape[2]
    return depth_colours(1 - np.clip(depth / height, 0, 1))


def _bodies(touching: _Touching, size: int) -> np.ndarray:
    bounds = touching.a.world_bounds
    meshes = [in_world(body) for body in touching]
    points = np.concatenate([box_corners(bounds), *(mesh.vertices for mesh in meshes)])
    camera = camera_on(points, _DIRECTION, size)
    bodies = shaded([*zip(meshes, BODIES, strict=True)], camera)
    return with_box(bodies, camera, bounds)


def _texture_tile(body: PlacedGrid, texels: np.ndarray, name: str) -> Tile:
    colours = np.array([_SURFACE, _CONTACT], np.uint8)[texels.astype(int)]
    layer = packed_images(body.voxels, 2, colours)[-1]
    return Tile(enlarged(layer, _EDGE), name, f"{np.count_nonzero(texels)} in contact")


def _plate_textures(resolutions: Sequence[int]) -> Image.Image:
    """The texture of a plate under a ball, at several resolutions."""
    tiles = []
    for voxels in resolutions:
        ball, plate = _ball_on_plate(voxels, _FIXED)
        texels = touching_texels(plate, ball, _FIXED)
        tiles.append(_texture_tile(plate, texels, f"{voxels} voxels across the ball"))
    title = "Texture of a plate under a ball, within 1/16 of its radius"
    return sheet(tiles, _LEGEND, title)


def _ball_on_plate(
    voxels: int, max_threshold: float, thickness: float | None = None
) -> _Touching:
    """A ball of radius 1 on a plate, both in voxels of one size.

    Args:
        voxels: across the ball.
        max_threshold: largest one that the plate is wide enough for.
        thickness: of the plate; thicker than the threshold if None.
    """
    pitch = 2.0 / voxels
    # The facets stay well under a voxel.
    mesh = sphere(1.0, min(int(np.log2(voxels)) + 1, 7))
    width = 2.2 * float(np.sqrt(2 * max_threshold)) + 4 * pitch
    thickness = 4 * pitch + max_threshold if thickness is None else thickness
    plate = _grid(box((width, width, thickness)), pitch)
    # Off the lattice's symmetry, where errors of opposite fragments would cancel.
    position = (0.013 * pitch, 0.21 * pitch, -float(mesh.bounds[0, 2]))
    return _Touching(
        PlacedGrid(_grid(mesh, pitch), jt.Pose(position), "ball"),
        PlacedGrid(plate, jt.Pose((0.0, 0.0, -thickness / 2)), "plate"),
    )


def _cap_area(threshold: float) -> float:
    """Area of a plane that is nearer than a threshold to a unit ball on it."""
    return float(np.pi * (1 - (1 - threshold) ** 2))


_OFFSET = 0.9
"""Distance of the axes of two cylinders along x, over the radius."""
_CYLINDER_HEIGHT = 0.6


def two_cylinders(voxels: int) -> _Touching:
    """Upright cylinders of radius 1, B on top of A and moved along x."""
    pitch = 2.0 / voxels
    grid = _grid(cylinder(1.0, _CYLINDER_HEIGHT, 512), pitch)
    # Off the symmetry of A's lattice by fractions of a voxel.
    position = (_OFFSET + 0.013 * pitch, 0.21 * pitch, _CYLINDER_HEIGHT)
    return _Touching(
        PlacedGrid(grid, jt.Pose(), "A"), PlacedGrid(grid, jt.Pose(position), "B")
    )


def lens_area(touching: _Touching) -> float:
    """Area that two circles of radius 1 have in common."""
    x, y, _ = touching.b.pose.translation
    half = float(np.hypot(x, y)) / 2
    triangle = half * np.sqrt(1 - half * half)
    return float(2 * (np.arccos(half) - triangle))


def _grid(mesh: jt.Mesh, pitch: float) -> jt.VoxelGrid:
    # One fragment a texel, as the thesis stores them.
    return jt.voxelize(mesh, pitch, "dominant_axis")


def _rendered(a: PlacedGrid, b: PlacedGrid, axis: int) -> DepthLayers:
    """Depth layers of B in the pixels of A's lattice along an axis, in cells."""
    lattice = a.grid.lattice
    in_the_world = b.pose.to_world(b.grid.mesh.vertices)
    corners = lattice.to_cells(a.pose.to_body(in_the_world))
    row_axis, column_axis = pixel_axes(axis)
    frame = corners[b.grid.mesh.faces][..., [column_axis, row_axis, axis]]
    return peel(
        np.ascontiguousarray(frame), lattice.shape[column_axis], lattice.shape[row_axis]
    )


def touching_texels(
    a: PlacedGrid, b: PlacedGrid, threshold: float
) -> Bool[np.ndarray, " s"]:
    """Texels of A with a depth of B within a threshold [m] of theirs (5.3)."""
    grid = a.voxels
    is_touching = np.zeros(len(grid.fragment_area), bool)
    cells = grid.lattice.to_cells(grid.fragment_position)
    within = threshold / a.pitch
    for axis in range(3):
        layers = _rendered(a, b, axis)
        texels = np.flatnonzero(grid.fragment_axis == axis)
        if not len(layers.depth) or not len(texels):
            continue
        row, column = (
            np.floor(cells[texels, across]).astype(np.int64)
            for across in pixel_axes(axis)
        )
        depth = cells[texels, axis]
        low = min(depth.min(), layers.depth.min()) - within
        # Pixel and depth as one number, which B's layers are sorted by.
        span = max(depth.max(), layers.depth.max()) + within - low + 1
        of_b = layers.pixel * span + (layers.depth - low)
        of_a = (row * layers.width + column) * span + (depth - low)
        first = np.searchsorted(of_b, of_a - within, "left")
        is_touching[texels] = np.searchsorted(of_b, of_a + within, "right") > first
    return is_touching


class _Areas(NamedTuple):
    """Area of contact in square radii, by texels of either body and by rays."""

    texels_a: float
    """Texels of A in contact times the square of a voxel's edge, as in the thesis."""
    texels_b: float
    """Texels of B in contact times the square of a voxel's edge."""
    rays: float
    """The library's area, one for both bodies."""


def contact_areas(touching: _Touching, threshold: float) -> _Areas:
    """Areas of contact within a threshold [radii]."""
    a, b = touching
    return _Areas(
        texels_a=float(touching_texels(a, b, threshold).sum()) * a.pitch**2,
        texels_b=float(touching_texels(b, a, threshold).sum()) * a.pitch**2,
        rays=float(find_contacts(a, b, threshold).area.sum()),
    )


def _row(
    case: str, touching: _Touching, *, voxels: int, threshold: float, exact: float
) -> Numbers:
    areas = contact_areas(touching, threshold)._asdict()
    return {
        "case": case,
        "voxels_across": voxels,
        "threshold": threshold,
        "exact": exact,
        **areas,
        "error_percent": {
            method: 100 * (area / exact - 1) for method, area in areas.items()
        },
    }


def _by_resolution(resolutions: Sequence[int]) -> list[Numbers]:
    """Areas of all cases within one voxel and within a fixed threshold."""
    rows = []
    for voxels in resolutions:
        pitch = 2.0 / voxels
        cylinders = two_cylinders(voxels)
        ball = _ball_on_plate(voxels, max(pitch, _FIXED))
        for case, touching, threshold, exact in (
            (_CYLINDERS, cylinders, pitch, lens_area(cylinders)),
            (_BALL, ball, _FIXED, _cap_area(_FIXED)),
            (_BALL_VOXEL, ball, pitch, _cap_area(pitch)),
        ):
            row = _row(case, touching, voxels=voxels, threshold=threshold, exact=exact)
            rows.append(row)
    return rows


def _by_threshold() -> list[Numbers]:
    """Areas at the resolution of pictures within several thresholds."""
    ball = _ball_on_plate(_SHOWN, max(_THRESHOLDS))
    cylinders = two_cylinders(_SHOWN)
    rows = []
    for threshold in _THRESHOLDS:
        for case, touching, exact in (
            (_BALL, ball, _cap_area(threshold)),
            (_CYLINDERS, cylinders, lens_area(cylinders)),
        ):
            row = _row(case, touching, voxels=_SHOWN, threshold=threshold, exact=exact)
            rows.append(row)
    return rows
