"""Areas of contact that have closed forms, and two ways to find them (5.3).

The thesis compares depths texel by texel: a texel of A is in contact if B, rendered
along the same axis into A's pixels, has a depth within a threshold of its own. The
library follows 4 x 4 rays for each voxel through both bodies, and requires that the
surfaces face each other, for a distance normal to them.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypedDict

import numpy as np
from jaxtyping import Bool

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, cylinder, sphere
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import find_contacts
from jaxthermo.raster.fragments import DepthLayers, peel
from jaxthermo.voxels.lattice import pixel_axes


class Touching(NamedTuple):
    """Two bodies that touch, as voxels."""

    a: PlacedGrid
    b: PlacedGrid


def ball_on_plate(
    voxels: int, max_threshold: float, thickness: float | None = None
) -> Touching:
    """A ball of radius 1 on a plate, both of voxels of which so many are its diameter.

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
    return Touching(
        PlacedGrid(_grid(mesh, pitch), jt.Pose(position), "ball"),
        PlacedGrid(plate, jt.Pose((0.0, 0.0, -thickness / 2)), "plate"),
    )


def cap_area(threshold: float) -> float:
    """Area of a plane that is nearer than a threshold to a unit ball on it."""
    return float(np.pi * (1 - (1 - threshold) ** 2))


_OFFSET = 0.9
"""Distance of the axes of two cylinders along x, over the radius."""
_CYLINDER_HEIGHT = 0.6


def two_cylinders(voxels: int) -> Touching:
    """Upright cylinders of radius 1, B on top of A and moved along x."""
    pitch = 2.0 / voxels
    grid = _grid(cylinder(1.0, _CYLINDER_HEIGHT, 512), pitch)
    # Off the symmetry of A's lattice by fractions of a voxel.
    position = (_OFFSET + 0.013 * pitch, 0.21 * pitch, _CYLINDER_HEIGHT)
    return Touching(
        PlacedGrid(grid, jt.Pose(), "A"), PlacedGrid(grid, jt.Pose(position), "B")
    )


def lens_area(touching: Touching) -> float:
    """Area that two circles of radius 1 have in common."""
    x, y, _ = touching.b.pose.translation
    half = float(np.hypot(x, y)) / 2
    return float(2 * (np.arccos(half) - half * np.sqrt(1 - half * half)))


def _grid(mesh: jt.Mesh, pitch: float) -> jt.VoxelGrid:
    # One fragment a texel, as the thesis stores them.
    return jt.voxelize(mesh, pitch, "dominant_axis")


def rendered(a: PlacedGrid, b: PlacedGrid, axis: int) -> DepthLayers:
    """Depth layers of B in the pixels of A's lattice along an axis, in cells."""
    lattice = a.grid.lattice
    corners = lattice.to_cells(a.pose.to_body(b.pose.to_world(b.grid.mesh.vertices)))
    row_axis, column_axis = pixel_axes(axis)
    frame = corners[b.grid.mesh.faces][..., [column_axis, row_axis, axis]]
    return peel(
        np.ascontiguousarray(frame), lattice.shape[column_axis], lattice.shape[row_axis]
    )


def touching_texels(
    a: PlacedGrid, b: PlacedGrid, threshold: float
) -> Bool[np.ndarray, " s"]:
    """Texels of A with a depth of B within a threshold [m] of theirs (5.3)."""
    grid = a.grid
    is_touching = np.zeros(len(grid.fragment_area), bool)
    cells = grid.lattice.to_cells(grid.fragment_position)
    within = threshold / a.pitch
    for axis in range(3):
        layers = rendered(a, b, axis)
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


class Areas(NamedTuple):
    """Area of contact in square radii, by texels of either body and by rays."""

    texels_a: float
    """Texels of A in contact times the square of a voxel's edge, as in the thesis."""
    texels_b: float
    """Texels of B in contact times the square of a voxel's edge."""
    rays: float
    """The library's area, one for both bodies."""


def contact_areas(touching: Touching, threshold: float) -> Areas:
    """Areas of contact within a threshold [radii]."""
    a, b = touching
    return Areas(
        texels_a=float(touching_texels(a, b, threshold).sum()) * a.pitch**2,
        texels_b=float(touching_texels(b, a, threshold).sum()) * a.pitch**2,
        rays=float(find_contacts(a, b, threshold).area.sum()),
    )


COARSE = 16
"""Voxels across: the coarse resolution of the thesis."""
SHOWN = 64
"""Voxels across in pictures."""
FIXED = 1 / 16
"""Threshold that stays at all resolutions [radii]: convergence shows only there."""
CYLINDERS = "cylinders"
BALL = "ball on a plate"
BALL_VOXEL = "ball on a plate, within a voxel"
_THRESHOLDS = (1 / 64, 1 / 32, FIXED, 1 / 8, 1 / 4)


class ContactRow(TypedDict):
    """Areas of one case in square radii, and their errors."""

    case: str
    voxels_across: int
    threshold: float
    exact: float
    texels_a: float
    texels_b: float
    rays: float
    error_percent: dict[str, float]
    """Errors by the name of each area."""


def _row(
    case: str,
    *,
    voxels: int,
    threshold: float,
    exact: float,
    areas: Areas,
) -> ContactRow:
    error_percent = {
        name: 100 * (area / exact - 1) for name, area in areas._asdict().items()
    }
    return ContactRow(
        case=case,
        voxels_across=voxels,
        threshold=threshold,
        exact=exact,
        texels_a=areas.texels_a,
        texels_b=areas.texels_b,
        rays=areas.rays,
        error_percent=error_percent,
    )


def _ball_row(
    case: str, touching: Touching, *, voxels: int, threshold: float
) -> ContactRow:
    return _row(
        case,
        voxels=voxels,
        threshold=threshold,
        exact=cap_area(threshold),
        areas=contact_areas(touching, threshold),
    )


def by_resolution(resolutions: Sequence[int]) -> list[ContactRow]:
    """Areas of all cases within one voxel and within a fixed threshold."""
    rows = []
    for voxels in resolutions:
        pitch = 2.0 / voxels
        rows.append(_cylinder_row(voxels, pitch))
        ball = ball_on_plate(voxels, max(pitch, FIXED))
        for case, threshold in ((BALL, FIXED), (BALL_VOXEL, pitch)):
            row = _ball_row(case, ball, voxels=voxels, threshold=threshold)
            rows.append(row)
    return rows


def _cylinder_row(voxels: int, threshold: float) -> ContactRow:
    touching = two_cylinders(voxels)
    return _row(
        CYLINDERS,
        voxels=voxels,
        threshold=threshold,
        exact=lens_area(touching),
        areas=contact_areas(touching, threshold),
    )


def by_threshold() -> list[ContactRow]:
    """Areas at the resolution of pictures within several thresholds."""
    ball = ball_on_plate(SHOWN, max(_THRESHOLDS))
    rows = []
    for threshold in _THRESHOLDS:
        row = _ball_row(BALL, ball, voxels=SHOWN, threshold=threshold)
        rows.append(row)
        rows.append(_cylinder_row(SHOWN, threshold))
    return rows
