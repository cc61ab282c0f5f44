"""Surfaces for the tests of wind and free convection."""

import functools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.geometry import shapes
from jaxthermo.physics.occluder import Occluder
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import surface_of, whole


DIAMETER = 0.1
HEIGHT = 0.1


@functools.cache
def upright_cylinder():
    """Cylinder with 20 voxels across."""
    return voxelize(shapes.cylinder(DIAMETER / 2, HEIGHT), DIAMETER / 20)


def behind(shift, aside=0.0):
    """The cylinder that far behind another of its kind, in diameters of both."""
    seen = surface_of(upright_cylinder())
    upstream = seen.scene_triangles - DIAMETER * np.array([shift, aside, 0.0])
    occluders = (*seen.occluders, Occluder.of_triangles(upstream))
    return replace(seen, occluders=occluders)


def law_of(term, seen, reference=300.0):
    """The law of a term's only binding."""
    (binding,) = term.bind(whole(seen, reference=reference))
    return binding.law


@eqx.filter_jit
def flux_and_slope(law, theta, time):
    """Flux and slope in every cell, at temperatures above the reference."""
    return law.flux(time, theta), law.slope(time, theta)


def cells_of(law):
    """Number of cells of a law."""
    return max(np.shape(leaf)[-1] for leaf in jax.tree.leaves(law) if np.ndim(leaf))


def flux_at(law, temperature, time=0.0):
    """Heat flux into every cell, all at one temperature [W/m^2]."""
    reference = float(law.reference)
    theta = jnp.asarray(np.full(cells_of(law), temperature - reference))
    return np.asarray(flux_and_slope(law, theta, jnp.asarray(np.float64(time)))[0])
