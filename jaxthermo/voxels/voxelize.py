"""Voxelization: mesh to solid voxels and surface fragments, by depth layers."""

from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import Scalar, rank_in_group, stable_order
from ..errors import InputError, shortened
from ..geometry.mesh import AnyMesh, Mesh, as_mesh
from ..geometry.repair import repair_mesh
from ..stored_findings import stored_search
from .cell_areas import Patches, areas_of_mesh
from .crossings import Crossings, find_crossings
from .cut_geometry import cut_voxels
from .cut_links import CutLinks
from .cut_voxels import CutVoxels
from .fill import fill_by_vote
from .grid import LayerCounts, ThinParts, VoxelGrid
from .lattice import (
    BYTES_PER_CROSSING,
    BYTES_PER_FRAGMENT,
    Lattice,
    Views,
    check_pitch,
    peel_axes,
)
from .represented import MAX_DIFFERENCE
from .surface import (
    AxisFragments,
    attach_to_solid,
    axis_fragments,
    face_axes,
)


SurfaceCells = Literal["crossings", "dominant_axis"]


def voxelize(
    mesh: AnyMesh, pitch: Scalar, surface_cells: SurfaceCells = "crossings"
) -> VoxelGrid:
    """Compute the solid voxels and surface fragments of a mesh.

    Args:
        mesh: the body; holes are bridged by a vote of the three axes. A
            `trimesh.Trimesh`, in metres and z up, is repaired as `load_mesh` does.
        pitch: edge of a voxel [m].
        surface_cells: "crossings" for a fragment on every exposed voxel face, where
            the surface is, with the true volumes of the voxels that it cuts: of second
            order in the pitch; "dominant_axis" for fragments along the dominant axis of
            the normal, half a voxel above their voxels, as in the thesis.

    Raises:
        InputError: if the pitch is not positive, gives no voxel, or needs more memory
            than available.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> int(grid.solid_count)
        64
    """
    pitch = _metres(pitch)
    if surface_cells not in get_args(SurfaceCells):
        raise InputError(
            f"voxelize(surface_cells={shortened(surface_cells)}): choose "
            '"crossings" or "dominant_axis"'
        )
    if not isinstance(mesh, Mesh):
        mesh = repair_mesh(as_mesh(mesh))
    every = surface_cells == "crossings"
    check_pitch(mesh, pitch, BYTES_PER_CROSSING if every else BYTES_PER_FRAGMENT)
    # With the caller's own mesh, by which its grids are known.
    return replace(_voxelized(mesh, pitch, surface_cells), mesh=mesh)


_TYPES = (VoxelGrid, Lattice, Mesh, LayerCounts, ThinParts, CutVoxels, CutLinks)


@stored_search("voxels", _TYPES)
def _voxelized(mesh: Mesh, pitch: float, surface_cells: str) -> VoxelGrid:
    lattice = Lattice.around(mesh, pitch)
    if surface_cells == "crossings":
        return _with_crossings(mesh, lattice)
    return _with_surface(mesh, lattice)


def _filled(mesh: Mesh, lattice: Lattice) -> tuple[Views, Bool[np.ndarray, "x y z"]]:
    """Depth layers of a mesh, and its solid voxels."""
    views = peel_axes(mesh, lattice)
    solid = fill_by_vote(views, lattice.shape)
    if not solid.any():
        raise InputError(
            f"{mesh.name}: no voxel at a pitch of {lattice.pitch:g} m; the body is "
            f"{' x '.join(f'{s:.3g}' for s in np.ptp(mesh.bounds, axis=0))} m: "
            "use a finer pitch, or repair the mesh if it is open"
        )
    return views, solid


def _metres(pitch: Any) -> float:
    # A text may have a unit, and only files and command lines take units.
    try:
        metres = None if isinstance(pitch, str) else float(pitch)
    except (TypeError, ValueError):
        metres = None
    if metres is None:
        raise InputError(
            f"voxelize(pitch={shortened(pitch)}): give a number of metres, such as "
            "0.002"
        )
    return metres


def _with_surface(mesh: Mesh, lattice: Lattice) -> VoxelGrid:
    views, solid = _filled(mesh, lattice)
    normals, dominant = face_axes(mesh)
    parts, hidden, rays = [], [], 0
    for axis, layers in enumerate(views):
        kept, inside = axis_fragments(layers, dominant, axis, rays)
        parts.append(kept)
        hidden.append(inside)
        rays += layers.width * layers.height
    joined = (np.concatenate(column) for column in zip(*parts, strict=True))
    kept, hidden = AxisFragments(*joined), np.concatenate(hidden)
    # A ray grid of spacing h cuts the surface into pieces of area h^2 / |n_i|.
    slope = np.abs(normals).max(1)
    area = lattice.pitch**2 / slope[kept.triangle]
    cell, lost = attach_to_solid(solid, kept.position, kept.inward_cell)
    position = lattice.origin + kept.position * lattice.pitch
    thickness = kept.thickness * lattice.pitch * slope[kept.triangle]
    thin = _thin_parts(position, thickness, area, lost, cell, lattice.pitch)
    found_area = float(area[~lost].sum())
    found_volume = np.count_nonzero(solid) * lattice.pitch**3
    hidden_area = float((lattice.pitch**2 / slope[hidden]).sum())
    true, own = (mesh.area, mesh.volume), (found_area, found_volume)
    unreliable = _unreliable_because(mesh, true, own, hidden_area)
    # True over voxelized area and volume; 1 where that would hide lost parts.
    area_ratio = 1.0 if unreliable else true[0] / found_area
    volume_ratio = 1.0 if unreliable else true[1] / found_volume
    packed = np.zeros(len(lost), np.int64)
    packed[~lost] = rank_in_group(kept.ray[~lost])
    # In lattice order the solver's gathers and scatters walk memory forwards.
    attached = np.flatnonzero(~lost)
    number = np.ravel_multi_index(tuple(cell[attached].T), lattice.shape)
    order = attached[np.argsort(number, kind="stable")]
    axis = dominant[kept.triangle[order]]
    peeled = tuple(layers.count for layers in views)
    in_front = (int(packed[order][axis == a].max(initial=-1)) + 1 for a in range(3))
    return VoxelGrid(
        lattice=lattice,
        solid=solid,
        mesh=mesh,
        fragment_position=position[order],
        fragment_normal=normals[kept.triangle[order]],
        fragment_area=area[order] * area_ratio,
        fragment_voxel=cell[order],
        fragment_axis=axis,
        fragment_layer=np.stack([kept.layer[order], packed[order]], axis=1),
        area_ratio=area_ratio,
        volume_ratio=volume_ratio,
        unscaled_because=unreliable,
        layers=LayerCounts(peeled, tuple(in_front)),
        thin=thin,
    )


def _with_crossings(mesh: Mesh, lattice: Lattice) -> VoxelGrid:
    views, solid = _filled(mesh, lattice)
    pitch, (normals, _) = lattice.pitch, face_axes(mesh)
    found, hidden = find_crossings(views, solid, mesh)
    peeled = tuple(layers.count for layers in views)
    # Not needed any more: the largest arrays follow.
    del views
    slope = np.abs(found.normal[np.arange(len(found.axis)), found.axis])
    position = lattice.origin + found.position * pitch
    # Thickness counts along the dominant axis: near a limb other rays are short.
    is_main = _dominant(found.normal) == found.axis
    main = np.flatnonzero(is_main)
    thin = _thin_parts(
        position[main],
        found.thickness[main] * pitch * slope[main],
        pitch**2 / slope[main],
        found.lost[main],
        found.voxel[main],
        pitch,
    )
    hidden_area = float(pitch**2 * np.abs(normals[hidden]).max(1, initial=0).sum())
    packed = _packed(found, is_main & (found.triangle >= 0) & ~found.lost)
    attached = np.flatnonzero(~found.lost)
    number = np.ravel_multi_index(tuple(found.voxel[attached].T), lattice.shape)
    # In lattice order the solver's gathers and scatters walk memory forwards.
    attached = attached[stable_order(np.asarray(number))]
    normal, found = found.normal, found.cells(attached)
    cut, shapes = cut_voxels(found, solid)
    slope[attached] *= shapes.factor
    middle = lattice.to_cells(position)
    middle[attached] += shapes.shift
    area = pitch**2 * slope[attached]
    volume = (np.count_nonzero(solid) + float((cut.volume - 1).sum())) * pitch**3
    own_area, true = float(area.sum()), (mesh.area, mesh.volume)
    unreliable = _unreliable_because(mesh, true, (own_area, volume), hidden_area)
    if not unreliable:
        patches = Patches(middle[None], normal, slope)
        every = areas_of_mesh(patches, lattice.to_cells(mesh.triangles), lattice.shape)
        area = pitch**2 * every[attached]
    ratios = true[0] / float(area.sum()), true[1] / volume
    # More means lost parts, which the others must not stand for.
    is_scaled = [not unreliable and abs(r - 1) <= MAX_DIFFERENCE for r in ratios]
    area_ratio, volume_ratio = np.where(is_scaled, ratios, 1.0).tolist()
    packed = packed[attached]
    in_front = (int(packed[found.axis == a].max(initial=-1)) + 1 for a in range(3))
    return VoxelGrid(
        lattice=lattice,
        solid=solid,
        mesh=mesh,
        fragment_position=position[attached],
        fragment_normal=found.normal,
        fragment_area=area * area_ratio,
        fragment_voxel=found.voxel.astype(np.int64),
        fragment_axis=found.axis.astype(np.int64),
        fragment_layer=np.stack([found.layer, packed], axis=1),
        area_ratio=area_ratio,
        volume_ratio=volume_ratio,
        unscaled_because=unreliable,
        layers=LayerCounts(peeled, tuple(in_front)),
        thin=thin,
        fragment_depth=found.depth * pitch,
        cut=cut,
    )


def _dominant(normal: Float[np.ndarray, "s 3"]) -> Int[np.ndarray, " s"]:
    """Axis along which each normal is longest, the first of several."""
    # As by `argmax`, which is slow along an axis of length three.
    x, y, z = np.abs(normal.T)
    return np.where((x >= y) & (x >= z), 0, np.where(y >= z, 1, 2))


def _packed(found: Crossings, is_kept: Bool[np.ndarray, " e"]) -> Int[np.ndarray, " e"]:
    # As in the thesis, each piece of surface is in the view of its dominant axis only.
    packed = np.full(len(found.axis), -1)
    kept = np.flatnonzero(is_kept)
    ray, along = found.ray[kept], found.position[kept, found.axis[kept]]
    if ((np.diff(ray) == 0) & (np.diff(along) < 0)).any() or (np.diff(ray) < 0).any():
        order = np.lexsort([along, ray])
        kept, ray = kept[order], ray[order]
    packed[kept] = rank_in_group(ray)
    return packed


# A ratio beyond this means lost parts, not a surface rounded off by voxels.
_MAX_RATIO = 2.0

# With a larger fraction of the surface inside the body its volume is unreliable.
_MAX_OVERLAP = 2e-3


def _unreliable_because(
    mesh: Mesh,
    true: tuple[float, float],
    found: tuple[float, float],
    hidden_area: float,
) -> str:
    """Reason why areas and volumes, true and found, are unreliable; empty for none."""
    edges = mesh.open_edges
    if edges:
        return f"the mesh is open ({edges} open edges): it has no volume of its own"
    overlap = hidden_area / (found[0] + hidden_area)
    if overlap > _MAX_OVERLAP:
        return f"parts overlap or touch: {overlap:.1%} of the surface lies inside"
    for quantity, of_mesh, own in zip(("area", "volume"), true, found, strict=True):
        ratio = of_mesh / own
        if not 1 / _MAX_RATIO < ratio < _MAX_RATIO:
            return (
                f"the mesh has {ratio:.2g} times the {quantity} of its voxels: "
                "parts of it are too thin for this pitch"
            )
    return ""


# Thin fragments within a cube of this many cells per edge are one region.
_REGION = 8


def _thin_parts(
    position: Float[np.ndarray, "s 3"],
    thickness: Float[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    lost: Bool[np.ndarray, " s"],
    cell: Int[np.ndarray, "s 3"],
    pitch: float,
    max_regions: int = 10,
) -> ThinParts:
    """Sum up the fragments with less than one voxel behind them, by region."""
    thin = lost | (thickness < pitch)
    blocks, inverse = np.unique(cell[thin] // _REGION, axis=0, return_inverse=True)
    total = np.bincount(inverse, weights=area[thin], minlength=len(blocks))
    gone = np.bincount(inverse, weights=(area * lost)[thin], minlength=len(blocks))
    regions = []
    for block in np.argsort(-total)[:max_regions]:
        members = np.flatnonzero(thin)[inverse == block]
        regions.append(
            {
                "centre_m": [round(float(c), 6) for c in position[members].mean(0)],
                "thickness_m": round(float(thickness[members].min()), 9),
                "area_m2": float(total[block]),
                "lost_share": float(gone[block] / total[block]),
            }
        )
    return ThinParts(
        thin_fragments=int(thin.sum()),
        thin_area=float(area[thin].sum()),
        lost_fragments=int(lost.sum()),
        lost_area=float(area[lost].sum()),
        regions=tuple(regions),
        thin_voxel=np.unique(cell[thin & ~lost], axis=0),
        lost_position=position[lost],
    )
