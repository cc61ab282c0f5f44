"""Lattice of cubic cells around a body: its memory, and its views along the axes."""

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..geometry.mesh import Mesh, connected_labels
from ..geometry.vectors import part_bounds
from ..host_memory import available_bytes, require_memory
from ..raster.fragments import DepthLayers, peel_mesh


# The array of solid voxels.
_BYTES_PER_CELL = np.dtype(bool).itemsize

# Words of 64 voxels in a row: two votes, the votes against, one view with its
# complement, its rays that vote, and a temporary array.
_BYTES_PER_WORD = 7 * np.dtype(np.uint64).itemsize

# A lattice of more cells is told before it is made.
_MANY_CELLS = 1e8

BYTES_PER_FRAGMENT = 150
"""Peak memory of the sort of fragments, with the padding of its arrays."""


class _SurfaceMemory(NamedTuple):
    """Peak memory of the surface cells of a body [bytes]."""

    per_crossing: int
    """For each crossing of a ray with the surface."""
    at_once: int
    """For the pieces of triangles that are summed at once."""


# Measured maximum for ten bodies of 50 000 to 600 000 crossings: that of a box with few
# and large triangles. Statues need about half as much.
SURFACE_MEMORY = {
    "crossings": _SurfaceMemory(per_crossing=260, at_once=10_000_000),
    "dominant_axis": _SurfaceMemory(per_crossing=240, at_once=0),
}

# While triangles are peeled, each has corners in the views, spans of rows and normals,
# next to the list of crossings; later only its normal and corners remain.
_BYTES_PER_PEELED_FACE = 400
_BYTES_PER_PEELED_CROSSING = 70
_BYTES_PER_FACE = 200


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

    @classmethod
    def around(cls, mesh: Mesh, pitch: float) -> "Lattice":
        """Smallest lattice of the given pitch [m] around a mesh and centred on it."""
        low, high = mesh.bounds
        count = _cell_counts(high - low, pitch)
        corner = (low + high) / 2 - count * pitch / 2
        nx, ny, nz = (int(n) for n in count)
        return cls(shape=(nx, ny, nz), origin=corner, pitch=pitch)

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))


def _cell_counts(size: Float[np.ndarray, "*parts 3"], pitch: float) -> np.ndarray:
    # Floats, since a tiny pitch may need more cells than integers can count.
    with np.errstate(over="ignore"):
        length = size / pitch
    # A few ulp of a float32 file beyond a whole number of cells need no further cell.
    return np.maximum(np.ceil(length - 1e-6 * (1 + length)), 1)


def check_pitch(mesh: Mesh, pitch: float, surface: _SurfaceMemory) -> None:
    """Refuse a pitch [m] that gives no voxels or too many, before any allocation.

    More than 1e8 cells are a warning, with the part of the mesh that makes them many.

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
        crossings = projected / pitch / pitch
        needed = counts.prod() * _BYTES_PER_CELL + crossings * surface.per_crossing
        needed += (counts[:2] + 2).prod() * (counts[2] // 64 + 1) * _BYTES_PER_WORD
    cells = f"{' x '.join(f'{n:.6g}' for n in counts)} cells"
    remedy = "use a coarser pitch"
    with np.errstate(over="ignore"):
        is_large = bool(counts.prod() > _MANY_CELLS)
        if is_large:
            remedy = f"{_stretched_by(mesh, pitch)}{remedy}"
    needed += len(mesh.faces) * _BYTES_PER_FACE + surface.at_once
    peeled = len(mesh.faces) * _BYTES_PER_PEELED_FACE
    needed = max(needed, peeled + crossings * _BYTES_PER_PEELED_CROSSING)
    require_memory(
        int(min(needed, 1e18)),
        f"voxelizing {mesh.name} at a pitch of {pitch:g} m ({cells})",
        f"{remedy}, such as "
        f"{_affordable_pitch(size, projected * surface.per_crossing):.2g} m",
    )
    if is_large:
        warnings.warn(
            f"voxelizing {mesh.name} at a pitch of {pitch:g} m makes {cells}: {remedy}",
            stacklevel=3,
        )


def _stretched_by(mesh: Mesh, pitch: float) -> str:
    """The part that stretches the box around a mesh most, with a remedy; "" for none.

    A part stretches it that at least doubles the box around the largest part.
    """
    root = connected_labels(
        len(mesh.vertices), np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    )
    _, part = np.unique(root[mesh.faces[:, 0]], return_inverse=True)
    part = part.reshape(-1)
    count = int(part.max()) + 1
    low, high = part_bounds(mesh.triangles, part, count)
    area = np.bincount(part, np.linalg.norm(mesh.area_vectors, axis=1), count)
    main = area.argmax()
    size = np.maximum(high, high[main]) - np.minimum(low, low[main])
    cells = _cell_counts(size, pitch).prod(axis=1)
    worst = cells.argmax()
    if cells[worst] < 2 * cells[main]:
        return ""
    x, y, z = (low[worst] + high[worst]) / 2
    faces = int(np.count_nonzero(part == worst))
    return (
        f"the part of {faces:,} face{'s' * (faces != 1)} around "
        f"({x:.4g}, {y:.4g}, {z:.4g}) m stretches the {cells[main]:.2g} cells of the "
        "largest part; remove it, or "
    )


def _affordable_pitch(size: Float[np.ndarray, "3"], per_pitch: float) -> float:
    """Pitch [m] that needs about half of the available memory.

    The surface needs `per_pitch` bytes over the square of the pitch.
    """
    # A quarter for the cells and a quarter for the fragments.
    quarter = available_bytes() / 4
    by_cells = np.cbrt(size.prod() * (_BYTES_PER_CELL + _BYTES_PER_WORD / 64) / quarter)
    by_rows = np.sqrt(size[:2].prod() * _BYTES_PER_WORD / quarter)
    by_fragments = np.sqrt(per_pitch / quarter)
    return float(max(by_cells, by_rows, by_fragments))


def pixel_axes(axis: int) -> tuple[int, int]:
    """Lattice axes of the rows and columns of the view along `axis`."""
    # Column, row and depth are a right-handed frame, as `raster.fragments` requires.
    return (axis + 2) % 3, (axis + 1) % 3


Views = list[DepthLayers]
"""Depth layers along x, y and z."""


def peel_axes(mesh: Mesh, lattice: Lattice) -> Views:
    """Depth layers of a mesh along x, y and z; depths in cells."""
    points = lattice.to_cells(mesh.vertices)
    # Scanners leave strays far away.
    is_used = np.zeros(len(points), bool)
    is_used[mesh.faces] = True
    points[~is_used] = 0
    views = []
    for axis in range(3):
        row_axis, column_axis = pixel_axes(axis)
        layers = peel_mesh(
            points[:, [column_axis, row_axis, axis]],
            faces=mesh.faces,
            width=lattice.shape[column_axis],
            height=lattice.shape[row_axis],
        )
        views.append(layers)
    return views
