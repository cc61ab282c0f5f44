"""Terms: what heats and cools the bodies, and where on them it acts."""

from typing import Annotated, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from .fields import Direction, Position, PositiveTime, Whole
from .kinds import by_kind
from .model import Mistake, Model
from .schema_geometry import empty_box
from .schema_time import (
    TimeCoefficient,
    TimeHeatFlux,
    TimeIrradiance,
    TimeTemperature,
)


Index = Annotated[Whole, Field(ge=0)]


class SideConfig(Model):
    """The surface that faces a direction."""

    normal: Direction
    body: Index = 0


class RegionConfig(Model):
    """The surface within a box [m]."""

    lower: Position
    upper: Position
    body: Index = 0

    def mistakes(self) -> list[Mistake]:
        """A box without inside."""
        return empty_box(self.lower, self.upper)


class WhereConfig(Model):
    """The part of the surface on which a term acts."""

    side: SideConfig | None = None
    region: RegionConfig | None = None

    exactly_one: ClassVar = (("side", "region"),)


class SunConfig(Model):
    """Parallel rays that travel along `direction`."""

    kind: Literal["sun"] = "sun"
    direction: Direction
    irradiance: TimeIrradiance
    until: PositiveTime | None = None


class ConvectionConfig(Model):
    """Heat carried off by a fluid, in proportion to the temperature difference."""

    kind: Literal["convection"] = "convection"
    heat_transfer_coefficient: TimeCoefficient
    temperature: TimeTemperature
    on: WhereConfig | None = None


class SurroundingsConfig(Model):
    """Net thermal emission to surroundings of one temperature."""

    kind: Literal["surroundings"] = "surroundings"
    temperature: TimeTemperature


class HeatFluxConfig(Model):
    """A given heat flux into the surface."""

    kind: Literal["heat_flux"] = "heat_flux"
    heat_flux: TimeHeatFlux
    until: PositiveTime | None = None
    on: WhereConfig | None = None


class FixedTemperatureConfig(Model):
    """A surface held at a given temperature."""

    kind: Literal["fixed_temperature"] = "fixed_temperature"
    temperature: TimeTemperature
    on: WhereConfig | None = None


TermConfig = Annotated[
    Annotated[SunConfig, Tag("<sun>")]
    | Annotated[ConvectionConfig, Tag("<convection>")]
    | Annotated[SurroundingsConfig, Tag("<surroundings>")]
    | Annotated[HeatFluxConfig, Tag("<heat_flux>")]
    | Annotated[FixedTemperatureConfig, Tag("<fixed_temperature>")],
    Discriminator(by_kind),
]
