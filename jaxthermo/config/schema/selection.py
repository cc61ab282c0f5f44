"""Selections: a side, a box, a whole body, or fragments that a file marks."""

import math
from typing import Annotated, Any, ClassVar

from pydantic import Field

import jaxthermo

from ..types.files import FoundPath, read_mask
from ..types.model import Mistake, Model
from ..types.quantities import Angle, Direction, Index, Position


class _SideConfig(Model, builds="Side"):
    """The surface that faces a direction."""

    normal: Direction
    half_angle: Annotated[Angle, Field(gt=0, le=math.pi)] = math.pi / 4
    body: Index = 0


class _RegionConfig(Model, builds="Region"):
    """Everything within a box in the body's own frame [m]."""

    lower: Position
    upper: Position
    body: Index = 0

    def mistakes(self) -> list[Mistake]:
        return empty_box(self.lower, self.upper)


class _FragmentsConfig(Model, builds="FragmentMask"):
    """Surface fragments by a file with a truth value for each."""

    mask: FoundPath
    body: Index = 0

    def arguments(self) -> dict[str, Any]:
        return {"mask": read_mask(self.mask), "body": self.body}


class _Selection(Model):
    """One of several ways to select a part of a body."""

    region: _RegionConfig | None = None
    body: Index | None = None

    def build(self, *args: Any) -> Any:
        # Only `body` can be 0, and only alone: everything of that body.
        given = (value for name, value in self if name != "body" and value is not None)
        part = next(given, None)
        return part.build() if part else jaxthermo.Everything(body=self.body or 0)


class WhereConfig(_Selection):
    """The part of the surface on which a term acts."""

    side: _SideConfig | None = None
    fragments: _FragmentsConfig | None = None

    exactly_one: ClassVar = (("side", "region", "fragments", "body"),)


class WithinConfig(_Selection):
    """The part of the inside on which a term acts."""

    exactly_one: ClassVar = (("region", "body"),)


def empty_box(
    lower: tuple[float, float, float], upper: tuple[float, float, float]
) -> list[Mistake]:
    """The axes along which the upper corner of a box is not above the lower one."""
    return [
        (("upper", i), f"{b:g} m is not above the lower corner's {a:g} m")
        for i, (a, b) in enumerate(zip(lower, upper, strict=True))
        if not b > a
    ]
