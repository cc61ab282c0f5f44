"""All terms: what heats and cools the bodies, at their surface and inside."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from .fields import Indices, PositiveLength, PositiveTime, Whole
from .kinds import by_kind
from .model import Mistake, Model
from .schema_air import ConvectionConfig, FreeConvectionConfig, WindConfig
from .schema_place import WhereConfig, WithinConfig
from .schema_radiation import (
    AreaSourceConfig,
    PointSourceConfig,
    RadiativeExchangeConfig,
    SunConfig,
    SurroundingsConfig,
)
from .schema_varying import (
    TimeConductance,
    TimeDensity,
    TimeHeatFlux,
    TimeTemperature,
)


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


class HeatSourceConfig(Model):
    """Heat released inside."""

    kind: Literal["heat_source"] = "heat_source"
    heat_rate_density: TimeDensity
    until: PositiveTime | None = None
    within: WithinConfig | None = None


class ContactConfig(Model):
    """Heat through touching surfaces; of all bodies, or of two."""

    kind: Literal["contact"] = "contact"
    conductance: TimeConductance
    bodies: Indices | None = None
    threshold: PositiveLength | None = None
    gap_length: PositiveLength | None = None
    most_pairs: Annotated[Whole, Field(ge=1)] | None = None

    def mistakes(self) -> list[Mistake]:
        """A body in contact with itself."""
        if self.bodies is None or self.bodies[0] != self.bodies[1]:
            return []
        return [(("bodies", 1), f"is body {self.bodies[1]} again: name two bodies")]


TermConfig = Annotated[
    Annotated[SunConfig, Tag("<sun>")]
    | Annotated[PointSourceConfig, Tag("<point_source>")]
    | Annotated[AreaSourceConfig, Tag("<area_source>")]
    | Annotated[SurroundingsConfig, Tag("<surroundings>")]
    | Annotated[RadiativeExchangeConfig, Tag("<radiative_exchange>")]
    | Annotated[ConvectionConfig, Tag("<convection>")]
    | Annotated[WindConfig, Tag("<wind>")]
    | Annotated[FreeConvectionConfig, Tag("<free_convection>")]
    | Annotated[HeatFluxConfig, Tag("<heat_flux>")]
    | Annotated[FixedTemperatureConfig, Tag("<fixed_temperature>")]
    | Annotated[HeatSourceConfig, Tag("<heat_source>")]
    | Annotated[ContactConfig, Tag("<contact>")],
    Discriminator(by_kind),
]
