"""`voxelize`: mesh to solid voxels and surface fragments, by depth layers."""

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..geometry.mesh import Mesh
from ..memory import require_memory
from ..raster.fragments import capacities
from ..raster.layers import peel
from .fill import fill_by_vote, pixel_axes
from .grid import Lattice, LayerCounts, VoxelGrid
from .surface import AxisFragments, attach_to_solid, axis_fragments
from .thin import report_thin_parts


BYTES_PER_CELL = 5
"""Peak of the fill: votes, winding, solid, and two planes' worth of temporaries."""

TRUSTED_RATIO = 1.25
"""A volume ratio beyond this means parts that overlap, not a rounded-off surface."""


def lattice_around(mesh: Mesh, pitch: float) -> Lattice:
    """The smallest lattice, centred on the mesh, whose cells of `pitch` cover it.

    A mesh whose size is a whole number of cells fills them exactly.
    """
    low, high = mesh.bounds
    # Lengths come from decimal text and float32 files: a millionth of a cell is none.
    count = np.maximum(np.ceil((high - low) / pitch - 1e-6), 1)
    corner = (low + high) / 2 - count * pitch / 2
    return Lattice(tuple(int(n) for n in count), corner, float(pitch))  # type: ignore[arg-type]


def _check(mesh: Mesh, pitch: float) -> None:
    if not np.isfinite(pitch) or pitch <= 0:
        raise InputError(f"pitch {pitch!r}: give a positive length in metres")
    low, high = mesh.bounds
    shape = np.maximum(np.ceil((high - low) / pitch), 1)
    cells = float(np.prod(shape))
    size = " x ".join(f"{n:.0f}" for n in shape)
    require_memory(
        int(min(cells, 1e18)) * BYTES_PER_CELL,
        f"voxelizing {mesh.name} at a pitch of {pitch:g} m ({size} cells)",
        f"use a coarser pitch, such as {pitch * max(2, np.cbrt(cells / 1e8)):.2g} m",
    )


def _views(mesh: Mesh, lattice: Lattice) -> list:
    """Depth layers along x, y, z, with the facing of each fragment."""
    corners = lattice.to_cells(mesh.triangles)
    facing = mesh.area_vectors
    frames = []
    for axis in range(3):
        row_axis, column_axis = pixel_axes(axis)
        frames.append(np.ascontiguousarray(corners[..., [column_axis, row_axis, axis]]))
    # One array size for the three views: one program is compiled, not three.
    sizes = [
        capacities(
            frame, lattice.shape[pixel_axes(a)[1]], lattice.shape[pixel_axes(a)[0]]
        )
        for a, frame in enumerate(frames)
    ]
    largest = (max(s[0] for s in sizes), max(s[1] for s in sizes))
    views = []
    for axis, frame in enumerate(frames):
        row_axis, column_axis = pixel_axes(axis)
        layers = peel(frame, lattice.shape[column_axis], lattice.shape[row_axis], largest)
        views.append((layers, facing[layers.triangle, axis] < 0))
    return views


def _joined(parts: list[AxisFragments]) -> AxisFragments:
    return AxisFragments(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _ratio(true: float, counted: float, limit: float) -> float:
    ratio = float(true / counted) if counted > 0 else 1.0
    return ratio if 1 / limit < ratio < limit else 1.0


def voxelize(mesh: Mesh, pitch: float) -> VoxelGrid:
    """Solid voxels and surface fragments of a mesh.

    Args:
        mesh: the body; a hole is bridged by the vote of the three axes.
        pitch: edge of a voxel [m].

    Raises:
        InputError: if the pitch is not positive, gives no voxel, or needs more memory
            than there is.
    """
    _check(mesh, pitch)
    lattice = lattice_around(mesh, pitch)
    views = _views(mesh, lattice)
    solid = fill_by_vote(views, lattice.shape)
    if not solid.any():
        raise InputError(
            f"{mesh.name}: no voxel at a pitch of {pitch:g} m; the body is "
            f"{' x '.join(f'{s:.3g}' for s in np.ptp(mesh.bounds, axis=0))} m: "
            "use a finer pitch, or repair the mesh if it is open"
        )
    return _with_surface(mesh, lattice, solid, views)


def _with_surface(
    mesh: Mesh, lattice: Lattice, solid: np.ndarray, views: list
) -> VoxelGrid:
    vectors = mesh.area_vectors
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    normals = vectors / np.where(lengths > 0, lengths, 1)
    dominant = np.abs(normals).argmax(1)
    parts = [
        axis_fragments(layers, entering, dominant[layers.triangle], axis)
        for axis, (layers, entering) in enumerate(views)
    ]
    kept = _joined(parts)
    normal = normals[kept.triangle]
    slope = np.abs(normal).max(1)
    area = lattice.pitch**2 / slope
    cell, lost = attach_to_solid(solid, kept.position, kept.inward_cell)
    position = lattice.origin + kept.position * lattice.pitch
    thin = report_thin_parts(
        position, kept.thickness * lattice.pitch * slope, area, lost, cell, lattice.pitch
    )
    # In lattice order the solver's gathers and scatters walk memory forwards.
    here = np.flatnonzero(~lost)
    here = here[np.lexsort(cell[here].T[::-1])]
    closed = mesh.is_watertight
    volume = np.count_nonzero(solid) * lattice.pitch**3
    area_ratio = _ratio(mesh.area, area[here].sum(), 2.0) if closed else 1.0
    return VoxelGrid(
        lattice=lattice,
        solid=solid,
        mesh=mesh,
        fragment_position=position[here],
        fragment_normal=normal[here],
        fragment_area=area[here] * area_ratio,
        fragment_voxel=cell[here],
        fragment_axis=dominant[kept.triangle[here]],
        fragment_layer=kept.layer[here],
        area_ratio=area_ratio,
        volume_ratio=_ratio(mesh.volume, volume, TRUSTED_RATIO) if closed else 1.0,
        layers=_layer_counts(views, parts),
        thin=thin,
    )


def _layer_counts(views: list, parts: list[AxisFragments]) -> LayerCounts:
    x, y, z = (layers.count for layers, _ in views)
    packed = [int(p.layer[:, 1].max()) + 1 if len(p.layer) else 0 for p in parts]
    return LayerCounts((x, y, z), (packed[0], packed[1], packed[2]))
