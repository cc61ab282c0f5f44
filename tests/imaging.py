"""Bodies and images for the tests of what a camera sees of the heat balance."""

import numpy as np

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN as SIGMA
from jaxthermo.scene.scene import per_fragment
from tests.bodies import body_at


def metal(emissivity, absorptivity=None):
    return jt.Material(
        conductivity=400.0,
        density=8000.0,
        specific_heat=400.0,
        emissivity=emissivity,
        absorptivity=absorptivity,
    )


def block(size, kelvin, material, at=(0.0, 0.0, 0.0), pitch=0.01):
    grid = jt.voxelize(jt.shapes.box(size), pitch)
    return body_at(grid, material, kelvin, at=at)


def at_start(bodies, *terms):
    return jt.simulate(jt.Scene(tuple(bodies), terms, dtype="float64"), 0.0)


def radiosity(solution, index=-1):
    """Radiation that leaves each fragment, as the renderer draws it [W/m^2]."""
    kelvin = np.asarray(solution.surface_temperature)[index]
    emissivity = np.asarray(per_fragment(solution.surfaces, "emissivity"))
    reflected = np.asarray(solution.reflected(index))
    return emissivity * SIGMA * kelvin**4 + reflected


def apparent(image):
    return np.asarray(image.apparent_temperature)


def on_body(image):
    return np.asarray(image.object_id) >= 0
