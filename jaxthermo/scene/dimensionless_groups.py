"""The numbers that tell one scene from another: how far weights that were fitted hold.

| number | meaning |
|---|---|
| biot | h L / k: h of air and radiation, L = V / A of the body |
| fourier | alpha t / L^2 of the run |
| voxels_across | L over the pitch |
| heating | flux of the sources times L / k [K]: the load |

Of several bodies the largest of each but `voxels_across`, the smallest.
"""

from typing import Any

import numpy as np

from ..constants import STEFAN_BOLTZMANN
from ..dimensionless import biot, characteristic_length, fourier
from ..physics.boundary import Convection, HeatFlux
from ..physics.radiation.emission import Surroundings
from ..physics.radiation.source import Sun
from ..physics.time_varying import largest
from .scene import Body, Scene


def scene_numbers(scene: Scene, end: float) -> dict[str, float]:
    """Biot, Fourier, voxels across and heating of a scene.

    Args:
        scene: with values that are known.
        end: of its run [s].
    """
    each = [body_numbers(scene, body, end) for body in scene.bodies]
    pick = lambda name, rule: float(rule([one[name] for one in each]))
    return {
        "biot": pick("biot", max),
        "fourier": pick("fourier", max),
        "voxels_across": pick("voxels_across", min),
        "heating": pick("heating", max),
    }


def body_numbers(scene: Scene, body: Body, end: float) -> dict[str, float]:
    """The same of one body.

    Args:
        scene: it is in.
        body: itself.
        end: of its run [s].
    """
    grid = body.structure.grid
    volume = grid.solid_count * grid.voxel_volume
    length = float(characteristic_length(volume, grid.fragment_area.sum()))
    material: Any = getattr(body.material, "materials", (body.material,))[0]
    start = body.temperature
    kelvin = 300.0 if callable(start) else float(start)
    known = material.at(kelvin)
    k = float(np.mean(np.asarray(known.conductivity, float)))
    diffusivity = k / float(known.volumetric_heat_capacity)
    flux, coefficient = 0.0, 0.0
    for term in scene.terms:
        one, other = _strengths(term, material, kelvin, end)
        flux, coefficient = flux + one, coefficient + other
    return {
        "biot": float(biot(coefficient, length, k)),
        "fourier": float(fourier(diffusivity, end, length)),
        "voxels_across": length / grid.pitch,
        "heating": flux * length / k,
    }


def _strengths(term: Any, material: Any, kelvin: float, end: float):
    """Heat flux [W/m^2] and heat transfer coefficient [W/(m^2 K)] of a term."""
    match term:
        case Convection():
            return 0.0, float(largest(term.heat_transfer_coefficient, end))
        case Surroundings():
            slope = 4 * STEFAN_BOLTZMANN * kelvin**3
            return 0.0, float(material.emissivity) * slope
        case Sun():
            strength = float(largest(term.irradiance, end))
            return float(material.absorptivity) * strength, 0.0
        case HeatFlux():
            return abs(float(largest(term.heat_flux, end))), 0.0
        case _:
            return 0.0, 0.0
