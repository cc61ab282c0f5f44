"""`voxelize`: mesh to solid voxels and surface fragments, by depth layers."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import Scalar, rank_in_group
from ..errors import InputError
from ..geometry.mesh import Mesh
from .fill import Views, fill_by_vote
from .grid import LayerCounts, ThinParts, VoxelGrid
from .lattice import Lattice, check_pitch, lattice_around, peel_axes
from .surface import AxisFragments, attach_to_solid, axis_fragments, face_axes


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


TRUSTED_RATIO = 2.0
"""A ratio beyond this means that parts are lost, not that a surface is rounded off."""

TRUSTED_OVERLAP = 2e-3
"""Share of the surface that may lie inside the body before its volume is doubted."""


class Scaling(NamedTuple):
    """Factors from counted to true area and volume; 1 if they cannot be trusted."""

    area_ratio: float
    volume_ratio: float
    unscaled_because: str
    """Empty if the ratios apply."""


def true_scaling(mesh: Mesh, area: float, volume: float, hidden_area: float) -> Scaling:
    """The scaling that gives back the mesh's own area and volume.

    Args:
        mesh: the body.
        area: of all fragments kept [m^2].
        volume: of all solid voxels [m^3].
        hidden_area: of the fragments inside the body [m^2].
    """
    doubt = _doubt(mesh, area, volume, hidden_area)
    if doubt:
        return Scaling(1.0, 1.0, doubt)
    return Scaling(mesh.area / area, mesh.volume / volume, "")


def _doubt(mesh: Mesh, area: float, volume: float, hidden_area: float) -> str:
    edges = mesh.open_edges
    if edges:
        return f"the mesh is open ({edges} open edges): it has no volume of its own"
    overlap = hidden_area / (area + hidden_area)
    if overlap > TRUSTED_OVERLAP:
        return f"parts overlap or touch: {overlap:.1%} of the surface lies inside"
    for what, ratio in ("area", mesh.area / area), ("volume", mesh.volume / volume):
        if not 1 / TRUSTED_RATIO < ratio < TRUSTED_RATIO:
            return (
                f"the mesh has {ratio:.2g} times the {what} of what was voxelized: "
                "parts of it are too thin for this pitch"
            )
    return ""


BLOCK = 8
"""Thin fragments within a block of this many cells are reported as one place."""


def report_thin_parts(
    position: Float[np.ndarray, "s 3"],
    thickness: Float[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    lost: Bool[np.ndarray, " s"],
    cell: Int[np.ndarray, "s 3"],
    pitch: float,
    most: int = 10,
) -> ThinParts:
    """Sum up fragments with less than one voxel behind them, by place.

    Args:
        position: of every fragment [m].
        thickness: of the body behind it, along its normal [m].
        area: true area [m^2].
        lost: whether no solid voxel is near.
        cell: lattice cell of the fragment.
        pitch: edge of a voxel [m].
        most: how many places to name.
    """
    thin = lost | (thickness < pitch)
    blocks, inverse = np.unique(cell[thin] // BLOCK, axis=0, return_inverse=True)
    total = np.bincount(inverse, weights=area[thin], minlength=len(blocks))
    gone = np.bincount(inverse, weights=(area * lost)[thin], minlength=len(blocks))
    places = []
    for block in np.argsort(-total)[:most]:
        members = np.flatnonzero(thin)[inverse == block]
        places.append(
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
        places=tuple(places),
    )
