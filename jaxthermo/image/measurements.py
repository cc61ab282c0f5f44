"""Measurements on frames, named as in thermography: spot, line, box and isotherm.

A coordinate is a fraction of the width or height, 0 at the left or top and 1 at the
right or bottom, as 0.25 or "25 %", or the number of a pixel from 0, as "320 px".

Without jax, so that a config can check measurements before jax is loaded.
"""

import abc
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from skimage.draw import line
from typing_extensions import override

from ..errors import InputError, located
from ..temperatures import check_numbers_of_kelvin


_Coordinate: TypeAlias = float | int | str
Point: TypeAlias = tuple[_Coordinate, _Coordinate]
"""Across from the left, and down from the top."""

_NUMBER = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(%|px|)\s*")


def checked_coordinate(value: Any) -> float | str:
    """A fraction in [0, 1], or the text "320 px".

    Raises:
        InputError: for anything else.
    """
    number = math.nan
    unit = ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
    elif isinstance(value, str) and (match := _NUMBER.fullmatch(value)):
        number = float(match[1])
        unit = match[2]
    if unit == "px" and number == int(number):
        return f"{int(number)} px"
    number = number / 100 if unit == "%" else number
    if unit != "px" and 0.0 <= number <= 1.0:
        return number
    raise InputError(
        f"{value!r} is no coordinate: give a fraction of the image, 0 to 1 or '25 %', "
        "or the whole number of a pixel, '320 px'"
    )


def pixel_index(value: _Coordinate, size: int, along: str) -> int:
    """Index of the pixel at a coordinate, of `size` pixels along an axis.

    Raises:
        InputError: for a coordinate that is outside of the image, or none.
    """
    coordinate = checked_coordinate(value)
    if not isinstance(coordinate, str):
        return min(int(coordinate * size), size - 1)
    index = int(coordinate.removesuffix(" px"))
    if index >= size:
        raise InputError(
            f"'{coordinate}' is outside of the image, whose {along} are 0 to {size - 1}"
        )
    return index


def _pixel_of(point: Point, height: int, width: int) -> tuple[int, int]:
    """Row and column of the pixel at a point of an image of `height` x `width`.

    Raises:
        InputError: for a point that is outside of the image, or none.
    """
    try:
        across, down = point
    except (TypeError, ValueError):
        raise InputError(f"{point!r} is no point: give (across, down)") from None
    column = pixel_index(across, width, "columns")
    return pixel_index(down, height, "rows"), column


Pixels: TypeAlias = tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]
"""Rows and columns."""


class AbstractMeasurement(abc.ABC):
    """Pixels of a frame whose temperatures are read."""

    name: str
    """Name at the mark and in files; a short word and a number if it is empty."""
    prefix: ClassVar[str]
    """Name of a measurement without a name, before its number."""

    @property
    def places(self) -> tuple[Point, ...]:
        """Points that define the measurement; none for pixels of the whole frame."""
        return ()

    def points(self, height: int, width: int) -> list[tuple[int, int]]:
        """Rows and columns of the points that define the measurement.

        Raises:
            InputError: for a point that is outside of an image of this size.
        """
        return [_pixel_of(place, height, width) for place in self.places]

    @abc.abstractmethod
    def pixels(self, kelvin: Float[np.ndarray, "h w"]) -> Pixels:
        """Pixels of the measurement in an image of temperatures [K].

        Raises:
            InputError: for a point that is outside of the image.
        """


@dataclass(frozen=True)
class Spot(AbstractMeasurement):
    """The temperature of one pixel."""

    at: Point
    name: str = ""
    prefix: ClassVar[str] = "Sp"

    @property
    @override
    def places(self) -> tuple[Point, ...]:
        return (self.at,)

    @override
    def pixels(self, kelvin: Float[np.ndarray, "h w"]) -> Pixels:
        ((row, column),) = self.points(*kelvin.shape)
        return np.array([row]), np.array([column])


@dataclass(frozen=True)
class Line(AbstractMeasurement):
    """Temperatures along a line between two points."""

    ends: tuple[Point, Point]
    name: str = ""
    prefix: ClassVar[str] = "Li"

    @property
    @override
    def places(self) -> tuple[Point, ...]:
        return self.ends

    @override
    def pixels(self, kelvin: Float[np.ndarray, "h w"]) -> Pixels:
        start, end = self.points(*kelvin.shape)
        return line(*start, *end)


@dataclass(frozen=True)
class Box(AbstractMeasurement):
    """Temperatures within a rectangle, its edges included, by two opposite corners."""

    corners: tuple[Point, Point]
    name: str = ""
    prefix: ClassVar[str] = "Bx"

    @property
    @override
    def places(self) -> tuple[Point, ...]:
        return self.corners

    @override
    def pixels(self, kelvin: Float[np.ndarray, "h w"]) -> Pixels:
        corners = np.array(self.points(*kelvin.shape))
        (top, left) = corners.min(axis=0)
        (bottom, right) = corners.max(axis=0)
        rows, columns = np.mgrid[top : bottom + 1, left : right + 1]
        return rows.ravel(), columns.ravel()


@dataclass(frozen=True)
class Isotherm(AbstractMeasurement):
    """The fraction of the bodies in the image that is between two temperatures [K]."""

    above: float | None = None
    below: float | None = None
    name: str = ""
    allow_extreme_temperatures: bool = field(default=False, kw_only=True, repr=False)
    """Accept limits below 150 K, mostly mistaken Celsius, or above 6000 K."""
    prefix: ClassVar[str] = "Is"

    def __post_init__(self):
        """Refuse an isotherm of all or no temperatures.

        Raises:
            InputError: without a limit, for an extreme one, or for limits that are not
                in order.
        """
        if self.above is None and self.below is None:
            raise InputError("Isotherm(): give `above`, `below` or both [K]")
        stated = {"above": self.above, "below": self.below}
        check_numbers_of_kelvin(
            "Isotherm",
            self.allow_extreme_temperatures,
            **{name: float(end) for name, end in stated.items() if end is not None},
        )
        low, high = self.limits
        if not low < high:
            raise InputError(
                f"Isotherm(above={low:g}, below={high:g}): give above < below [K]"
            )

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the temperature [K], infinite where one is None."""
        low = -math.inf if self.above is None else float(self.above)
        return low, math.inf if self.below is None else float(self.below)

    @override
    def pixels(self, kelvin: Float[np.ndarray, "h w"]) -> Pixels:
        low, high = self.limits
        rows, columns = np.nonzero((kelvin >= low) & (kelvin < high))
        return rows, columns


class Reading(NamedTuple):
    """Temperatures of a measurement in one frame."""

    min: float
    """Lowest temperature [K]; NaN where no body fills a pixel of it."""
    mean: float
    """Mean temperature [K]."""
    max: float
    """Highest temperature [K]."""
    pixels: int
    """Number of pixels that are read: those of the measurement that bodies fill."""
    fraction: float
    """Number of read pixels over all pixels of the frame that bodies fill [-]."""


def names_of(measurements: Sequence[AbstractMeasurement]) -> list[str]:
    """Names of measurements; by kind and number without a name: Sp1, Sp2, Bx1.

    Raises:
        InputError: for a name that is given twice.
    """
    seen = dict[str, int]()
    names = list[str]()
    for measurement in measurements:
        seen[measurement.prefix] = seen.get(measurement.prefix, 0) + 1
        names.append(
            measurement.name or f"{measurement.prefix}{seen[measurement.prefix]}"
        )
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"measurement '{name}' is there twice: give another name")
    return names


def read_temperatures(
    kelvin: Float[np.ndarray, "h w"],
    filled: Bool[np.ndarray, "h w"],
    measurements: Sequence[AbstractMeasurement],
) -> dict[str, Reading]:
    """Readings of measurements by name.

    Args:
        kelvin: temperatures of pixels [K].
        filled: flags of the pixels that bodies fill; others are not read, since those
            on an outline mix body and background.
        measurements: on the image.

    Raises:
        InputError: for a point that is outside of the image, or a name given twice.
    """
    filled_count = int(filled.sum())
    readings = dict[str, Reading]()
    for name, measurement in zip(names_of(measurements), measurements, strict=True):
        with located(f"measurement '{name}'"):
            rows, columns = measurement.pixels(kelvin)
        values = kelvin[rows, columns][filled[rows, columns]]
        # Without a pixel there is no temperature.
        seen = values if len(values) else np.array([math.nan])
        readings[name] = Reading(
            min=float(seen.min()),
            mean=float(seen.mean()),
            max=float(seen.max()),
            pixels=len(values),
            fraction=len(values) / filled_count if filled_count else 0.0,
        )
    return readings
