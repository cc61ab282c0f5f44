"""Selections: a side, a face, a box, a body, fragments of a file, combinations."""

import math
import operator
from functools import reduce
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

import jaxthermo

from ..types.files import FoundPath, read_mask
from ..types.model import Mistake, Model, Short, build
from ..types.quantities import Angle, Direction, Index, NotEmpty, Position


class _SideConfig(Model, builds="Side"):
    """The surface that faces a direction."""

    normal: Direction
    half_angle: Annotated[Angle, Field(gt=0, le=math.pi)] = math.pi / 4
    body: Index = 0


class _FaceConfig(Model, builds="Face"):
    """One of the two faces of a sheet."""

    name: Literal["front", "back"]
    """The front is on the side of the normals."""
    body: Index = 0


_AnyFace = Annotated[_FaceConfig, Short("name", words=("front", "back"))]


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

    def build(self, *args: Any) -> Any:
        return self.target()(mask=read_mask(self.mask), body=self.body)


class _Selection(Model):
    """One of several ways to select a part of a body, or a combination of them."""

    region: _RegionConfig | None = None
    body: Index | None = None

    # A key that is a keyword of Python cannot be declared as a field.
    def __init_subclass__(cls, **options: Any) -> None:
        several: Any = Annotated[tuple[cls, ...], NotEmpty]
        combined = {"all": several | None, "any": several | None, "not": cls | None}
        cls.__annotations__ = {**cls.__annotations__, **combined}
        for key in combined:
            setattr(cls, key, None)
        super().__init_subclass__(**options)

    @property
    def _selected(self) -> tuple[str, Any]:
        # The first key with a value; ("body", 0) for a selection that has none.
        for key, value in self:
            if value is not None:
                return key, value
        return "body", 0

    def build(self, *args: Any) -> Any:
        key, value = self._selected
        match key:
            case "all":
                return reduce(operator.and_, build(value))
            case "any":
                return reduce(operator.or_, build(value))
            case "not":
                return ~value.build()
            case "body":
                return jaxthermo.Everything(body=value)
            case _:
                return value.build()

    @property
    def bodies(self) -> set[int]:
        """Numbers of the bodies that the selection is on."""
        key, value = self._selected
        match key:
            case "all":
                return set.intersection(*(selection.bodies for selection in value))
            case "any":
                return set.union(*(selection.bodies for selection in value))
            case "not":
                return value.bodies
            case "body":
                return {value}
            case _:
                return {value.body}

    def mistakes(self) -> list[Mistake]:
        if self.bodies:
            return []
        return [(("all",), "its parts are on different bodies: no surface is on all")]


class WhereConfig(_Selection):
    """The part of the surface on which a term acts."""

    side: _SideConfig | None = None
    face: _AnyFace | None = None
    fragments: _FragmentsConfig | None = None

    exactly_one: ClassVar = (
        ("side", "face", "region", "fragments", "body", "all", "any", "not"),
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
