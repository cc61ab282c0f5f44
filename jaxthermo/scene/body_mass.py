"""Mass of a body."""

import numpy as np

from ..material.air import body_of_air
from ..structures.kinds.air import AirVolume
from ..structures.kinds.sheet import Sheet
from ..structures.volumes import node_volumes
from .body_materials import AbstractMaterials
from .scene import Body


def body_mass(body: Body) -> float:
    """Mass of a body whose densities are known [kg]: the sum of rho V of its nodes."""
    structure = body.structure
    material = body.material
    if isinstance(structure, Sheet):
        return structure.mass
    if isinstance(structure, AirVolume):
        return float(body_of_air(structure.air_volume, body.temperature).density)
    if not isinstance(material, AbstractMaterials):
        assert material is not None
        return float(material.density) * structure.volume
    density = np.asarray(material.table("density", float))
    volume = node_volumes(structure)
    return float((density[material.of_nodes(structure)] * volume).sum())
