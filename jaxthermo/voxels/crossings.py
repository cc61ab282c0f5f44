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

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..raster.fragments import DepthLayers
from .fill import first_cell_behind
from .lattice import pixel_axes
from .surface import (
    attach_to_solid,
    hidden_inside,
    joined_columns,
    selected,
    thickness_behind,
)
from .voxel_bits import VoxelBits


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
    axis: Int[np.ndarray, " s"]
    """Axis of the ray."""
    ahead: Bool[np.ndarray, " s"]
    """True where the body is left along +axis."""
    ray: Int[np.ndarray, " s"]
    """Number of the ray among those of all three views."""
    layer: Int[np.ndarray, " s"]
    """Depth layer in the view."""
    number: Int[np.ndarray, " s"]
    """Number in `VoxelBits` of the solid voxel that the crossing belongs to."""
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

    def normals(
        self, of_faces: Float[np.ndarray, "f 3"], which: Int[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k 3"]:
        """Outward normals of the crossings `which`, from the normals of all faces."""
        triangle = self.triangle[which]
        normal = of_faces.take(triangle, axis=0, mode="wrap")
        bare = np.flatnonzero(triangle < 0)
        normal[bare] = 0
        crossing = which[bare]
        normal[bare, self.axis[crossing]] = np.where(self.ahead[crossing], 1.0, -1.0)
        return normal


class Cells(NamedTuple):
    """Surface cells, by the number of their voxel."""

    normal: Float[np.ndarray, "s 3"]
    axis: Int[np.ndarray, " s"]
    ahead: Bool[np.ndarray, " s"]
    number: Int[np.ndarray, " s"]
    excess: Float[np.ndarray, " s"]
    on_face: Bool[np.ndarray, " s"]


def find_crossings(
    views: Iterable[DepthLayers],
    solid: Bool[np.ndarray, "x y z"],
    normals: Float[np.ndarray, "f 3"],
    is_closed: bool,
) -> tuple[Crossings, float]:
    """Crossings of all views, and the area hidden inside the body [voxel faces].

    From the normals of all triangles, and whether these are closed.
    """
    crossings_by_axis = []
    hidden_area = 0.0
    rays = 0
    slopes = np.abs(normals.T)
    bits = VoxelBits.of(solid)
    for axis, layers in enumerate(views):
        inside = hidden_inside(layers, slopes[axis])
        hidden_area += float(slopes[axis][layers.triangle[inside]].sum())
        outer = selected(layers, ~inside) if inside.any() else layers
        # The last slope, 1, is that of faces that no ray crosses: triangle -1.
        slope = np.append(slopes[axis], 1.0)
        crossings = _along(
            outer, solid=solid, bits=bits, slope=slope, is_closed=is_closed, axis=axis
        )
        crossings.ray[:] += rays
        crossings_by_axis.append(crossings)
        rays += layers.width * layers.height
    del outer, layers, crossings
    return Crossings(*joined_columns(crossings_by_axis)), hidden_area


def _along(
    layers: DepthLayers,
    solid: Bool[np.ndarray, "x y z"],
    bits: VoxelBits,
    slope: Float[np.ndarray, " f"],
    is_closed: bool,
    axis: int,
) -> Crossings:
    length = solid.shape[axis]
    faces = _exposed_faces(bits, axis)
    crossing = _crossing_of_faces(layers, faces, length)
    crossed = np.flatnonzero(crossing >= 0)
    # The link between the centres of cells k - 1 and k has the number k.
    link = np.clip(first_cell_behind(layers.depth), 0, length)
    link[crossing[crossed]] = faces.link[crossed]
    on_face = np.zeros(len(link), bool)
    on_face[crossing[crossed]] = True
    thickness = thickness_behind(layers)
    if not is_closed:
        bare = np.flatnonzero(crossing < 0)
        layers = _with_bare(layers, faces, bare)
        link = np.append(link, faces.link[bare])
        on_face = np.append(on_face, np.ones(len(bare), bool))
        thickness = np.append(thickness, np.full(len(bare), np.inf))
    enters = layers.entering
    triangle = layers.triangle.astype(np.int32)
    cell = _cells(
        layers.pixel,
        along=np.clip(link - ~enters, 0, length - 1),
        axis=axis,
        layers=layers,
    )
    position = np.empty((len(link), 3))
    for component in range(3):
        np.add(cell[component], 0.5, out=position[:, component])
    position[:, axis] = layers.depth
    number = bits.number(cell)
    lost = np.zeros(len(link), bool)
    stray = np.flatnonzero(~bits.has(number))
    if len(stray):
        stray_cell = np.stack([component[stray] for component in cell], axis=1)
        near, lost[stray] = attach_to_solid(solid, position[stray], stray_cell)
        number[stray] = bits.number(tuple(near.T))
    excess = link - layers.depth
    np.negative(excess, out=excess, where=~enters)
    np.clip(excess, -0.5, 0.5, out=excess)
    # As for a fragment of the dominant axis where no link ends at the surface.
    theta = np.maximum(excess + 0.5, _MIN_THETA) * slope[triangle]
    return Crossings(
        position=position,
        triangle=triangle,
        axis=np.full(len(link), axis, np.int8),
        ahead=~enters,
        ray=layers.pixel.copy(),
        layer=layers.layer.astype(np.int32),
        number=number,
        depth=np.where(on_face, theta, 0.5),
        excess=excess,
        thickness=thickness,
        on_face=on_face,
        lost=lost,
    )


def _with_bare(
    layers: DepthLayers, faces: "_Faces", bare: Int[np.ndarray, " k"]
) -> DepthLayers:
    """Crossings, followed by the faces `bare` that no ray crosses."""
    count = len(bare)
    return replace(
        layers,
        pixel=np.append(layers.pixel, faces.pixel[bare]),
        depth=np.append(layers.depth, faces.link[bare].astype(float)),
        triangle=np.append(layers.triangle, np.full(count, -1)),
        entering=np.append(layers.entering, faces.enters[bare]),
        layer=np.append(layers.layer, np.zeros(count, layers.layer.dtype)),
    )


class _Faces(NamedTuple):
    """Exposed voxel faces across one axis, sorted by ray and position along it."""

    pixel: Int[np.ndarray, " k"]
    link: Int[np.ndarray, " k"]
    enters: Bool[np.ndarray, " k"]
    """True where a ray along the axis enters the solid."""


def _exposed_faces(bits: VoxelBits, axis: int) -> _Faces:
    row_axis, column_axis = pixel_axes(axis)
    # Outside the lattice nothing is solid.
    shifted = bits.shifted(axis, ahead=True)
    differs = VoxelBits(shape=bits.shape, word=bits.word ^ shifted)
    number = differs.numbers()
    voxel = bits.cells(number)
    span = bits.shape[axis] + 1
    key = np.multiply(voxel[row_axis], bits.shape[column_axis], dtype=np.int64)
    key += voxel[column_axis]
    key *= span
    key += voxel[axis]
    key *= 2
    key += bits.has(number)
    key.sort()
    pixel, link = np.divmod(key >> 1, span)
    return _Faces(pixel=pixel, link=link, enters=(key & 1).astype(bool))


def _crossing_of_faces(
    layers: DepthLayers, faces: _Faces, length: int
) -> Int[np.ndarray, " e"]:
    """Crossing of each face, the nearest to its solid voxel; -1 for none."""
    crossing = np.full(len(faces.link), -1)
    for enters in (False, True):
        face = np.flatnonzero(faces.enters == enters)
        candidate = np.flatnonzero(layers.entering == enters)
        # Rays and depths in one number, in the order of both.
        span = length + 4.0
        key = layers.pixel[candidate] * span + layers.depth[candidate]
        if (key[1:] < key[:-1]).any():
            # Layers are sorted by rounded depths.
            order = np.argsort(key, kind="stable")
            candidate = candidate[order]
            key = key[order]
        # The link reaches from one voxel's centre to the other's, and a little farther.
        middle = faces.pixel[face] * span + faces.link[face]
        near = middle - 0.5 - _MAX_SNAP
        far = middle + 0.5 + _MAX_SNAP
        first = np.searchsorted(key, near)
        beyond = np.append(key, [np.inf, np.inf])
        last = np.where(beyond[first] < far, first, first - 1)
        several = np.flatnonzero(beyond[first + 1] < far)
        last[several] = np.searchsorted(key, far[several]) - 1
        # Among several crossings the solid voxel is behind the last one that enters
        # and in front of the first one that leaves.
        is_met = np.flatnonzero(last >= first)
        nearest = last if enters else first
        crossing[face[is_met]] = candidate[nearest[is_met]]
    return crossing


def _cells(
    pixel: Int[np.ndarray, " s"],
    along: Int[np.ndarray, " s"],
    axis: int,
    layers: DepthLayers,
) -> list[np.ndarray]:
    """x, y and z of the cells of pixels, with their index along the view's axis."""
    row_axis, column_axis = pixel_axes(axis)
    cell = [along] * 3
    cell[row_axis], cell[column_axis] = np.divmod(pixel, layers.width)
    return cell
