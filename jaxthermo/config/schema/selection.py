"""Selections: a side, a box, a whole body, fragments of a file, combinations."""

import math
import operator
from functools import reduce
from typing import Annotated, Any, ClassVar

from pydantic import Field

import jaxthermo

from ..types.files import FoundPath, read_mask
from ..types.model import Mistake, Model, build
from ..types.quantities import Angle, Direction, Index, NotEmpty, Position


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
    """One of several ways to select a part of a body, or a combination of them."""

    region: _RegionConfig | None = None
    body: Index | None = None

    # A key with the name of an operator of the language cannot be declared by a field.
    def __init_subclass__(cls, **options: Any) -> None:
        several: Any = Annotated[tuple[cls, ...], NotEmpty]
        combined = {"all": several | None, "any": several | None, "not": cls | None}
        cls.__annotations__ = {**cls.__annotations__, **combined}
        for key in combined:
            setattr(cls, key, None)
        super().__init_subclass__(**options)

    @property
    def _given(self) -> tuple[str, Any]:
        # The first key with a value: mistakes are looked for even where there is none.
        return next(((k, v) for k, v in self if v is not None), ("body", 0))

    def build(self, *args: Any) -> Any:
        key, given = self._given
        match key:
            case "all":
                return reduce(operator.and_, build(given))
            case "any":
                return reduce(operator.or_, build(given))
            case "not":
                return ~given.build()
            case "body":
                return jaxthermo.Everything(body=given)
            case _:
                return given.build()

    @property
    def bodies(self) -> set[int]:
        """Numbers of the bodies that it is on."""
        key, given = self._given
        match key:
            case "all":
                return set.intersection(*(part.bodies for part in given))
            case "any":
                return set.union(*(part.bodies for part in given))
            case "not":
                return given.bodies
            case "body":
                return {given}
            case _:
                return {given.body}

    def mistakes(self) -> list[Mistake]:
        if self.bodies:
            return []
        return [(("all",), "its parts are on different bodies: no surface is on all")]


class WhereConfig(_Selection):
    """The part of the surface on which a term acts."""

    side: _SideConfig | None = None
    fragments: _FragmentsConfig | None = None

    exactly_one: ClassVar = (
        ("side", "region", "fragments", "body", "all", "any", "not"),
    )


class WithinConfig(_Selection):
    """The part of the inside on which a term acts."""

    exactly_one: ClassVar = (("region", "body", "all", "any", "not"),)


def empty_box(
    lower: tuple[float, float, float], upper: tuple[float, float, float]
) -> list[Mistake]:
    """The axes along which the upper corner of a box is not above the lower one."""
    return [
        (("upper", i), f"{b:g} m is not above the lower corner's {a:g} m")
        for i, (a, b) in enumerate(zip(lower, upper, strict=True))
        if not b > a
    ]
