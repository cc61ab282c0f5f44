"""Surfaces and bodies for the tests of radiation."""

import numpy as np

from jaxthermo.geometry.mesh import Mesh, Pose
from jaxthermo.geometry.shapes import sphere
from jaxthermo.physics.radiation.patches import PatchedBody, group_patches
from jaxthermo.physics.surface import BodySurface, Surface
from jaxthermo.voxels.grid import VoxelGrid


STANDING = Pose()


UPRIGHT = np.eye(3)


def moved(x, y, z, rotation=UPRIGHT) -> Pose:
    a, b, c = ((float(p), float(q), float(r)) for p, q, r in rotation)
    return Pose((float(x), float(y), float(z)), (a, b, c))


def surface_of(grid: VoxelGrid, pose=STANDING, obstacles=(), emissivity=0.8, body=0):
    """The surface of a body of a metal, with the triangles of others in the scene."""
    count = len(grid.fragment_area)
    return BodySurface(
        body=body,
        grid=grid,
        pose=pose,
        position=pose.to_world(grid.fragment_position),
        normal=pose.rotate(grid.fragment_normal),
        area=grid.fragment_area,
        exposed_fraction=np.ones(count),
        natural=np.ones(count, bool),
        half_cell=np.full(count, 1e3),
        emissivity=np.asarray(emissivity),
        absorptivity=np.asarray(1.0),
        scene_triangles=np.concatenate(
            [pose.to_world(grid.mesh.triangles), *obstacles]
        ),
        dtype=np.dtype("float64"),
    )


def whole(*bodies, reference=300.0):
    """The surface of a scene of these bodies, all counted from one temperature."""
    return Surface(bodies, (reference,) * len(bodies))


def shell(inner: float, outer: float, subdivisions: int = 3) -> Mesh:
    """A hollow sphere."""
    hole = sphere(inner, subdivisions)
    ball = sphere(outer, subdivisions)
    return Mesh(
        np.concatenate([ball.vertices, hole.vertices]),
        np.concatenate([ball.faces, hole.faces[:, ::-1] + len(ball.vertices)]),
        "shell",
    )


def in_patches(grid: VoxelGrid, max_patches: int, pose=STANDING) -> PatchedBody:
    patches = group_patches(
        grid.fragment_position,
        normal=grid.fragment_normal,
        area=grid.fragment_area,
        lattice=grid.lattice,
        max_patches=max_patches,
        cavities=grid.cavities,
    )
    return PatchedBody.of_mesh(grid.mesh, patches, pose)
