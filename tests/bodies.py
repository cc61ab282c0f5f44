"""Small bodies and scenes for tests: bars, given voxels, hollow meshes."""

from dataclasses import replace
from typing import Any

import numpy as np

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import box
from jaxthermo.voxels.grid import LayerCounts, VoxelGrid
from jaxthermo.voxels.lattice import Lattice
from jaxthermo.voxels.thin_parts import ThinParts
from jaxthermo.voxels.voxelize import voxelize


NO_THIN_PARTS = ThinParts(
    thin_fragments=0, thin_area=0.0, lost_fragments=0, lost_area=0.0, regions=()
)


def bar(cells: int, pitch: float) -> VoxelGrid:
    """A bar of `cells` x 1 x 1 voxels along x, centred at the origin."""
    return voxelize(box((cells * pitch, pitch, pitch)), pitch)


def on_top(grid: VoxelGrid) -> np.ndarray:
    """The fragments on the side +z of a bar: one a voxel, in the order of x."""
    top = np.flatnonzero(grid.fragment_normal[:, 2] > 0.9)
    return top[np.argsort(grid.fragment_position[top, 0])]


def depth(grid: VoxelGrid) -> np.ndarray:
    """Distance of each of a bar's voxels from its end at -x [m]."""
    return (np.arange(grid.lattice.shape[0]) + 0.5) * grid.pitch


def blocks(solid: np.ndarray, pitch: float = 1.0) -> VoxelGrid:
    """A body of the given voxels, with one fragment on every open face."""
    padded = np.pad(solid, 1)
    voxel = []
    normal = []
    for axis in range(3):
        for sign in (-1, 1):
            outside = ~np.roll(padded, -sign, axis)[1:-1, 1:-1, 1:-1]
            cells = np.argwhere(solid & outside)
            voxel.append(cells)
            normal.append(np.tile(sign * np.eye(3)[axis], (len(cells), 1)))
    cells = np.concatenate(voxel)
    outward = np.concatenate(normal)
    order = np.lexsort(cells.T[::-1])
    cells = cells[order]
    outward = outward[order]
    count = len(cells)
    size = np.array(solid.shape) * pitch
    around = box(tuple(size))
    return VoxelGrid(
        lattice=Lattice(solid.shape, np.zeros(3), pitch),
        solid=solid,
        mesh=replace(around, vertices=around.vertices + size / 2),
        fragment_position=(cells + 0.5 + 0.5 * outward) * pitch,
        fragment_normal=outward,
        fragment_area=np.full(count, pitch**2),
        fragment_voxel=cells,
        fragment_axis=np.abs(outward).argmax(1),
        fragment_layer=np.zeros((count, 2), int),
        area_ratio=1.0,
        volume_ratio=1.0,
        layers=LayerCounts((0, 0, 0), (0, 0, 0)),
        thin=NO_THIN_PARTS,
    )


def slanted(pitch: float) -> VoxelGrid:
    """All voxels below a plane that no axis is along."""
    cell = np.argwhere(np.ones((16, 12, 12), bool))
    below = cell[cell @ [0.4, 0.3, 1.0] < 13.0]
    solid = np.zeros((16, 12, 12), bool)
    solid[tuple(below.T)] = True
    return blocks(solid, pitch)


def joined(first: Mesh, second: Mesh) -> Mesh:
    """The surfaces of two meshes in one."""
    return Mesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
        first.name,
    )


def hollow(outer: Mesh, inner: Mesh) -> Mesh:
    """A mesh with a cavity."""
    return joined(outer, replace(inner, faces=inner.faces[:, ::-1]))


def body_at(
    shape: Any,
    material: Any,
    temperature: Any,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **options: Any,
) -> jt.Body:
    """A body at a place in the world; a grid stands for its full volume."""
    structure = jt.FullVolume(shape) if isinstance(shape, VoxelGrid) else shape
    pose = jt.Pose(at)
    return jt.Body(structure, material, temperature=temperature, pose=pose, **options)


def single_body_scene(
    shape: Any,
    material: Any,
    temperature: Any,
    *terms: Any,
    dtype: Dtype = "float64",
    **options: Any,
) -> jt.Scene:
    """A scene of one body with terms; the body is as by `body_at`."""
    body = body_at(shape, material, temperature)
    return jt.Scene((body,), terms, dtype=dtype, **options)
