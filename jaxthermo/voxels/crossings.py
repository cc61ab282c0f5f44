"""Surface cells from all crossings: one for every exposed voxel face.

A face lies between a solid voxel and an empty one along axis a. The ray through both
centres crosses the surface theta voxels from the solid one's, with the unit normal n
there. The face stands for its part of the surface, as the faces of a plane patch add up
to its area (sum over a of |n_a| |n_a| = 1):

- area |n_a| h^2, at the crossing (see `cell_areas` for what the rays miss or add);
- distance of the voxel's centre to it along the normal, d = theta h |n_a|.

Where the vote closes the hole of an open mesh no ray crosses the face: it has theta =
1/2 and n along the axis. Faces of a closed mesh without a crossing are along the
surface, and are no cells. Crossings of no exposed face come in twos between
neighbouring centres: a sheet or a gap thinner than a voxel. They are cells of the
nearest voxel, as far as there is one.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry.mesh import Mesh
from ..raster.fragments import DepthLayers
from .fill import first_cell_behind
from .lattice import Views, pixel_axes
from .surface import (
    attach_to_solid,
    face_axes,
    hidden_inside,
    selected,
    thickness_behind,
)


# Smallest distance of a voxel's centre to the surface along a ray [voxels]: half cells
# of less conduct so well that they would limit explicit steps.
_MIN_THETA = 0.1

# Farthest crossing beyond the end of a face's link [voxels]: so near to a centre the
# vote of the three axes may put the voxel on the other side.
_MAX_SNAP = 0.25


class Crossings(NamedTuple):
    """Crossings of the surface by the rays of all three axes, and faces without one."""

    position: Float[np.ndarray, "s 3"]
    """Position [cells]."""
    triangle: Int[np.ndarray, " s"]
    """Triangle of the mesh; -1 for a face that no ray crosses."""
    normal: Float[np.ndarray, "s 3"]
    """Outward."""
    axis: Int[np.ndarray, " s"]
    """Axis of the ray."""
    ahead: Bool[np.ndarray, " s"]
    """True where the body is left along +axis."""
    ray: Int[np.ndarray, " s"]
    """Number of the ray among those of all three views."""
    layer: Int[np.ndarray, " s"]
    """Depth layer in the view."""
    voxel: Int[np.ndarray, "s 3"]
    """Cell of the solid voxel that it belongs to."""
    depth: Float[np.ndarray, " s"]
    """Distance of that voxel's centre to the surface along the normal [cells]."""
    excess: Float[np.ndarray, " s"]
    """theta - 1/2, also of crossings of no face: signed from the middle of the link."""
    thickness: Float[np.ndarray, " s"]
    """Distance along the ray to the other side of the body [cells]."""
    on_face: Bool[np.ndarray, " s"]
    """True for cells of exposed faces."""
    lost: Bool[np.ndarray, " s"]
    """Crossings without a solid voxel nearby."""

    def cells(self, which: np.ndarray) -> "Cells":
        """Surface cells of some of them."""
        return Cells(*(getattr(self, name)[which] for name in Cells._fields))


class Cells(NamedTuple):
    """Surface cells: the part of crossings that outlives their search."""

    normal: Float[np.ndarray, "s 3"]
    axis: Int[np.ndarray, " s"]
    ahead: Bool[np.ndarray, " s"]
    layer: Int[np.ndarray, " s"]
    voxel: Int[np.ndarray, "s 3"]
    depth: Float[np.ndarray, " s"]
    excess: Float[np.ndarray, " s"]
    on_face: Bool[np.ndarray, " s"]


def find_crossings(
    views: Views, solid: Bool[np.ndarray, "x y z"], mesh: Mesh
) -> tuple[Crossings, Int[np.ndarray, " h"]]:
    """Crossings of all views, and the triangles of those hidden inside the body."""
    parts, hidden, rays = [], [], 0
    normals, _ = face_axes(mesh)
    for axis, layers in enumerate(views):
        inside = hidden_inside(layers)
        hidden.append(layers.triangle[inside])
        outer, first = selected(layers, ~inside), (axis, rays)
        parts.append(_along(outer, solid, normals, mesh.is_watertight, *first))
        rays += layers.width * layers.height
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Crossings(*columns), np.concatenate(hidden)


def _along(
    layers: DepthLayers,
    solid: Bool[np.ndarray, "x y z"],
    normals: Float[np.ndarray, "f 3"],
    is_closed: bool,
    axis: int,
    first_ray: int,
) -> Crossings:
    faces = _exposed_faces(solid, axis)
    crossing = _crossing_of_faces(layers, faces, solid.shape[axis])
    crossed = crossing >= 0
    # The link between the centres of cells k - 1 and k has the number k.
    link = np.clip(first_cell_behind(layers.depth), 0, solid.shape[axis])
    link[crossing[crossed]] = faces.link[crossed]
    on_face = np.zeros(len(link), bool)
    on_face[crossing[crossed]] = True
    bare = np.flatnonzero(~crossed & (not is_closed))
    pixel = np.concatenate([layers.pixel, faces.pixel[bare]])
    link = np.concatenate([link, faces.link[bare]])
    enters = np.concatenate([layers.entering, faces.enters[bare]])
    depth = np.concatenate([layers.depth, faces.link[bare].astype(float)])
    normal = np.zeros((len(pixel), 3))
    normal[: len(layers.pixel)] = normals[layers.triangle]
    normal[len(layers.pixel) :, axis] = np.where(faces.enters[bare], -1.0, 1.0)
    cell = _cells(pixel, link - ~enters, axis, solid.shape)
    position = cell + 0.5
    position[:, axis] = depth
    thickness = np.append(thickness_behind(layers), np.full(len(bare), np.inf))
    on_face = np.append(on_face, np.ones(len(bare), bool))
    voxel, lost = attach_to_solid(solid, position, cell)
    excess = np.clip(np.where(enters, link - depth, depth - link), -0.5, 0.5)
    slope = np.abs(normal[:, axis])
    # As for a fragment of the dominant axis where no link ends at the surface.
    theta = np.maximum(excess + 0.5, _MIN_THETA) * slope
    return Crossings(
        position=position,
        triangle=np.append(layers.triangle, np.full(len(bare), -1)).astype(np.int32),
        normal=normal,
        axis=np.full(len(pixel), axis, np.int8),
        ahead=~enters,
        ray=pixel + first_ray,
        layer=np.append(layers.layer, np.zeros(len(bare), layers.layer.dtype)),
        voxel=voxel.astype(np.int32),
        depth=np.where(on_face, theta, 0.5),
        excess=excess,
        thickness=thickness,
        on_face=on_face,
        lost=lost,
    )


class _Faces(NamedTuple):
    """Exposed voxel faces across one axis, sorted by ray and place."""

    pixel: Int[np.ndarray, " k"]
    link: Int[np.ndarray, " k"]
    enters: Bool[np.ndarray, " k"]
    """True where a ray along the axis enters the solid."""


# Cells that are compared at once: temporaries stay in the cache.
_CHUNK_CELLS = 2**19


def _exposed_faces(solid: Bool[np.ndarray, "x y z"], axis: int) -> _Faces:
    row_axis, column_axis = pixel_axes(axis)
    planes = max(_CHUNK_CELLS // (solid.shape[1] * solid.shape[2]), 1)
    span, keys = solid.shape[axis] + 1, []
    for start in range(0, solid.shape[0], planes):
        # In the order of memory, whatever the axis is.
        voxel = _steps(solid, axis, slice(start, start + planes))
        pixel = voxel[row_axis] * solid.shape[column_axis] + voxel[column_axis]
        keys.append(pixel * span + voxel[axis])
    last = np.nonzero(solid.take(-1, axis).reshape(-1))[0]
    if row_axis > column_axis:
        row, column = np.divmod(last, solid.shape[row_axis])[::-1]
        last = row * solid.shape[column_axis] + column
    key = np.sort(np.concatenate([*keys, last * span + span - 1]))
    pixel, link = np.divmod(key, span)
    voxel = _cells(pixel, np.minimum(link, span - 2), axis, solid.shape)
    return _Faces(pixel, link, solid[tuple(voxel.T)] & (link < span - 1))


def _steps(
    solid: Bool[np.ndarray, "x y z"], axis: int, planes: slice
) -> tuple[np.ndarray, ...]:
    """Voxels in some planes that differ from those before them along an axis."""
    # Outside the lattice nothing is solid.
    here = solid[planes]
    differs = here.copy()
    later, earlier = np.moveaxis(differs, axis, 0)[1:], np.moveaxis(here, axis, 0)[:-1]
    later ^= earlier
    if axis == 0 and planes.start:
        differs[0] ^= solid[planes.start - 1]
    flat = np.flatnonzero(differs)
    flat += planes.start * solid[0].size
    return np.unravel_index(flat, solid.shape)


def _crossing_of_faces(
    layers: DepthLayers, faces: _Faces, length: int
) -> Int[np.ndarray, " e"]:
    """Crossing of each face, the nearest to its solid voxel; -1 for none."""
    # Crossings in order of direction, ray and depth, with one number for all three.
    span = length + 4.0
    base = lambda pixel, enters: (
        (enters * (layers.width * layers.height) + pixel) * span
    )
    ahead = np.argsort(layers.entering, kind="stable")
    found = (base(layers.pixel, layers.entering) + layers.depth)[ahead]
    if (found[1:] < found[:-1]).any():
        # Layers are sorted by rounded depths.
        ahead = np.lexsort([layers.depth, layers.pixel, layers.entering])
        found = (base(layers.pixel, layers.entering) + layers.depth)[ahead]
    # The link reaches from one voxel's centre to the other's, and a little farther.
    middle = base(faces.pixel, faces.enters) + faces.link
    near, far = middle - 0.5 - _MAX_SNAP, middle + 0.5 + _MAX_SNAP
    # Of several the solid voxel is beyond the last that enters, before the first that
    # leaves.
    first = np.searchsorted(found, near)
    beyond = np.append(found, [np.inf, np.inf])
    last = np.where(beyond[first] < far, first, first - 1)
    several = np.flatnonzero(beyond[first + 1] < far)
    last[several] = np.searchsorted(found, far[several]) - 1
    return np.where(
        last >= first, np.append(ahead, -1)[np.where(faces.enters, last, first)], -1
    )


def _cells(pixel, along, axis: int, shape: tuple[int, ...]) -> Int[np.ndarray, "s 3"]:
    """Cells of pixels at a place along the axis."""
    row_axis, column_axis = pixel_axes(axis)
    cell = np.zeros((len(pixel), 3), np.int64)
    cell[:, row_axis], cell[:, column_axis] = np.divmod(pixel, shape[column_axis])
    cell[:, axis] = along
    return cell
