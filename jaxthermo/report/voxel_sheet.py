"""Picture of a voxelized body, with marks on parts thinner than a voxel."""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image

from ..image.colour.canvas import averaged
from ..image.surface.camera import Camera, frame_all
from ..image.surface.visible import VisiblePoints, WorldMesh, visible_points
from ..voxels.grid import VoxelGrid
from ..voxels.surface import surface_voxels
from .sheet import Legend, Tile, sheet


# Edge of each view [pixels].
_EDGE = 560
# Samples of a pixel along each axis.
_SAMPLES = 2
_BACKGROUND = (32, 34, 40)
# sRGB of solid voxels, of those under one voxel thick, and of lost parts of the mesh.
_COLOURS = ((196, 198, 200), (244, 152, 32), (236, 40, 120))
_MEANINGS = ("solid", "under one voxel thick", "lost: no voxel here at this pitch")
_VIEWS = {
    "from the front": (-0.35, 1.0, -0.3),
    "from behind": (0.35, -1.0, -0.3),
    "from below": (-0.35, 0.6, 0.8),
}
# Brightness of faces across x, y, z, so that edges between them are seen.
_SHADES = np.array([0.72, 0.86, 1.0])
# Edges between voxels of at least this many samples are drawn darker.
_MIN_OUTLINED = 12.0
# Edge of the cube that stands for a lost fragment [voxels].
_LOST_EDGE = 0.5


class _Faces:
    """Outer faces of cubes as pairs of triangles, with a colour for each face."""

    def __init__(self, grid: VoxelGrid):
        voxels = surface_voxels(grid.solid)
        centre = grid.lattice.centres(voxels)
        thin = np.zeros(grid.lattice.shape, bool)
        thin[tuple(grid.thin.thin_voxel.T)] = True
        marking = thin[tuple(voxels.T)].astype(np.int64)
        lost = grid.thin.lost_position
        everywhere = np.ones((len(lost), 6), bool)
        half_edge = np.concatenate(
            [
                np.full(len(centre), grid.pitch / 2),
                np.full(len(lost), _LOST_EDGE * grid.pitch / 2),
            ]
        )
        is_open = np.concatenate([_open_faces(grid.solid, voxels), everywhere])
        cube, side = np.nonzero(is_open)
        middle = np.concatenate([centre, lost])[cube, None, None]
        triangles = middle + half_edge[cube, None, None, None] * _CUBE[side]
        self.triangles = triangles.reshape(-1, 3, 3)
        self.axis = side // 2
        self.sign = 2 * (side % 2) - 1
        self.kind = np.concatenate([marking, np.full(len(lost), 2)])[cube]


def _cube() -> Float[np.ndarray, "6 2 3 3"]:
    """Two triangles for each side -x, +x, -y ... of a cube of edge 2."""
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            square = np.zeros((4, 3))
            square[:, axis] = sign
            square[:, axis - 2] = [-1, 1, 1, -1]
            square[:, axis - 1] = np.array([-1, -1, 1, 1]) * sign
            sides.append(square[[[0, 1, 2], [0, 2, 3]]])
    return np.array(sides)


_CUBE = _cube()


def _open_faces(
    solid: Bool[np.ndarray, "x y z"], voxels: Int[np.ndarray, "m 3"]
) -> Bool[np.ndarray, "m 6"]:
    """Flags of the sides -x, +x, -y ... of voxels that have no solid neighbour."""
    padded = np.pad(solid, 1)
    signs = np.tile([-1, 1], 3)[:, None]
    steps = np.repeat(np.eye(3, dtype=np.int64), 2, axis=0) * signs
    neighbours = [padded[tuple((voxels + 1 + step).T)] for step in steps]
    return ~np.stack(neighbours, axis=1)


def voxel_sheet(grid: VoxelGrid) -> Image.Image:
    """Draw the voxels of a body from three sides, with thin and lost parts marked.

    Voxels are marked where the body is less than one voxel thick behind the surface;
    small cubes show where the surface is so far from any solid voxel that it is lost.
    """
    faces = _Faces(grid)
    tiles = []
    for name, direction in _VIEWS.items():
        camera = frame_all(
            faces.triangles, width=_EDGE, height=_EDGE, direction=direction
        )
        tiles.append(Tile(_view(grid, faces, camera), name))
    thin = grid.thin
    marked = zip(_MEANINGS, _COLOURS, strict=True)
    # The font of pictures has no superscripts.
    unit = "cm^2"
    lost = f"of which lost {thin.lost_area * 1e4:.4g} {unit}"
    areas = f"surface under one voxel thick: {thin.thin_area * 1e4:.4g} {unit}, {lost}"
    legend = Legend(tuple(marked), areas)
    voxels = f"{grid.solid_count:,} voxels of {grid.pitch * 1e3:.4g} mm"
    title = f"{grid.mesh.name}: {voxels}"
    return sheet(tiles, legend, title)


def voxel_view(grid: VoxelGrid, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """Draw the voxels of a body as a camera sees them, thin and lost parts marked."""
    return _view(grid, _Faces(grid), camera)


def _view(grid: VoxelGrid, faces: _Faces, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
    # Half of the faces look away from the camera, and need not be sorted by depth.
    corner = faces.triangles[::2, 0]
    to_camera = np.asarray(camera.position) - corner
    ahead = np.flatnonzero(
        to_camera[np.arange(len(corner)), faces.axis] * faces.sign > 0
    )
    corners = faces.triangles.reshape(-1, 6, 3)[ahead].reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    fine = camera.finer(_SAMPLES)
    visible = visible_points((WorldMesh(corners, triangles),), fine)
    face = ahead[visible.face // 2]
    # Size of a sample at the depth of its point.
    sample = camera.field_of_view / (_SAMPLES * camera.height) * visible.depth
    light = _SHADES[faces.axis[face]] * _outlines(
        grid, faces=faces, face=face, visible=visible, sample=sample
    )
    colours = np.array(_COLOURS)[faces.kind[face]] * light[:, None]
    return averaged(fine.frame_of(visible.pixel, colours, _BACKGROUND), _SAMPLES)


def _outlines(
    grid: VoxelGrid,
    faces: _Faces,
    face: Int[np.ndarray, " p"],
    visible: VisiblePoints,
    sample: Float[np.ndarray, " p"],
) -> Float[np.ndarray, " p"]:
    """Brightness of points: lower near an edge of a voxel that is seen large enough."""
    large = grid.pitch / sample >= _MIN_OUTLINED
    cell = grid.lattice.to_cells(visible.position)
    away = np.abs(cell - np.rint(cell))
    # Across its own axis every point of a face is on an edge of the lattice.
    away[np.arange(len(face)), faces.axis[face]] = np.inf
    near = away.min(axis=1) * grid.pitch < sample
    return np.where(large & near & (faces.kind[face] < 2), 0.6, 1.0)
