"""Terms of radiation: sources that shine, surroundings, bodies among each other."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from .fields import (
    Direction,
    Extent,
    Fraction,
    Number,
    PositiveLength,
    PositiveTime,
    Whole,
)
from .model import Mistake, Model
from .schema_varying import (
    TimeDirection,
    TimeIntensity,
    TimeIrradiance,
    TimePosition,
    TimeRadiance,
    TimeTemperature,
)


Directions = Annotated[Whole, Field(ge=8, le=100_000)]
"""In which a scene is looked at; fewer make no picture of it."""


class SunConfig(Model):
    """Parallel rays that travel along `direction`."""

    kind: Literal["sun"] = "sun"
    direction: TimeDirection
    irradiance: TimeIrradiance
    until: PositiveTime | None = None


class PointSourceConfig(Model):
    """A small source near by."""

    kind: Literal["point_source"] = "point_source"
    position: TimePosition
    radiant_intensity: TimeIntensity
    least_distance: PositiveLength = 0.01
    until: PositiveTime | None = None


class AreaSourceConfig(Model):
    """A rectangle that radiates from its front, by its radiance or its temperature."""

    kind: Literal["area_source"] = "area_source"
    centre: TimePosition
    normal: Direction
    size: Extent
    up: Direction = (0.0, 0.0, 1.0)
    radiance: TimeRadiance | None = None
    temperature: TimeTemperature | None = None
    emissivity: Fraction | None = None
    patches: Annotated[Whole, Field(ge=1, le=64)] = 4
    until: PositiveTime | None = None

    exactly_one: ClassVar = (("radiance", "temperature"),)

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> list[Mistake]:
        """An emissivity of something whose radiance is given."""
        if data.get("radiance") is None or data.get("emissivity") is None:
            return []
        return [(("emissivity",), "goes with `temperature`; a radiance stands alone")]


class SurroundingsConfig(Model):
    """Net thermal emission to surroundings, or to a sky and a ground."""

    kind: Literal["surroundings"] = "surroundings"
    temperature: TimeTemperature
    ground: TimeTemperature | None = None
    occlusion: Directions | None = None
    linear_within: Annotated[Number, Field(gt=0, lt=1)] | None = None


class RadiativeExchangeConfig(Model):
    """Net thermal emission of bodies to what they see of each other and around."""

    kind: Literal["radiative_exchange"] = "radiative_exchange"
    temperature: TimeTemperature
    most_patches: Annotated[Whole, Field(ge=6, le=4096)] = 128
    directions: Directions = 128


RadiationConfig = (
    SunConfig
    | PointSourceConfig
    | AreaSourceConfig
    | SurroundingsConfig
    | RadiativeExchangeConfig
)
