"""Surfaces and bodies for the tests of radiation."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxthermo.geometry.mesh import Mesh, Pose
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.occluder import Occluder
from jaxthermo.physics.radiation.patches import PatchedBody, group_patches
from jaxthermo.physics.radiation.source import AbstractSource
from jaxthermo.physics.surface import Binding, BodySurface, Surface
from jaxthermo.voxels.abstract_grid import AbstractGrid
from jaxthermo.voxels.grid import VoxelGrid
from tests.bodies import hollow


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
        emissivity=np.asarray(emissivity),
        absorptivity=np.asarray(1.0),
        occluders=tuple(
            map(Occluder.of_triangles, (pose.to_world(grid.mesh.triangles), *obstacles))
        ),
        dtype=np.dtype("float64"),
    )


def whole(*bodies, reference=300.0):
    """The surface of a scene of these bodies, all counted from one temperature."""
    count = sum(len(body.area) for body in bodies)
    return Surface(bodies, (reference,) * len(bodies), half_cell=np.full(count, 1e3))


def shell(inner: float, outer: float, subdivisions: int = 3) -> Mesh:
    """A hollow sphere."""
    return hollow(sphere(outer, subdivisions), sphere(inner, subdivisions))


def room(inner: float, outer: float) -> Mesh:
    """A closed cubic room, by the edges of both surfaces."""
    return hollow(box(outer), box(inner))


def exposure(grid: VoxelGrid, source: AbstractSource, *obstacles: Mesh) -> np.ndarray:
    """Exposure of a body's fragments, with other meshes that cast shadows."""
    triangles = np.concatenate([grid.mesh.triangles, *(m.triangles for m in obstacles)])
    return source.exposure(
        triangles, grid.fragment_position, grid.fragment_normal, grid.pitch
    )


def check_terminator(exposed, cosine, rounding=0.0):
    """Nothing is lit beyond the terminator, and nothing shaded far before it."""
    assert exposed[cosine <= 0].max() == 0.0
    lit = cosine[cosine > 0]
    share = exposed[cosine > 0] / lit
    # No acne: within a few degrees of the terminator rays graze the next facet.
    assert lit[share < 1.0 - rounding].max(initial=0.0) < np.sin(np.deg2rad(5.0))


def heat_into(binding: Binding) -> np.ndarray:
    """Heat rate into each fragment at the reference temperature [W]."""
    area = np.asarray(binding.effective_area)
    return area * np.asarray(binding.law.flux(jnp.zeros(()), jnp.zeros(len(area))))


def in_patches(
    grid: AbstractGrid, max_patches: int, pose=STANDING, area: Any = None
) -> PatchedBody:
    if area is None:
        area = grid.fragment_area
    patches = group_patches(grid, area=area, max_patches=max_patches)
    return PatchedBody.of_grid(grid, patches, pose)
