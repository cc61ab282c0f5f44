"""Surface fragments: each piece of surface once, with its true area and its voxel.

Thesis 4.2 keeps a fragment in the view along the dominant axis of its normal. The ray
grid of that view cuts the surface into pieces of area pitch^2 / |n_i| (thesis' own
pitch^2 counts only 83 % of a sphere, exposed voxel faces 150 %).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..raster.layers import DepthLayers
from .fill import first_cell_behind, pixel_axes


class AxisFragments(NamedTuple):
    """The fragments kept in the view along one axis, in lattice units."""

    position: Float[np.ndarray, "s 3"]
    triangle: Int[np.ndarray, " s"]
    inward_cell: Int[np.ndarray, "s 3"]
    """First cell on the ray whose centre lies inside."""
    layer: Int[np.ndarray, "s 2"]
    """Rank on the ray as peeled, and among the kept ones (packed)."""
    thickness: Float[np.ndarray, " s"]
    """Distance along the ray to the other side of the body."""


def _packed_layers(pixel: Int[np.ndarray, " s"]) -> Int[np.ndarray, " s"]:
    """Rank of each fragment within its pixel; pixels come in order."""
    first = np.concatenate([[True], pixel[1:] != pixel[:-1]])
    slots = np.arange(len(pixel))
    return slots - np.maximum.accumulate(np.where(first, slots, 0))


def _thickness(layers: DepthLayers, entering: Bool[np.ndarray, " k"]) -> np.ndarray:
    """Depth from each crossing to the next one on the body's side of it."""
    step = np.where(entering, 1, -1)
    other = np.clip(np.arange(len(entering)) + step, 0, max(len(entering) - 1, 0))
    paired = (layers.pixel[other] == layers.pixel) & (entering[other] != entering)
    return np.where(paired, np.abs(layers.depth[other] - layers.depth), np.inf)


def axis_fragments(
    layers: DepthLayers,
    entering: Bool[np.ndarray, " k"],
    dominant: Int[np.ndarray, " k"],
    axis: int,
) -> AxisFragments:
    """Keep the fragments whose normal is dominated by `axis`; pack them forwards."""
    thickness = _thickness(layers, entering)
    keep = dominant == axis
    pixel, depth, entering = layers.pixel[keep], layers.depth[keep], entering[keep]
    row_axis, column_axis = pixel_axes(axis)
    cell = np.empty((len(pixel), 3), np.int64)
    cell[:, row_axis], cell[:, column_axis] = np.divmod(pixel, layers.width)
    behind = first_cell_behind(depth)
    cell[:, axis] = np.where(entering, behind, behind - 1)
    position = cell + 0.5
    position[:, axis] = depth
    packed = _packed_layers(pixel) if len(pixel) else np.zeros(0, np.int64)
    return AxisFragments(
        position=position,
        triangle=layers.triangle[keep],
        inward_cell=cell,
        layer=np.stack([layers.layer[keep], packed], axis=1),
        thickness=thickness[keep],
    )


def attach_to_solid(
    solid: Bool[np.ndarray, "x y z"],
    position: Float[np.ndarray, "s 3"],
    inward_cell: Int[np.ndarray, "s 3"],
) -> tuple[Int[np.ndarray, "s 3"], Bool[np.ndarray, " s"]]:
    """The solid voxel of each fragment, and which fragments have none near.

    The first cell inward is solid wherever the body is a voxel thick. Elsewhere the
    nearest solid voxel within two cells is taken; a part farther from any is lost.
    """
    shape = np.array(solid.shape)
    cell = np.clip(inward_cell, 0, shape - 1)
    found = solid[tuple(cell.T)]
    stray = np.flatnonzero(~found)
    reach = np.arange(-2, 3)
    offsets = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), -1)
    candidates = cell[stray, None] + offsets.reshape(1, -1, 3)
    within = ((candidates >= 0) & (candidates < shape)).all(-1)
    safe = np.clip(candidates, 0, shape - 1)
    near = within & solid[tuple(np.moveaxis(safe, -1, 0))]
    apart = ((candidates + 0.5 - position[stray, None]) ** 2).sum(-1)
    best = np.where(near, apart, np.inf).argmin(1)
    rows = np.arange(len(stray))
    cell[stray] = safe[rows, best]
    found[stray] = near[rows, best]
    return cell, ~found


def surface_voxels(solid: Bool[np.ndarray, "x y z"]) -> Int[np.ndarray, "m 3"]:
    """Solid voxels with an empty face neighbour, in lattice order."""
    exposed = np.zeros(solid.shape, bool)
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        open_side = np.moveaxis(exposed, axis, 0)
        open_side[1:] |= ~body[:-1]
        open_side[:-1] |= ~body[1:]
        open_side[[0, -1]] = True
    exposed &= solid
    return np.argwhere(exposed)


def surface_links(
    voxels: Int[np.ndarray, "m 3"], shape: tuple[int, int, int]
) -> Int[np.ndarray, "e 2"]:
    """Pairs of surface voxels that touch over a face, an edge or a corner (26)."""
    padded = np.array(shape) + 2
    strides = np.array([padded[1] * padded[2], padded[2], 1])
    key = (voxels + 1) @ strides
    slot = np.full(int(padded.prod()), -1, np.int32)
    slot[key] = np.arange(len(voxels), dtype=np.int32)
    reach = np.arange(-1, 2)
    offsets = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), -1)
    pairs = []
    for jump in (offsets.reshape(-1, 3) @ strides)[14:]:
        other = slot[key + jump]
        linked = np.flatnonzero(other >= 0)
        pairs.append(np.stack([linked.astype(np.int32), other[linked]], axis=1))
    return np.concatenate(pairs)
