"""From a validated config to what bodies are made of."""

from ..material.material import Material
from ..material.table import materials
from ..scene.scene import AbstractMaterials, MaterialLabels, MaterialMap
from ..voxels.selection import Region
from .array_files import read_labels
from .build_varying import build_property
from .schema_geometry import BodyConfig
from .schema_material import LabelledConfig, MaterialConfig


def build_materials(config: BodyConfig) -> Material | AbstractMaterials:
    """One material, one with others painted over it, or one for each label."""
    if isinstance(config.material, LabelledConfig):
        given = tuple(build_material(each) for each in config.material.materials)
        return MaterialLabels(read_labels(config.material.labels), given)
    base = build_material(config.material)
    painted = tuple(
        (Region(lower=paint.lower, upper=paint.upper), build_material(paint.material))
        for paint in config.regions
    )
    return MaterialMap(base, painted) if painted else base


def build_material(config: MaterialConfig) -> Material:
    """The named material, with the properties that the config states in its place."""
    stated = {
        key: build_property(value)
        for key, value in config
        if key != "name" and value is not None
    }
    if config.name is None:
        return Material(**stated)
    named = materials[config.name]
    table = {
        "conductivity": named.conductivity,
        "density": named.density,
        "specific_heat": named.specific_heat,
        "emissivity": named.emissivity,
        "absorptivity": named.own_absorptivity,
    }
    return Material(**{**table, **stated})
