"""Depth layers along the three axes of a lattice."""

import numpy as np

from ..geometry.mesh import Mesh
from ..raster.fragments import capacities
from ..raster.layers import DepthLayers, peel
from .lattice import Lattice


def pixel_axes(axis: int) -> tuple[int, int]:
    """Lattice axes of the rows and columns of the view along `axis`.

    Column, row and depth axes are a right-handed frame.
    """
    return (axis + 2) % 3, (axis + 1) % 3


def peel_axes(
    mesh: Mesh, lattice: Lattice
) -> tuple[DepthLayers, DepthLayers, DepthLayers]:
    """Depth layers of a mesh seen along x, y and z; depths in cells."""
    corners = lattice.to_cells(mesh.triangles)
    frames, sizes, needs = [], [], []
    for axis in range(3):
        row_axis, column_axis = pixel_axes(axis)
        frame = np.ascontiguousarray(corners[..., [column_axis, row_axis, axis]])
        size = lattice.shape[column_axis], lattice.shape[row_axis]
        frames.append(frame)
        sizes.append(size)
        needs.append(capacities(frame, *size))
    # One array size for the three views: one program is compiled, not three.
    largest = max(n[0] for n in needs), max(n[1] for n in needs)
    x, y, z = (
        peel(frame, width, height, largest)
        for frame, (width, height) in zip(frames, sizes, strict=True)
    )
    return x, y, z
