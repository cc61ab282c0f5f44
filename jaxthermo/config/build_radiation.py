"""From a validated config to terms of radiation."""

from typing import assert_never

from ..physics.radiation.area_source import AreaSource
from ..physics.radiation.emission import Surroundings
from ..physics.radiation.radiative_exchange import RadiativeExchange
from ..physics.radiation.source import PointSource, Sun
from ..physics.term import AbstractTerm
from . import schema_radiation as schema
from .build_varying import build_direction, build_position, build_value


def build_radiation(config: schema.RadiationConfig) -> AbstractTerm:
    """Sources, surroundings, and bodies among each other."""
    match config:
        case schema.SunConfig():
            return Sun(
                direction=build_direction(config.direction),
                irradiance=build_value(config.irradiance, config.until),
            )
        case schema.PointSourceConfig():
            return PointSource(
                position=build_position(config.position),
                radiant_intensity=build_value(config.radiant_intensity, config.until),
                least_distance=config.least_distance,
            )
        case schema.AreaSourceConfig():
            return _area_source(config)
        case schema.SurroundingsConfig():
            return Surroundings(
                temperature=build_value(config.temperature),
                ground=build_value(config.ground),
                occlusion=config.occlusion,
                linear_within=config.linear_within,
            )
        case schema.RadiativeExchangeConfig():
            return RadiativeExchange(
                temperature=build_value(config.temperature),
                most_patches=config.most_patches,
                directions=config.directions,
            )
        case _:
            assert_never(config)


def _area_source(config: schema.AreaSourceConfig) -> AreaSource:
    shape = {
        "centre": build_position(config.centre),
        "normal": config.normal,
        "size": config.size,
        "up": config.up,
        "patches": config.patches,
    }
    if config.radiance is not None:
        return AreaSource(radiance=build_value(config.radiance, config.until), **shape)
    emissivity = 1.0 if config.emissivity is None else config.emissivity
    temperature = build_value(config.temperature, config.until)
    return AreaSource(temperature=temperature, emissivity=emissivity, **shape)
