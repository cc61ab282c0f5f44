"""Voxel textures of thesis 4.1 and 4.2 (figures 4.3 to 4.6) as images.

Images are views along +x, +y or +z with z up (along z: y up).
"""

import numpy as np
from jaxtyping import Float, UInt8

from .grid import VoxelGrid
from .lattice import peel_axes, pixel_axes
from .surface import face_axes


_BACKGROUND = np.array([16, 17, 20], np.uint8)

AXIS_COLOURS = np.array(
    [[222, 72, 62], [84, 180, 84], [72, 112, 226], [128, 128, 128]], np.uint8
)
"""sRGB of normals along x, y, z and of faces without area."""


def layer_images(grid: VoxelGrid) -> dict[str, list[UInt8[np.ndarray, "h w 3"]]]:
    """Draw every depth layer as an RGB image, front layer first.

    The keys are an axis and a kind, such as "x_depth". "depth" (near is bright),
    "normal" (rgb = (n + 1) / 2) and "dominant" (axis of the normal: red x, green y,
    blue z) show all layers; "packed" shows the normals of the surface fragments, each
    moved to the first free layer.
    """
    normals, dominant = face_axes(grid.mesh)
    fragment_colours = normal_colours(grid.fragment_normal)
    images = {}
    for axis, layers in enumerate(peel_axes(grid.mesh, grid.lattice)):
        axis_name = "xyz"[axis]
        depth = np.clip(layers.depth / grid.lattice.shape[axis], 0, 1)
        paints = {
            "depth": depth_colours(depth),
            "normal": normal_colours(normals[layers.triangle]),
            "dominant": AXIS_COLOURS[dominant[layers.triangle]],
        }
        for quantity, colours in paints.items():
            painted = [
                layers.image(layer, values=colours, background=_BACKGROUND)
                for layer in range(layers.count)
            ]
            images[f"{axis_name}_{quantity}"] = [
                _upright(image, axis) for image in painted
            ]
        images[f"{axis_name}_packed"] = packed_images(
            grid, axis=axis, colours=fragment_colours
        )
    return images


def packed_images(
    grid: VoxelGrid, axis: int, colours: UInt8[np.ndarray, "s 3"]
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Draw the surface fragments of an axis, packed forwards, in given colours."""
    on_axis = grid.is_packed(axis)
    position = grid.lattice.to_cells(grid.fragment_position[on_axis])
    cell = np.floor(position).astype(int)
    rank = grid.fragment_layer[on_axis, 1]
    row_axis, column_axis = pixel_axes(axis)
    height = grid.lattice.shape[row_axis]
    width = grid.lattice.shape[column_axis]
    stack = np.empty((grid.layers.packed[axis], height, width, 3), np.uint8)
    stack[:] = _BACKGROUND
    stack[rank, cell[:, row_axis], cell[:, column_axis]] = colours[on_axis]
    return [_upright(image, axis) for image in stack]


def _upright(image: UInt8[np.ndarray, "h w 3"], axis: int) -> np.ndarray:
    """Rotate and mirror a raster image so that up is at the top."""
    # Along y the raster has z in its columns; along x and z, right is against the
    # column axis.
    if axis == 1:
        return image.transpose(1, 0, 2)[::-1]
    return image[::-1, ::-1]


def normal_colours(normal: Float[np.ndarray, "k 3"]) -> UInt8[np.ndarray, "k 3"]:
    """Red, green and blue as (n + 1) / 2 of the components of unit normals."""
    return np.round(127.5 * (normal + 1)).astype(np.uint8)


def depth_colours(depth: Float[np.ndarray, " k"]) -> UInt8[np.ndarray, "k 3"]:
    """Greys of depths from the front of the lattice, 0, to its back, 1."""
    level = np.round(255 - 190 * depth)
    return np.repeat(level.astype(np.uint8)[:, None], 3, axis=1)
