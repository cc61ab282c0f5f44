"""From a validated config to the terms that heat and cool the bodies."""

import math
from typing import assert_never

from ..physics.boundary import FixedTemperature, HeatFlux
from ..physics.contact.links import Contact
from ..physics.heat_source import HeatSource
from ..physics.term import AbstractTerm
from . import schema_terms as schema
from .build_air import build_air
from .build_place import build_selection, build_space
from .build_radiation import build_radiation
from .build_varying import build_value
from .schema_air import AirConfig
from .schema_radiation import RadiationConfig


def build_term(config: schema.TermConfig) -> AbstractTerm:
    """What heats or cools the bodies."""
    if isinstance(config, RadiationConfig):
        return build_radiation(config)
    if isinstance(config, AirConfig):
        return build_air(config)
    match config:
        case schema.HeatFluxConfig():
            flux = build_value(config.heat_flux, config.until)
            return HeatFlux(flux, on=build_selection(config.on))
        case schema.FixedTemperatureConfig():
            temperature = build_value(config.temperature)
            return FixedTemperature(temperature, on=build_selection(config.on))
        case schema.HeatSourceConfig():
            density = build_value(config.heat_rate_density, config.until)
            return HeatSource(density, within=build_space(config.within))
        case schema.ContactConfig():
            return _contact(config)
        case _:
            assert_never(config)


def _contact(config: schema.ContactConfig) -> Contact:
    conductance = config.conductance
    return Contact(
        math.inf if conductance == "bonded" else build_value(conductance),
        bodies=config.bodies,
        threshold=config.threshold,
        gap_length=config.gap_length,
        most_pairs=config.most_pairs,
    )
