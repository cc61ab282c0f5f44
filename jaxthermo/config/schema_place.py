"""Where a term acts: a side, a box, a whole body, or fragments that a file marks."""

import math
from typing import Annotated, ClassVar

from pydantic import Field

from .fields import Angle, Direction, Index, Position
from .found import FoundPath
from .model import Mistake, Model


class SideConfig(Model):
    """The surface that faces a direction."""

    normal: Direction
    half_angle: Annotated[Angle, Field(gt=0, le=math.pi)] = math.pi / 4
    body: Index = 0


class RegionConfig(Model):
    """What lies within a box [m]."""

    lower: Position
    upper: Position
    body: Index = 0

    def mistakes(self) -> list[Mistake]:
        """A box without inside."""
        return empty_box(self.lower, self.upper)


class FragmentsConfig(Model):
    """Surface fragments by a file of one truth value each."""

    mask: FoundPath
    body: Index = 0


class WhereConfig(Model):
    """The part of the surface on which a term acts."""

    side: SideConfig | None = None
    region: RegionConfig | None = None
    fragments: FragmentsConfig | None = None
    body: Index | None = None

    exactly_one: ClassVar = (("side", "region", "fragments", "body"),)


class WithinConfig(Model):
    """The part of the inside on which a term acts."""

    region: RegionConfig | None = None
    body: Index | None = None

    exactly_one: ClassVar = (("region", "body"),)


def empty_box(
    lower: tuple[float, float, float], upper: tuple[float, float, float]
) -> list[Mistake]:
    """The axes along which a box ends before it begins."""
    return [
        (("upper", i), f"{b:g} m is not above the lower corner's {a:g} m")
        for i, (a, b) in enumerate(zip(lower, upper, strict=True))
        if not b > a
    ]
