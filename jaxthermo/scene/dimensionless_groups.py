"""Dimensionless groups of a scene: the range in which fitted weights are valid.

| number | meaning |
|---|---|
| biot | h L / k: h of air and radiation, L = V / A of the body |
| fourier | alpha t / L^2 of the run |
| voxels_across | L over the pitch |
| heating | flux of the sources, and L times a density, times L / k [K]: the load |

Properties and coefficients are those at the mean of the body's start. With several
bodies, the largest number counts, and the smallest `voxels_across`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..material.layer import Layer
from ..material.material import Material
from ..physics.term import OperatingPoint
from ..structures.kinds.sheet import Sheet
from .air import bodies_with_surface
from .scene import Body, Scene


def scene_numbers(scene: Scene, end: float) -> dict[str, float]:
    """Biot, Fourier, voxels across and heating of a scene in a run to `end` [s].

    They are those of its bodies with a surface; air has none.
    """
    by_body = [body_numbers(scene, body, end) for body in bodies_with_surface(scene)]
    rules = {name: min if name == "voxels_across" else max for name in by_body[0]}
    return {
        name: float(rule(numbers[name] for numbers in by_body))
        for name, rule in rules.items()
    }


def body_numbers(scene: Scene, body: Body, end: float) -> dict[str, float]:
    """Biot, Fourier, voxels across and heating of one body of the scene."""
    grid = body.structure.grid
    volume = body.structure.volume
    length = float(volume / grid.fragment_area.sum())
    # Of several materials the base one stands for the body, of parts the first one.
    material: Any = getattr(body.material, "materials", (body.material,))[0]
    if isinstance(body.structure, Sheet):
        material = _through(body.structure.stacks[0])
    start: Any = body.temperature
    if callable(start):
        start = np.mean(np.asarray(start(body.structure.nodes().location)))
    kelvin = float(start)
    properties = material.at(kelvin)
    k = float(np.mean(np.asarray(properties.conductivity, float)))
    diffusivity = k / float(properties.volumetric_heat_capacity)
    point = OperatingPoint(
        material=material,
        kelvin=kelvin,
        end=end,
        structures=scene.structures,
    )
    scales = [term.scale(point) for term in scene.terms]
    flux = sum(
        (scale.heat_flux + scale.heat_rate_density * length for scale in scales), 0.0
    )
    coefficient = sum((scale.heat_transfer_coefficient for scale in scales), 0.0)
    return {
        "biot": float(coefficient * length / k),
        "fourier": float(diffusivity * end / (length * length)),
        "voxels_across": length / grid.pitch,
        "heating": flux * length / k,
    }


def _through(stack: Sequence[Layer]) -> Material:
    """Material of a wall of one layer that is like a stack through its thickness."""
    thickness = float(sum(layer.thickness for layer in stack))
    mass = float(sum(layer.material.density * layer.thickness for layer in stack))
    return Material(
        thickness / float(sum(layer.resistance for layer in stack)),
        density=mass / thickness,
        specific_heat=float(sum(layer.capacity for layer in stack)) / mass,
        emissivity=stack[0].material.emissivity,
        absorptivity=stack[0].material.absorptivity,
    )
