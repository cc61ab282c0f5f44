"""Selections: a side, a face, a box, a body, fragments of a file, combinations."""

import math
import operator
from functools import reduce
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

import jaxthermo

from ..types.files import FoundPath, read_mask
from ..types.model import Mistake, Model, Short, build
from ..types.quantities import Angle, Direction, Index, NotEmpty, Position


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


Patterns = Annotated[
    tuple[Annotated[str, Field(min_length=1)], ...],
    NotEmpty,
    BeforeValidator(_listed, json_schema_input_type=str | list[str]),
]
"""A pattern of names of parts or bodies, or a list of such patterns."""


class OnBody(Model):
    """A body, by its number or its name."""

    body: Index = 0
    part: Patterns | None = None
    """Pattern of names of bodies, or a list of them, instead of a number."""

    def mistakes(self) -> list[Mistake]:
        """A name where no scene has replaced it by a number."""
        return _misplaced(self.part)


def _misplaced(part: Any) -> list[Mistake]:
    # The scene has replaced those of terms by numbers.
    message = "only the terms of a scene select bodies by name: leave it out"
    return [] if part is None else [(("part",), message)]


class SideConfig(OnBody, builds="Side"):
    """The surface that faces a direction; in a term without a body, of all bodies."""

    normal: Direction
    half_angle: Annotated[Angle, Field(gt=0, le=math.pi)] = math.pi / 4


class _FaceConfig(OnBody, builds="Face"):
    """One of the two faces of a sheet."""

    name: Literal["front", "back"]
    """The front is on the side of the normals."""


_AnyFace = Annotated[_FaceConfig, Short("name", words=("front", "back"))]


class _RegionConfig(OnBody, builds="Region"):
    """Everything within a box in the body's own frame [m]."""

    lower: Position
    upper: Position

    def mistakes(self) -> list[Mistake]:
        return [*super().mistakes(), *empty_box(self.lower, self.upper)]


class _FragmentsConfig(OnBody, builds="FragmentMask"):
    """Surface fragments by a file with a truth value for each."""

    mask: FoundPath

    def build(self, *args: Any) -> Any:
        return self.target()(mask=read_mask(self.mask), body=self.body)


class _Selection(Model):
    """One of several ways to select a part of a body, or a combination of them."""

    region: _RegionConfig | None = None
    body: Index | None = None
    part: Patterns | None = None
    """Pattern of names of bodies, or a list of them, instead of a number."""

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
        if self.part is not None or self.bodies:
            return _misplaced(self.part)
        return [(("all",), "its parts are on different bodies: no surface is on all")]


class WhereConfig(_Selection):
    """The part of the surface on which a term acts."""

    side: SideConfig | None = None
    face: _AnyFace | None = None
    fragments: _FragmentsConfig | None = None

    exactly_one: ClassVar = (
        ("side", "face", "region", "fragments", "body", "part", "all", "any", "not"),
    )


class WithinConfig(_Selection):
    """The part of the inside on which a term acts."""

    exactly_one: ClassVar = (("region", "body", "part", "all", "any", "not"),)


def empty_box(
    lower: tuple[float, float, float], upper: tuple[float, float, float]
) -> list[Mistake]:
    """The axes along which the upper corner of a box is not above the lower one."""
    return [
        (("upper", i), f"{b:g} m is not above the lower corner's {a:g} m")
        for i, (a, b) in enumerate(zip(lower, upper, strict=True))
        if not b > a
    ]
