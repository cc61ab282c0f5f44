"""Terms of the air: a given coefficient, wind, and still air."""

from typing import Annotated, Literal

from pydantic import Field

from .fields import Direction, Index, Number, Position, PositiveLength, Velocity
from .kinds import KindModel, short_kind
from .model import Mistake, Model
from .schema_place import WhereConfig
from .schema_varying import TimeCoefficient, TimeSpeed, TimeTemperature


class ConvectionConfig(Model):
    """Heat carried off by a fluid, in proportion to the temperature difference."""

    kind: Literal["convection"] = "convection"
    heat_transfer_coefficient: TimeCoefficient
    temperature: TimeTemperature
    on: WhereConfig | None = None


class CylinderConfig(Model):
    """A cylinder that stands for a part of a body, in the body's own frame."""

    axis_point: Position
    axis: Direction
    diameter: PositiveLength
    length: PositiveLength | None = None
    body: Index = 0


class WakeDeficitConfig(KindModel):
    """Slower wind behind other objects."""

    kind: Literal["deficit"] = "deficit"
    amplitude: Annotated[Number, Field(gt=0, lt=1.3)] = 1.027
    length: Annotated[Number, Field(gt=0)] = 2.227
    exponent: Annotated[Number, Field(ge=0.4, le=1.1)] = 0.497


WakeConfig = Annotated[WakeDeficitConfig, short_kind("deficit")]


class WindConfig(Model):
    """Wind of one direction, the bodies taken as cylinders."""

    kind: Literal["wind"] = "wind"
    velocity: Velocity
    temperature: TimeTemperature
    speed: TimeSpeed | None = None
    average: Literal["churchill_bernstein", "sanitjai_goldstein", "profile"] = (
        "churchill_bernstein"
    )
    cylinders: tuple[CylinderConfig, ...] = ()
    wake: WakeConfig | None = None

    def mistakes(self) -> list[Mistake]:
        """A speed without a direction."""
        if self.speed is None or any(self.velocity):
            return []
        return [(("velocity",), "must not be [0, 0, 0]: it has to point somewhere")]


class FreeConvectionConfig(Model):
    """Still air, set in motion by the bodies' warmth."""

    kind: Literal["free_convection"] = "free_convection"
    temperature: TimeTemperature
    length: PositiveLength | None = None
    cylinders: tuple[CylinderConfig, ...] = ()


AirConfig = ConvectionConfig | WindConfig | FreeConvectionConfig
