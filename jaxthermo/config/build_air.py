"""From a validated config to terms of the air."""

from typing import assert_never

from ..physics.boundary import Convection
from ..physics.convection.free_convection import FreeConvection
from ..physics.convection.wake import WakeDeficit
from ..physics.convection.wind import Wind
from ..physics.term import AbstractTerm
from ..voxels.cylinders import Cylinder
from . import schema_air as schema
from .build_place import build_selection
from .build_varying import build_value


def build_air(config: schema.AirConfig) -> AbstractTerm:
    """A given coefficient, wind, and still air."""
    match config:
        case schema.ConvectionConfig():
            return Convection(
                build_value(config.heat_transfer_coefficient),
                build_value(config.temperature),
                on=build_selection(config.on),
            )
        case schema.WindConfig():
            return Wind(
                velocity=config.velocity,
                temperature=build_value(config.temperature),
                speed=build_value(config.speed),
                average=config.average,
                cylinders=_cylinders(config.cylinders),
                wake=_wake(config.wake),
            )
        case schema.FreeConvectionConfig():
            return FreeConvection(
                temperature=build_value(config.temperature),
                length=config.length,
                cylinders=_cylinders(config.cylinders),
            )
        case _:
            assert_never(config)


def _cylinders(configs: tuple[schema.CylinderConfig, ...]) -> tuple[Cylinder, ...]:
    return tuple(Cylinder(**dict(config)) for config in configs)


def _wake(config: schema.WakeDeficitConfig | None) -> WakeDeficit | None:
    if config is None:
        return None
    return WakeDeficit(config.amplitude, config.length, config.exponent)
