"""Values that vary: a number, or a table of it by time or by temperature."""

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Literal, TypeVar

from pydantic import Discriminator, Tag

from . import quantities as si
from .files import FoundPath, read_fractions
from .model import Mistake, Model, build, parts


_Value = TypeVar("_Value")


class _Tabulated(Model, Generic[_Value]):
    """Values at increasing arguments."""

    argument: ClassVar[tuple[str, str]]
    """Key of the arguments, and their unit."""

    @classmethod
    def model_parametrized_name(cls, params: tuple[Any, ...]) -> str:
        # For JSON Schemas: pydantic's own name spells out the whole type.
        nouns = [
            marker.noun for marker in parts(params[0]) if isinstance(marker, si.Unit)
        ]
        words = nouns[0].partition(" (")[0].split()[1:] if nouns else []
        return f"{cls.__name__.lstrip('_')}Of{''.join(map(str.capitalize, words))}"

    def mistakes(self) -> list[Mistake]:
        key, unit = self.argument
        arguments, values = (getattr(self, name) for name in (key, "values"))
        return [
            *not_increasing(arguments, key=key, unit=unit),
            *unequal(values, key="values", arguments=arguments, argument_key=key),
        ]


class _Table(_Tabulated[_Value], Generic[_Value], builds="Table"):
    """A piecewise linear function of time [s]."""

    times: Annotated[tuple[si.Time, ...], si.NotEmpty]
    values: tuple[_Value, ...]

    argument: ClassVar = ("times", "s")

    def build(self, *args: Any) -> Any:
        # By position: the classes of points and directions call the values so.
        return self.target()(self.times, self.values)


class _PositionTable(_Table[si.Position], builds="PointTable"):
    """A position that moves in time."""


class _DirectionTable(_Table[si.Direction], builds="DirectionTable"):
    """A direction that turns in time."""

    def mistakes(self) -> list[Mistake]:
        # Between opposite directions there is no unique way to turn.
        mistakes = super().mistakes()
        unit_vectors = [_unit_vector(direction) for direction in self.values]
        for i, (a, b) in enumerate(pairwise(unit_vectors), 1):
            if math.dist(a, [-x for x in b]) < 1e-6:
                message = "is opposite to the one before: give one between them"
                mistakes.append((("values", i), message))
        return mistakes


def _unit_vector(direction: tuple[float, float, float]) -> list[float]:
    length = math.hypot(*direction)
    return [x / length for x in direction]


class _PropertyTable(_Tabulated[_Value], Generic[_Value], builds="Property"):
    """A piecewise linear function of temperature [K]."""

    temperatures: Annotated[tuple[si.Temperature, ...], si.NotEmpty]
    values: tuple[_Value, ...]

    argument: ClassVar = ("temperatures", "K")


def not_increasing(values: tuple[float, ...], key: str, unit: str) -> list[Mistake]:
    """A mistake for each value that is not above its predecessor."""
    return [
        ((key, i), f"{b:g} {unit} is not after {a:g} {unit}: give them in order")
        for i, (a, b) in enumerate(pairwise(values), 1)
        if b <= a
    ]


def unequal(
    values: tuple, key: str, arguments: tuple, argument_key: str
) -> list[Mistake]:
    """A mistake if two lists that belong together differ in length."""
    if len(values) == len(arguments):
        return []
    return [
        ((key,), f"there are {len(values)} {key} for {len(arguments)} {argument_key}")
    ]


class _PerFragment(Model):
    """A fraction for each surface fragment, from a file."""

    fragments: FoundPath

    def build(self, *args: Any) -> Any:
        return read_fractions(self.fragments)


# Pydantic tries all members of a plain union and reports the mistakes of each: these
# functions select the one that is meant, by its form.
def _form(value: Any) -> str:
    return "<table>" if isinstance(value, dict | Model) else "<fixed>"


def _or_bonded(value: Any) -> str:
    return "<bonded>" if value == "bonded" else _form(value)


def _or_three(value: Any) -> str:
    return "<three>" if isinstance(value, list | tuple) else _form(value)


_FIXED = Tag("<fixed>")
_TABLE = Tag("<table>")
_EITHER = Discriminator(_form)

if TYPE_CHECKING:
    Varying = _Value | _Table[_Value]
else:

    class Varying:
        """`Varying[Temperature]` is a temperature, or a table of it by time."""

        def __class_getitem__(cls, value: Any) -> Any:
            """The union; typing cannot substitute into the generic model by itself."""
            table = Annotated[_Table[value], _TABLE]
            return Annotated[Annotated[value, _FIXED] | table, _EITHER]


TimePosition = Annotated[
    Annotated[si.Position, _FIXED] | Annotated[_PositionTable, _TABLE], _EITHER
]
TimeDirection = Annotated[
    Annotated[si.Direction, _FIXED] | Annotated[_DirectionTable, _TABLE], _EITHER
]
TimeConductance = Annotated[
    Annotated[si.ContactConductance, _FIXED]
    | Annotated[Literal["bonded"], Tag("<bonded>")]
    | Annotated[_Table[si.ContactConductance], _TABLE],
    Discriminator(_or_bonded),
]


def without_resistance(conductance: Any) -> Any:
    """The built value of a `TimeConductance`: infinite where it is `bonded`."""
    return math.inf if conductance == "bonded" else build(conductance)


AnyFraction = Annotated[
    Annotated[si.Fraction, _FIXED] | Annotated[_PerFragment, _TABLE], _EITHER
]
_AlongAxis = Annotated[
    Annotated[si.Conductivity, _FIXED]
    | Annotated[_PropertyTable[si.Conductivity], _TABLE],
    _EITHER,
]
AnyConductivity = Annotated[
    Annotated[si.Conductivity, _FIXED]
    | Annotated[tuple[_AlongAxis, _AlongAxis, _AlongAxis], si.Three, Tag("<three>")]
    | Annotated[_PropertyTable[si.Conductivity], _TABLE],
    Discriminator(_or_three),
]
AnySpecificHeat = Annotated[
    Annotated[si.SpecificHeat, _FIXED]
    | Annotated[_PropertyTable[si.SpecificHeat], _TABLE],
    _EITHER,
]
