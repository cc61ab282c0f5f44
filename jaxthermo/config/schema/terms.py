"""Terms: what heats and cools the bodies, at their surface and inside.

A new term needs its class, exported by `jaxthermo`, and one model here.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

import jaxthermo

from ..types import quantities as si
from ..types.model import ByKind, KindModel, Mistake, Model, Short
from ..types.varying import (
    TimeConductance,
    TimeDirection,
    TimePosition,
    Varying,
    without_resistance,
)
from .selection import OnBody, WhereConfig, WithinConfig


# With fewer directions a view of the surroundings is too coarse to be of use.
Directions = Annotated[si.Whole, Field(ge=8, le=100_000)]


class _Switched(Model):
    """A term with a value that is switched off at the time `until`."""

    switched: ClassVar[tuple[str, ...]]
    """Keys of the values that become 0."""

    def arguments(self) -> dict[str, Any]:
        arguments = super().arguments()
        end = arguments.pop("until", None)
        if end is None:
            return arguments
        # A save interval ends there, so that no step averages over the jump.
        for key in self.switched:
            if key in arguments:
                arguments[key] = jaxthermo.Until(arguments[key], end)
        return arguments


class _SunConfig(_Switched, builds="Sun", kind="sun"):
    """Parallel rays that travel along `direction`."""

    direction: TimeDirection
    irradiance: Varying[si.Irradiance]
    until: si.PositiveTime | None = None
    on: WhereConfig | None = None

    switched: ClassVar = ("irradiance",)


class _PointSourceConfig(_Switched, builds="PointSource", kind="point_source"):
    """A small source nearby."""

    position: TimePosition
    radiant_intensity: Varying[si.RadiantIntensity]
    min_distance: si.PositiveLength = 0.01
    until: si.PositiveTime | None = None
    on: WhereConfig | None = None

    switched: ClassVar = ("radiant_intensity",)


class _AreaSourceConfig(_Switched, builds="AreaSource", kind="area_source"):
    """A rectangle that radiates from its front, by its radiance or its temperature."""

    centre: TimePosition
    normal: si.Direction
    size: si.Extent
    up: si.Direction = (0.0, 0.0, 1.0)
    radiance: Varying[si.Radiance] | None = None
    temperature: Varying[si.Temperature] | None = None
    emissivity: si.Fraction | None = None
    patches: Annotated[si.Whole, Field(ge=1, le=64)] = 4
    until: si.PositiveTime | None = None
    on: WhereConfig | None = None

    exactly_one: ClassVar = (("radiance", "temperature"),)
    switched: ClassVar = ("radiance", "temperature")

    @classmethod
    def raw_mistakes(cls, data: Mapping[str, object]) -> list[Mistake]:
        if data.get("radiance") is None or data.get("emissivity") is None:
            return []
        return [(("emissivity",), "goes with `temperature`; a radiance stands alone")]


class _SurroundingsConfig(Model, builds="Surroundings", kind="surroundings"):
    """Net thermal emission to surroundings, or to a sky and a ground."""

    temperature: Varying[si.Temperature]
    ground: Varying[si.Temperature] | None = None
    occlusion: Directions | None = None
    linear_within: Annotated[si.Number, Field(gt=0, lt=1)] | None = None
    on: WhereConfig | None = None


class _DiffuseSkyConfig(Model, builds="DiffuseSky", kind="diffuse_sky"):
    """Diffuse daylight from the sky, and what the ground reflects."""

    irradiance: Varying[si.Irradiance]
    reflected: Varying[si.Irradiance] = 0.0
    occlusion: Directions | None = None
    on: WhereConfig | None = None


class _RadiativeExchangeConfig(
    Model, builds="RadiativeExchange", kind="radiative_exchange"
):
    """Net thermal emission of bodies to each other and to the surroundings."""

    temperature: Varying[si.Temperature]
    ground: Varying[si.Temperature] | None = None
    max_patches: Annotated[si.Whole, Field(ge=6, le=100_000)] = 128
    directions: Directions | None = None
    error: Annotated[si.Number, Field(gt=0, lt=1)] = 0.01
    max_directions: Annotated[si.Whole, Field(ge=128, le=100_000)] = 4096
    on: WhereConfig | None = None


class _ConvectionConfig(Model, builds="Convection", kind="convection"):
    """Convection with a given heat transfer coefficient."""

    heat_transfer_coefficient: Varying[si.HeatTransferCoefficient]
    temperature: Varying[si.Temperature]
    on: WhereConfig | None = None


class _CylinderConfig(OnBody, builds="Cylinder"):
    """A cylinder that stands for a part of a body, in the body's own frame."""

    axis_point: si.Position
    axis: si.Direction
    diameter: si.PositiveLength
    length: si.PositiveLength | None = None


class _FittedWakeConfig(KindModel, builds="FittedWake", kind="fitted"):
    """Slower wind behind other objects, by their Reynolds numbers."""


class _WakeDeficitConfig(KindModel, builds="WakeDeficit", kind="deficit"):
    """Slower wind behind other objects, by the distance alone."""

    amplitude: Annotated[si.Number, Field(gt=0, lt=1.3)] = 1.027
    length: Annotated[si.Number, Field(gt=0)] = 2.227
    exponent: Annotated[si.Number, Field(ge=0.4, le=1.1)] = 0.497


_WakeConfig = Annotated[
    _WakeDeficitConfig | _FittedWakeConfig, ByKind(), Short("kind", "deficit")
]


# Shape of all bodies; without it, that of each one's proportions.
_BodyShape = Literal["plate", "cylinder", "sphere"]


class _WindConfig(Model, builds="Wind", kind="wind"):
    """Wind of one direction; bodies are plates, spheres or cylinders."""

    velocity: si.Velocity
    temperature: Varying[si.Temperature]
    speed: Varying[si.Speed] | None = None
    average: Literal["churchill_bernstein", "sanitjai_goldstein", "profile"] = (
        "churchill_bernstein"
    )
    cylinders: tuple[_CylinderConfig, ...] = ()
    wake: _WakeConfig | None = None
    on: WhereConfig | None = None
    body_shape: _BodyShape | None = None

    def mistakes(self) -> list[Mistake]:
        # The velocity of a wind of varying speed gives its direction.
        if self.speed is None or any(self.velocity):
            return []
        return [(("velocity",), "must not be [0, 0, 0]: it has to point somewhere")]


class _LinearWindConfig(Model, builds="LinearWind", kind="linear_wind"):
    """Wind over flat surfaces, with a coefficient that is linear in its speed."""

    speed: Varying[si.Speed]
    temperature: Varying[si.Temperature]
    calm: si.HeatTransferCoefficient = 2.8
    by_speed: si.CoefficientBySpeed = 3.0
    on: WhereConfig | None = None


class _FreeConvectionConfig(Model, builds="FreeConvection", kind="free_convection"):
    """Natural convection in still air."""

    temperature: Varying[si.Temperature]
    length: si.PositiveLength | None = None
    cylinders: tuple[_CylinderConfig, ...] = ()
    on: WhereConfig | None = None
    body_shape: _BodyShape | None = None


class _HeatFluxConfig(_Switched, builds="HeatFlux", kind="heat_flux"):
    """A given heat flux into the surface, or its heat rate in all."""

    heat_flux: Varying[si.HeatFlux] | None = None
    heat_rate: Varying[si.HeatRate] | None = None
    until: si.PositiveTime | None = None
    on: WhereConfig | None = None

    exactly_one: ClassVar = (("heat_flux", "heat_rate"),)
    switched: ClassVar = ("heat_flux", "heat_rate")


class _FixedTemperatureConfig(
    Model, builds="FixedTemperature", kind="fixed_temperature"
):
    """A surface of prescribed temperature."""

    temperature: Varying[si.Temperature]
    on: WhereConfig | None = None


class _HeatSourceConfig(_Switched, builds="HeatSource", kind="heat_source"):
    """Heat released inside, by its density or its heat rate in all."""

    heat_rate_density: Varying[si.HeatRateDensity] | None = None
    heat_rate: Varying[si.HeatRate] | None = None
    until: si.PositiveTime | None = None
    within: WithinConfig | None = None

    exactly_one: ClassVar = (("heat_rate_density", "heat_rate"),)
    switched: ClassVar = ("heat_rate_density", "heat_rate")


class _JointConfig(Model):
    """Conductance between bodies that touch."""

    conductance: TimeConductance
    bodies: si.Indices | None = None
    threshold: si.PositiveLength | None = None
    max_pairs: Annotated[si.Whole, Field(ge=1)] | None = None

    def arguments(self) -> dict[str, Any]:
        # The half cells on both sides of a bond limit the heat.
        conductance = without_resistance(self.conductance)
        return {**super().arguments(), "conductance": conductance}

    def mistakes(self) -> list[Mistake]:
        if self.bodies is None or self.bodies[0] != self.bodies[1]:
            return []
        return [(("bodies", 1), f"is body {self.bodies[1]} again: name two bodies")]


class _ContactConfig(_JointConfig, builds="Contact", kind="contact"):
    """Heat conduction between touching surfaces, of all bodies or of two."""

    gap_length: si.PositiveLength | None = None


class _SeamConfig(_JointConfig, builds="Seam", kind="seam"):
    """Heat conduction where the borders of sheets meet other bodies."""


TermConfig = Annotated[
    _SunConfig
    | _PointSourceConfig
    | _AreaSourceConfig
    | _SurroundingsConfig
    | _DiffuseSkyConfig
    | _RadiativeExchangeConfig
    | _ConvectionConfig
    | _WindConfig
    | _LinearWindConfig
    | _FreeConvectionConfig
    | _HeatFluxConfig
    | _FixedTemperatureConfig
    | _HeatSourceConfig
    | _ContactConfig
    | _SeamConfig,
    ByKind(),
]
