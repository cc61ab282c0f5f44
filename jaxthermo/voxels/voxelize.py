"""`voxelize`: mesh to solid voxels and surface fragments, by depth layers."""

import numpy as np
from jaxtyping import Bool, Int

from ..array_types import Scalar
from ..arrays import rank_in_group
from ..errors import InputError
from ..geometry.mesh import Mesh
from .fill import Views, fill_by_vote
from .grid import LayerCounts, VoxelGrid
from .lattice import Lattice, check_pitch, lattice_around
from .scaling import true_scaling
from .surface import AxisFragments, attach_to_solid, axis_fragments, face_axes
from .thin_wall_report import report_thin_parts
from .views import peel_axes


def voxelize(mesh: Mesh, pitch: Scalar) -> VoxelGrid:
    """Solid voxels and surface fragments of a mesh.

    Args:
        mesh: the body; a hole is bridged by the vote of the three axes.
        pitch: edge of a voxel [m].

    Raises:
        InputError: if the pitch is not positive, gives no voxel, or needs more memory
            than there is.
    """
    pitch = float(pitch)
    check_pitch(mesh, pitch)
    lattice = lattice_around(mesh, pitch)
    views = peel_axes(mesh, lattice)
    solid = fill_by_vote(views, lattice.shape)
    if not solid.any():
        raise InputError(
            f"{mesh.name}: no voxel at a pitch of {pitch:g} m; the body is "
            f"{' x '.join(f'{s:.3g}' for s in np.ptp(mesh.bounds, axis=0))} m: "
            "use a finer pitch, or repair the mesh if it is open"
        )
    return _with_surface(mesh, lattice, solid, views)


def _kept_fragments(
    views: Views, dominant: Int[np.ndarray, " f"]
) -> tuple[AxisFragments, Int[np.ndarray, " h"]]:
    """Fragments of all views, and the triangles of those hidden inside the body."""
    parts, hidden, rays = [], [], 0
    for axis, layers in enumerate(views):
        kept, inside = axis_fragments(layers, dominant, axis, rays)
        parts.append(kept)
        hidden.append(inside)
        rays += layers.width * layers.height
    joined = (np.concatenate(column) for column in zip(*parts, strict=True))
    return AxisFragments(*joined), np.concatenate(hidden)


def _with_surface(
    mesh: Mesh, lattice: Lattice, solid: Bool[np.ndarray, "x y z"], views: Views
) -> VoxelGrid:
    normals, dominant = face_axes(mesh)
    kept, hidden = _kept_fragments(views, dominant)
    slope = np.abs(normals).max(1)
    area = lattice.pitch**2 / slope[kept.triangle]
    cell, lost = attach_to_solid(solid, kept.position, kept.inward_cell)
    position = lattice.origin + kept.position * lattice.pitch
    thickness = kept.thickness * lattice.pitch * slope[kept.triangle]
    thin = report_thin_parts(position, thickness, area, lost, cell, lattice.pitch)
    scaling = true_scaling(
        mesh,
        area=float(area[~lost].sum()),
        volume=np.count_nonzero(solid) * lattice.pitch**3,
        hidden_area=float((lattice.pitch**2 / slope[hidden]).sum()),
    )
    packed = np.zeros(len(lost), np.int64)
    packed[~lost] = rank_in_group(kept.ray[~lost])
    # In lattice order the solver's gathers and scatters walk memory forwards.
    here = np.flatnonzero(~lost)
    number = np.ravel_multi_index(tuple(cell[here].T), lattice.shape)
    here = here[np.argsort(number, kind="stable")]
    axis = dominant[kept.triangle[here]]
    return VoxelGrid(
        lattice=lattice,
        solid=solid,
        mesh=mesh,
        fragment_position=position[here],
        fragment_normal=normals[kept.triangle[here]],
        fragment_area=area[here] * scaling.area_ratio,
        fragment_voxel=cell[here],
        fragment_axis=axis,
        fragment_layer=np.stack([kept.layer[here], packed[here]], axis=1),
        area_ratio=scaling.area_ratio,
        volume_ratio=scaling.volume_ratio,
        unscaled_because=scaling.unscaled_because,
        layers=_layer_counts(views, axis, packed[here]),
        thin=thin,
    )


def _layer_counts(
    views: Views, axis: Int[np.ndarray, " s"], packed: Int[np.ndarray, " s"]
) -> LayerCounts:
    x, y, z = (layers.count for layers in views)
    counts = [int(packed[axis == a].max(initial=-1)) + 1 for a in range(3)]
    return LayerCounts((x, y, z), (counts[0], counts[1], counts[2]))
