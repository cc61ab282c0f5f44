"""Voxelization: mesh to solid voxels and surface fragments, by depth layers."""

from dataclasses import replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import Scalar, flat_index, rank_in_group, stable_order
from ..errors import InputError, shortened
from ..geometry.mesh import AnyMesh, Mesh, as_mesh
from ..geometry.repair import repair_mesh
from ..memo.shared import shared
from ..memo.stored import stored_search
from .cell_areas import Patches, areas_of_mesh
from .crossings import Cells, Crossings, find_crossings
from .cut_geometry import CellShapes, cut_voxels, sides_of, surface_shapes
from .cut_links import CutLinks, cut_links
from .cut_voxels import CutVoxels, limited
from .fill import fill_by_vote
from .grid import LayerCounts, VoxelGrid
from .lattice import (
    SURFACE_MEMORY,
    Lattice,
    Views,
    check_pitch,
    peel_axes,
)
from .outer_surface import sampled_surface
from .represented import MAX_DIFFERENCE
from .surface import (
    AxisFragments,
    attach_to_solid,
    axis_fragments,
    dominant_axis,
    face_axes,
    joined_columns,
)
from .thin_parts import ThinParts
from .voxel_bits import VoxelBits


SurfaceCells = Literal["crossings", "dominant_axis"]


def voxelize(
    mesh: AnyMesh, pitch: Scalar, surface_cells: SurfaceCells = "crossings"
) -> VoxelGrid:
    """Compute the solid voxels and surface fragments of a mesh.

    Equal arguments give the same grid, for as long as it is in use.

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
    check_pitch(mesh, pitch, SURFACE_MEMORY[surface_cells])
    return shared(
        "voxels",
        inputs=(mesh, pitch, surface_cells),
        # With the caller's own mesh, by which its grids are known.
        make=lambda: replace(_voxelized(mesh, pitch, surface_cells), mesh=mesh),
    )


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
    peeled = tuple(layers.count for layers in views)
    normals, dominant = face_axes(mesh)
    fragments_by_axis = []
    hidden = []
    rays = 0
    # Each view is dropped as soon as its fragments are known.
    remaining = [*views]
    del views
    for axis in range(3):
        layers = remaining.pop(0)
        fragments, inside = axis_fragments(
            layers, normals=normals, dominant=dominant, axis=axis, first_ray=rays
        )
        fragments_by_axis.append(fragments)
        hidden.append(inside)
        rays += layers.width * layers.height
    del layers
    fragments = AxisFragments(*joined_columns(fragments_by_axis))
    hidden = np.concatenate(hidden)
    # A ray grid of spacing h cuts the surface into pieces of area h^2 / |n_i|.
    slope = np.abs(normals).max(1)
    area = lattice.pitch**2 / slope[fragments.triangle]
    cell, lost = attach_to_solid(solid, fragments.position, fragments.inward_cell)
    position = lattice.origin + fragments.position * lattice.pitch
    thickness = fragments.thickness * lattice.pitch * slope[fragments.triangle]
    thin = ThinParts.of(
        position,
        thickness=thickness,
        area=area,
        lost=lost,
        cell=cell,
        pitch=lattice.pitch,
    )
    fragment_area = float(area[~lost].sum())
    voxel_volume = np.count_nonzero(solid) * lattice.pitch**3
    hidden_area = float((lattice.pitch**2 / slope[hidden]).sum())
    true = _Sizes(area=mesh.area, volume=mesh.volume)
    unreliable = _unreliable(
        mesh,
        true=true,
        voxelized=_Sizes(area=fragment_area, volume=voxel_volume),
        hidden_area=hidden_area,
    )
    # True over voxelized area and volume; 1 where that would hide lost parts.
    area_ratio = 1.0
    if unreliable.area_is_known:
        area_ratio = true.area / fragment_area
    if unreliable.parts_overlap:
        area_ratio *= 1 - sampled_surface(mesh, lattice, normals).hidden_fraction
    volume_ratio = 1.0 if unreliable.reason else true.volume / voxel_volume
    packed = np.zeros(len(lost), np.int32)
    packed[~lost] = rank_in_group(fragments.ray[~lost])
    # In lattice order the solver's gathers and scatters walk memory forwards.
    attached = np.flatnonzero(~lost)
    number = flat_index(cell[attached], lattice.shape)
    order = attached[stable_order(number)]
    axis = dominant[fragments.triangle[order]].astype(np.int8)
    in_front = (int(packed[order][axis == a].max(initial=-1)) + 1 for a in range(3))
    return VoxelGrid(
        lattice=lattice,
        solid=solid,
        mesh=mesh,
        fragment_position=position[order],
        fragment_normal=normals[fragments.triangle[order]],
        fragment_area=area[order] * area_ratio,
        fragment_voxel=cell[order],
        fragment_axis=axis,
        fragment_layer=np.stack([fragments.layer[order], packed[order]], axis=1),
        area_ratio=area_ratio,
        volume_ratio=volume_ratio,
        unscaled_because=unreliable.reason,
        layers=LayerCounts(peeled, tuple(in_front)),
        thin=thin,
    )


def _with_crossings(mesh: Mesh, lattice: Lattice) -> VoxelGrid:
    views, solid = _filled(mesh, lattice)
    pitch = lattice.pitch
    normals, _ = face_axes(mesh)
    peeled = tuple(layers.count for layers in views)
    # Each view is dropped as soon as its crossings are known.
    remaining = [*views]
    del views
    crossings, hidden_area = find_crossings(
        (remaining.pop(0) for _ in range(3)),
        solid=solid,
        normals=normals,
        is_closed=mesh.is_watertight,
    )
    surface, cells, thin = _surface(crossings, normals, lattice)
    del crossings
    position = surface.position
    shapes, cut_cells = surface_shapes(cells)
    count = len(cells.axis)
    patches = _patches(surface, cut_cells)
    del cut_cells
    slope = patches.area
    solid_count = np.count_nonzero(solid)
    true = _Sizes(area=mesh.area, volume=mesh.volume)
    voxelized = _Sizes(
        area=float(pitch**2 * slope[:count].sum()),
        volume=(solid_count + float((shapes.volume - 1).sum())) * pitch**3,
    )
    unreliable = _unreliable(
        mesh, true=true, voxelized=voxelized, hidden_area=hidden_area * pitch**2
    )
    outer_area = true.area
    sampled = None
    if unreliable.parts_overlap:
        sampled = sampled_surface(mesh, lattice, normals)
        outer_area *= 1 - sampled.hidden_fraction
    if unreliable.area_is_known:
        slope = areas_of_mesh(
            patches,
            triangles=lattice.to_cells(mesh.triangles),
            shape=lattice.shape,
            sampled=sampled,
        )
    del patches
    area = pitch**2 * slope[:count]
    del slope
    links = cut_links(
        shapes.number, section=shapes.section, sides=sides_of(cells), solid=solid
    )
    voxel = cells.number
    # The largest arrays follow.
    del cells
    cut = cut_voxels(shapes, links, solid.shape)
    del shapes
    cut = limited(cut, solid)
    volume = (solid_count + float((cut.volume - 1).sum())) * pitch**3
    area_ratio = outer_area / float(area.sum())
    volume_ratio = true.volume / volume
    # A larger difference means lost parts, which the other parts must not stand for.
    if not unreliable.area_is_known or abs(area_ratio - 1) > MAX_DIFFERENCE:
        area_ratio = 1.0
    if unreliable.reason or abs(volume_ratio - 1) > MAX_DIFFERENCE:
        volume_ratio = 1.0
    area *= area_ratio
    layer = surface.layer[:count]
    axis = surface.axis[:count]
    in_front = (int(layer[axis == a, 1].max(initial=-1)) + 1 for a in range(3))
    position *= pitch
    position += lattice.origin
    depth = surface.depth[:count]
    depth *= pitch
    return VoxelGrid(
        lattice=lattice,
        solid=solid,
        mesh=mesh,
        fragment_position=position[:count],
        fragment_normal=surface.normal[:count],
        fragment_area=area,
        fragment_voxel=VoxelBits.none(solid.shape).voxels(voxel),
        fragment_axis=axis,
        fragment_layer=layer,
        area_ratio=area_ratio,
        volume_ratio=volume_ratio,
        unscaled_because=unreliable.reason,
        layers=LayerCounts(peeled, tuple(in_front)),
        thin=thin,
        fragment_depth=depth,
        cut=cut,
    )


class _Surface(NamedTuple):
    """Crossings in the order of their voxels, followed by those without a voxel."""

    position: Float[np.ndarray, "e 3"]
    """Position [cells]."""
    normal: Float[np.ndarray, "e 3"]
    axis: Int[np.ndarray, " e"]
    layer: Int[np.ndarray, "e 2"]
    """Depth layer, among all and packed."""
    depth: Float[np.ndarray, " e"]
    """Distance of the voxel's centre to the surface along the normal [cells]."""


class _SortedSurface(NamedTuple):
    """Surface in the order of its voxels, with its cells and thin parts."""

    surface: _Surface
    cells: Cells
    thin: ThinParts


def _surface(
    crossings: Crossings, normals: Float[np.ndarray, "f 3"], lattice: Lattice
) -> _SortedSurface:
    # Thickness counts along the dominant axis: near a limb other rays are short.
    bare = crossings.triangle < 0
    dominant = dominant_axis(normals).take(crossings.triangle, mode="wrap")
    is_main = bare | (dominant == crossings.axis)
    thin = _thin_crossings(
        crossings, main=np.flatnonzero(is_main), normals=normals, lattice=lattice
    )
    packed = _packed(crossings, is_main & ~bare & ~crossings.lost)
    # In lattice order the solver's gathers and scatters walk memory forwards.
    attached = np.flatnonzero(~crossings.lost)
    attached = attached[stable_order(crossings.number[attached])]
    order = attached
    count = len(attached)
    if count < len(packed):
        order = np.concatenate([attached, np.flatnonzero(crossings.lost)])
    layer = np.empty((len(order), 2), np.int32)
    layer[:, 0] = crossings.layer[order]
    layer[:, 1] = packed[order]
    axis = crossings.axis[order]
    normal = crossings.normals(normals, order)
    cells = Cells(
        normal=normal[:count],
        axis=axis[:count],
        ahead=crossings.ahead[attached],
        number=crossings.number[attached],
        excess=crossings.excess[attached],
        on_face=crossings.on_face[attached],
    )
    surface = _Surface(
        position=crossings.position[order],
        normal=normal,
        axis=axis,
        layer=layer,
        depth=crossings.depth[order],
    )
    return _SortedSurface(surface=surface, cells=cells, thin=thin)


def _patches(surface: _Surface, cell_shapes: CellShapes) -> Patches:
    """Pieces of surface around all crossings, with areas by their rays.

    Lost crossings have pieces too: nearby cells must not stand for their area.
    """
    count = len(cell_shapes.factor)
    position = surface.position
    area = np.abs(surface.normal[np.arange(len(position)), surface.axis])
    area[:count] *= cell_shapes.factor
    middle = cell_shapes.shift
    middle += position[:count]
    if count < len(position):
        middle = np.concatenate([middle, position[count:]])
    return Patches(position=middle[None], normal=surface.normal, area=area)


def _thin_crossings(
    crossings: Crossings,
    main: Int[np.ndarray, " m"],
    normals: Float[np.ndarray, "f 3"],
    lattice: Lattice,
) -> ThinParts:
    pitch = lattice.pitch
    triangle = crossings.triangle[main]
    slope = np.abs(normals[triangle, crossings.axis[main]])
    slope[triangle < 0] = 1
    thickness = crossings.thickness[main] * pitch * slope
    # Few crossings are on thin parts: only those are summed up.
    near = np.flatnonzero(crossings.lost[main] | (thickness < pitch))
    thin_crossing = main[near]
    return ThinParts.of(
        lattice.origin + crossings.position[thin_crossing] * pitch,
        thickness=thickness[near],
        area=pitch**2 / slope[near],
        lost=crossings.lost[thin_crossing],
        cell=VoxelBits.none(lattice.shape)
        .voxels(crossings.number[thin_crossing])
        .astype(np.int64),
        pitch=pitch,
    )


def _packed(
    crossings: Crossings, is_kept: Bool[np.ndarray, " e"]
) -> Int[np.ndarray, " e"]:
    # As in the thesis, each piece of surface is in the view of its dominant axis only.
    packed = np.full(len(crossings.axis), -1, np.int32)
    packable = np.flatnonzero(is_kept)
    ray = crossings.ray[packable]
    along = crossings.position[packable, crossings.axis[packable]]
    if ((np.diff(ray) == 0) & (np.diff(along) < 0)).any() or (np.diff(ray) < 0).any():
        order = np.lexsort([along, ray])
        packable = packable[order]
        ray = ray[order]
    packed[packable] = rank_in_group(ray)
    return packed


# A ratio beyond this means lost parts, not a surface rounded off by voxels.
_MAX_RATIO = 2.0

# With a larger fraction of the surface inside the body its volume is unreliable.
_MAX_OVERLAP = 2e-3


class _Sizes(NamedTuple):
    """Area and volume of a body, of its mesh or of its voxels."""

    area: float
    """Area of the surface [m^2]."""
    volume: float
    """Enclosed volume [m^3]."""


class _Unreliable(NamedTuple):
    """Sizes of a mesh that are not those of the body."""

    reason: str
    """Reason why voxels are not scaled to the mesh's volume; empty for none."""
    area_is_known: bool
    """True if the area of the mesh is that of the body and of what lies inside it."""

    @property
    def parts_overlap(self) -> bool:
        """True if the mesh has an area inside the body, as where parts overlap."""
        return self.area_is_known and bool(self.reason)


def _unreliable(
    mesh: Mesh, true: _Sizes, voxelized: _Sizes, hidden_area: float
) -> _Unreliable:
    """Sizes of a mesh that are unreliable, compared with those of its voxels."""
    edges = mesh.open_edges
    if edges:
        reason = f"the mesh is open ({edges} open edges): it has no volume of its own"
        return _Unreliable(reason, area_is_known=False)
    counted_area = voxelized.area + hidden_area
    overlap = hidden_area / counted_area
    ratios = {
        "area": true.area / counted_area,
        "volume": true.volume / voxelized.volume,
    }
    if overlap > _MAX_OVERLAP:
        # The mesh has the volume of overlaps several times.
        del ratios["volume"]
    for quantity, ratio in ratios.items():
        if not 1 / _MAX_RATIO < ratio < _MAX_RATIO:
            reason = (
                f"the mesh has {ratio:.2g} times the {quantity} of its voxels: "
                "parts of it are too thin for this pitch"
            )
            return _Unreliable(reason, area_is_known=False)
    reason = ""
    if overlap > _MAX_OVERLAP:
        reason = f"parts overlap or touch: {overlap:.1%} of the surface lies inside"
    return _Unreliable(reason, area_is_known=True)
