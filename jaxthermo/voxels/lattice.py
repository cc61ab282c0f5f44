"""Lattice of cubic cells around a body: its memory, its views, and the solid cells.

Solid is what a majority of the three axes votes for, also for open meshes. Along a ray
the winding number rises by one where the ray enters the surface and falls where it
leaves. A voxel is inside for an axis if the number at its centre is not zero:
overlapping closed parts unite and cavities stay hollow. A ray on which entries and
exits do not balance has passed through a hole and does not vote.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from ..arrays import available_bytes, require_memory
from ..errors import InputError
from ..geometry.mesh import Mesh
from ..raster.fragments import DepthLayers, peel, shared_capacities


# Peak of the fill: votes, one winding number, the solid, planes of temporaries.
_BYTES_PER_CELL = 4

BYTES_PER_FRAGMENT = 150
"""Peak memory of the sort of fragments, with the padding of its arrays."""

# Corners in three views, spans of rows, normals.
_BYTES_PER_FACE = 600


@dataclass(frozen=True)
class Lattice:
    """Box of cubic cells; (i, j, k) is centred at origin + (i+1/2, ...) pitch."""

    shape: tuple[int, int, int]
    origin: Float[np.ndarray, "3"]
    """Lowest corner [m]."""
    pitch: float
    """Edge of a cell [m]."""

    def to_cells(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Convert positions [m] to units of cells from the lowest corner."""
        return (points - self.origin) / self.pitch

    def centres(self, cells: Int[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Centres of cells [m]."""
        return self.origin + (cells + 0.5) * self.pitch

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))


def _cell_counts(size: Float[np.ndarray, "3"], pitch: float) -> np.ndarray:
    # Floats, since a tiny pitch may need more cells than integers can count.
    with np.errstate(over="ignore"):
        length = size / pitch
    # A few ulp of a float32 file beyond a whole number of cells need no further cell.
    return np.maximum(np.ceil(length - 1e-6 * (1 + length)), 1)


def check_pitch(mesh: Mesh, pitch: float) -> None:
    """Refuse a pitch [m] that gives no voxels or too many, before any allocation.

    Raises:
        InputError: with a pitch that would be possible.
    """
    if not len(mesh.faces):
        raise InputError(f"{mesh.name}: has no triangles to voxelize")
    if not np.isfinite(pitch) or pitch <= 0:
        raise InputError(f"pitch {pitch!r}: give a positive length in metres")
    size = np.ptp(mesh.bounds, axis=0)
    if pitch > size.max() * (1 + 1e-6):
        raise InputError(
            f"pitch {pitch:g} m is larger than {mesh.name}, which is "
            f"{' x '.join(f'{s:.3g}' for s in size)} m: give a finer pitch, "
            "or check the mesh's unit"
        )
    counts = _cell_counts(size, pitch)
    # Along x, y and z a face covers |n_x|, |n_y| and |n_z| times its area.
    projected = float(np.abs(mesh.area_vectors).sum())
    with np.errstate(over="ignore"):
        needed = counts.prod() * _BYTES_PER_CELL
        needed += projected / pitch / pitch * BYTES_PER_FRAGMENT
    needed += len(mesh.faces) * _BYTES_PER_FACE
    require_memory(
        int(min(needed, 1e18)),
        f"voxelizing {mesh.name} at a pitch of {pitch:g} m "
        f"({' x '.join(f'{n:.6g}' for n in counts)} cells)",
        f"use a coarser pitch, such as {_affordable_pitch(size, projected):.2g} m",
    )


def _affordable_pitch(size: Float[np.ndarray, "3"], projected: float) -> float:
    """Pitch [m] that needs about half of the available memory."""
    # A quarter for the cells and a quarter for the fragments.
    quarter = available_bytes() / 4
    by_cells = np.cbrt(size.prod() * _BYTES_PER_CELL / quarter)
    by_fragments = np.sqrt(projected * BYTES_PER_FRAGMENT / quarter)
    return float(max(by_cells, by_fragments))


def lattice_around(mesh: Mesh, pitch: float) -> Lattice:
    """Smallest lattice of the given pitch [m] around a mesh and centred on it."""
    low, high = mesh.bounds
    count = _cell_counts(high - low, pitch)
    corner = (low + high) / 2 - count * pitch / 2
    nx, ny, nz = (int(n) for n in count)
    return Lattice((nx, ny, nz), corner, pitch)


def pixel_axes(axis: int) -> tuple[int, int]:
    """Lattice axes of the rows and columns of the view along `axis`."""
    # Column, row and depth are a right-handed frame, as `raster.fragments` requires.
    return (axis + 2) % 3, (axis + 1) % 3


Views = tuple[DepthLayers, DepthLayers, DepthLayers]


def peel_axes(mesh: Mesh, lattice: Lattice) -> Views:
    """Depth layers of a mesh along x, y and z; depths in cells."""
    corners = lattice.to_cells(mesh.triangles)
    views = []
    for axis in range(3):
        row_axis, column_axis = pixel_axes(axis)
        frame = np.ascontiguousarray(corners[..., [column_axis, row_axis, axis]])
        views.append((frame, lattice.shape[column_axis], lattice.shape[row_axis]))
    # One array size for the three views: one program is compiled, not three.
    rows, fragments = zip(*(shared_capacities(*view) for view in views), strict=True)
    sizes = max(rows), max(fragments)
    x, y, z = (peel(frame, width, height, sizes) for frame, width, height in views)
    return x, y, z


def first_cell_behind(depth: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Index of the first cell centre at or behind a depth, in units of cells."""
    return np.ceil(depth - 0.5).astype(np.int64)


def crossing_sign(layers: DepthLayers) -> Int8[np.ndarray, " k"]:
    """+1 where the ray enters the body, -1 where it leaves."""
    return np.where(layers.entering, 1, -1).astype(np.int8)


def balanced_rays(layers: DepthLayers) -> Bool[np.ndarray, " p"]:
    """Flag the pixels whose ray leaves the body as often as it enters."""
    pixels = layers.width * layers.height
    return np.bincount(layers.pixel, crossing_sign(layers), minlength=pixels) == 0


def _winding(
    layers: DepthLayers, axis: int, shape: tuple[int, int, int]
) -> Int8[np.ndarray, "x y z"]:
    """Winding number at each voxel centre along `axis`; 0 on rays without a vote."""
    row_axis, column_axis = pixel_axes(axis)
    cell = first_cell_behind(layers.depth)
    counts = np.flatnonzero(balanced_rays(layers)[layers.pixel] & (cell < shape[axis]))
    index: list = [None, None, None]
    index[axis] = np.maximum(cell[counts], 0)
    index[row_axis], index[column_axis] = np.divmod(layers.pixel[counts], layers.width)
    winding = np.zeros(shape, np.int8)
    # int8 may wrap in between: only the final sums must fit.
    np.add.at(winding, tuple(index), crossing_sign(layers)[counts])
    if axis == 2:
        return np.cumsum(winding, axis=2, dtype=np.int8, out=winding)
    planes = np.moveaxis(winding, axis, 0)
    # Plane by plane is contiguous and several times faster than a strided cumsum.
    for k in range(1, len(planes)):
        planes[k] += planes[k - 1]
    return winding


def fill_by_vote(
    views: Views, shape: tuple[int, int, int]
) -> Bool[np.ndarray, "x y z"]:
    """Solid voxels by majority of the votes of the three views."""
    # int8 throughout: the largest arrays of the voxelization set its memory.
    votes = np.zeros(shape, np.int8)
    cast = []
    for axis, layers in enumerate(views):
        votes += _winding(layers, axis, shape) != 0
        rays = balanced_rays(layers).reshape(layers.height, layers.width)
        # Rows before columns, as the lattice has them, with the depth axis of length 1.
        ordered = rays if pixel_axes(axis)[0] < pixel_axes(axis)[1] else rays.T
        cast.append(np.expand_dims(ordered, axis).astype(np.int8))
    # Solid where 2 x votes for > votes cast.
    votes *= 2
    for x, plane in enumerate(votes):
        plane -= cast[0][0] + cast[1][x] + cast[2][x]
    return votes > 0
