"""Surfaces for the tests of wind and free convection."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Pose
from jaxthermo.physics.surface import BodySurface, Surface
from jaxthermo.voxels.voxelize import voxelize


DIAMETER = 0.1
HEIGHT = 0.1


@functools.cache
def upright_cylinder():
    """Cylinder with 20 voxels across."""
    return voxelize(shapes.cylinder(DIAMETER / 2, HEIGHT), DIAMETER / 20)


def surface(grid, pose=None, triangles=None, dtype=np.float64, **changes):
    """The whole surface of a body as terms see it."""
    pose = pose or Pose()
    count = len(grid.fragment_area)
    fields = {
        "body": 0,
        "grid": grid,
        "pose": pose,
        "position": pose.to_world(grid.fragment_position),
        "normal": pose.rotate(grid.fragment_normal),
        "area": grid.fragment_area.astype(dtype),
        "exposed_fraction": np.ones(count),
        "natural": np.ones(count, bool),
        "half_cell": np.ones(count),
        "emissivity": np.ones(()),
        "absorptivity": np.ones(()),
        "scene_triangles": pose.to_world(grid.mesh.triangles)
        if triangles is None
        else triangles,
        "dtype": np.dtype(dtype),
    }
    return BodySurface(**{**fields, **changes})


def scene_surface(body, reference=300.0):
    """The surface of a scene with one body."""
    return Surface((body,), (reference,))


def law_of(term, seen, reference=300.0):
    """The law of a term's only binding."""
    (binding,) = term.bind(scene_surface(seen, reference))
    return binding.law


@eqx.filter_jit
def flux_and_slope(law, theta, time):
    """Flux and slope in every cell, at temperatures above the reference."""
    return law.flux(time, theta), law.slope(time, theta)


def flux_at(law, temperature, count, time=0.0):
    """Heat flux into every cell, all at one temperature [W/m^2]."""
    reference = float(law.reference)
    theta = jnp.asarray(np.full(count, temperature - reference))
    return np.asarray(flux_and_slope(law, theta, jnp.asarray(np.float64(time)))[0])
