"""Bodies from arrays of voxels: a scan, a label volume, or the design of a program."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from ..arrays import Scalar, Vector, flat_index
from ..errors import InputError, positive_length
from ..geometry.mesh import Mesh
from .grid import LayerCounts, VoxelGrid
from .lattice import Lattice
from .thin_parts import ThinParts


def grid_from_voxels(
    solid: Any, pitch: Scalar, origin: Vector = (0.0, 0.0, 0.0)
) -> VoxelGrid:
    """Voxel grid of a boolean array, with a fragment on every open voxel face.

    The surface is that of the cubes, with its own area: up to 50 % more than that of a
    smooth body (`voxelize` a mesh for true areas).

    Args:
        solid: True where the body is, [x y z].
        pitch: edge of a voxel [m].
        origin: lowest corner of the array in the body's frame [m].

    Raises:
        InputError: unless the array is boolean, of three axes, and True somewhere.

    Example:
        >>> import jaxthermo as jt
        >>> import numpy as np
        >>> grid = jt.grid_from_voxels(np.ones((4, 4, 4), bool), pitch=0.01)
        >>> grid.fragment_area.sum().round(12).item()  # m^2
        0.0096
    """
    is_solid = np.asarray(solid)
    if is_solid.dtype != bool or is_solid.ndim != 3:
        raise InputError(
            f"grid_from_voxels: got {is_solid.dtype} of shape {is_solid.shape}: give a "
            "boolean array [x y z], such as `scan > 0`"
        )
    if not is_solid.any():
        raise InputError("grid_from_voxels: no voxel is True: the body is empty")
    edge = positive_length("pitch", float(pitch))
    corner = np.asarray(origin, float)
    if corner.shape != (3,) or not np.isfinite(corner).all():
        raise InputError(f"grid_from_voxels(origin={origin!r}): give three numbers [m]")
    x, y, z = is_solid.shape
    lattice = Lattice(shape=(x, y, z), origin=corner, pitch=edge)
    faces_by_axis = [_faces_across(is_solid, axis) for axis in range(3)]
    voxel = np.concatenate([faces.voxel for faces in faces_by_axis])
    outward = np.concatenate([faces.outward for faces in faces_by_axis])
    layer = np.concatenate([faces.layer for faces in faces_by_axis])
    # In lattice order the solver's gathers and scatters walk memory forwards.
    order = np.argsort(flat_index(voxel, is_solid.shape), kind="stable")
    voxel = voxel[order]
    outward = outward[order]
    layer = layer[order]
    axis = np.abs(outward).argmax(axis=1)
    counts = tuple(int(layer[axis == a].max(initial=-1)) + 1 for a in range(3))
    return VoxelGrid(
        lattice=lattice,
        solid=is_solid,
        mesh=_cube_mesh(voxel, outward, lattice),
        fragment_position=lattice.centres(voxel) + 0.5 * edge * outward,
        fragment_normal=outward.astype(float),
        fragment_area=np.full(len(voxel), edge**2),
        fragment_voxel=voxel.astype(np.int32),
        fragment_axis=axis.astype(np.int8),
        fragment_layer=np.stack([layer, layer], axis=1).astype(np.int32),
        area_ratio=1.0,
        volume_ratio=1.0,
        layers=LayerCounts(counts, counts),
        thin=ThinParts(
            thin_fragments=0, thin_area=0.0, lost_fragments=0, lost_area=0.0, regions=()
        ),
    )


class _OpenFaces(NamedTuple):
    """Voxel faces between solid and empty, across one axis."""

    voxel: Int[np.ndarray, "k 3"]
    outward: Int[np.ndarray, "k 3"]
    """Outward normal."""
    layer: Int[np.ndarray, " k"]
    """Depth layer along the axis."""


def _faces_across(solid: Bool[np.ndarray, "x y z"], axis: int) -> _OpenFaces:
    along = np.moveaxis(solid, axis, 2)
    step = np.diff(along.astype(np.int8), axis=2, prepend=0, append=0)
    # A ray meets the faces of its column one after the other: layers 0, 1, ...
    number = np.cumsum(step != 0, axis=2)
    face = np.argwhere(step)
    enters = step[tuple(face.T)] > 0
    layer = number[tuple(face.T)] - 1
    # The face with index i is below voxel i and above voxel i - 1.
    face[:, 2] -= ~enters
    normal = np.zeros_like(face)
    normal[:, 2] = np.where(enters, -1, 1)
    # Columns back in the order of the axes: the other two, then this one.
    column_order = np.argsort([a for a in range(3) if a != axis] + [axis])
    return _OpenFaces(
        voxel=face[:, column_order], outward=normal[:, column_order], layer=layer
    )


def _cube_mesh(
    voxel: Int[np.ndarray, "k 3"], outward: Int[np.ndarray, "k 3"], lattice: Lattice
) -> Mesh:
    """Two triangles for each open face, with shared corners."""
    axis = np.abs(outward).argmax(axis=1)
    sign = outward[np.arange(len(axis)), axis]
    # Corners of the face, counter-clockwise about +axis; reversed where it looks down.
    around = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corner = np.repeat(voxel[:, None, :], 4, axis=1)
    rows = np.arange(len(axis))
    corner[rows, :, axis] += (sign > 0)[:, None]
    for side in (1, 2):
        corner[rows, :, (axis + side) % 3] += around[:, side - 1]
    corner = np.where((sign > 0)[:, None, None], corner, corner[:, ::-1])
    shape = np.add(lattice.shape, 1)
    key = np.ravel_multi_index(tuple(np.moveaxis(corner, 2, 0)), tuple(shape))
    used, index = np.unique(key, return_inverse=True)
    quad = index.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    points = np.stack(np.unravel_index(used, tuple(shape)), axis=1)
    vertices = lattice.origin + points * lattice.pitch
    return Mesh(vertices, faces.astype(np.int64), "voxels")
