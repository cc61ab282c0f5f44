"""Mass of a body."""

import numpy as np

from ..structures.partition.assignment import volume_within
from .scene import AbstractMaterials, Body


def body_mass(body: Body) -> float:
    """Mass of a body whose densities are known [kg]: the sum of rho V of its nodes."""
    structure = body.structure
    material = body.material
    if not isinstance(material, AbstractMaterials):
        return float(material.density) * structure.grid.body_volume
    volume = volume_within(structure, np.ones(structure.grid.solid_count))
    density = np.asarray(material.table("density", float))
    return float((density[material.of_nodes(structure)] * volume).sum())
