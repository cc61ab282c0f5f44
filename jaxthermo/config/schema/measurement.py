"""Measurements on frames: spots, lines, boxes and isotherms."""

from typing import Annotated, Any, ClassVar

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema
from typing_extensions import override

from ...errors import InputError
from ...image.measurements import checked_coordinate, pixel_index
from ..types import quantities as si
from ..types.model import ByKind, Mistake, Model, TemperatureModel


class _Coordinate:
    """Marks a fraction of the width or height of an image, or a pixel: "320 px"."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def read(value: Any) -> float | str:
            try:
                return checked_coordinate(value)
            except InputError as error:
                raise si.refuse(str(error)) from error

        return core_schema.no_info_plain_validator_function(read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        number = {"type": "number", "minimum": 0, "maximum": 1}
        pattern = r"^\s*\d*\.?\d*\s*(%|px)?\s*$"
        text = {"type": "string", "pattern": pattern, "examples": ["25 %", "320 px"]}
        return {"anyOf": [number, text]}


_Pixel = Annotated[float | str, _Coordinate()]
_Point = Annotated[
    tuple[_Pixel, _Pixel], si.of_length(2, "a point [across, down] of the image")
]
_Points = Annotated[tuple[_Point, _Point], si.of_length(2, "two points")]
_Name = Annotated[str, Field(min_length=1, max_length=40)]


class _Placed(Model):
    """A measurement at points of the image."""

    name: _Name | None = None
    """Name at the mark and in `measurements.csv`; by default its kind and a number."""

    two_points: ClassVar[str] = ""
    """Key of its points; empty without two of them."""

    @property
    def places(self) -> dict[tuple[str | int, ...], tuple[Any, Any]]:
        """Points of the measurement by their location in the config."""
        points = getattr(self, self.two_points) if self.two_points else ()
        return {(self.two_points, k): point for k, point in enumerate(points)}

    def outside(self, width: int, height: int) -> list[Mistake]:
        """Mistakes for coordinates outside an image of this size [pixels]."""
        mistakes: list[Mistake] = []
        sizes = (("columns", width), ("rows", height))
        for where, point in self.places.items():
            for k, (axis, size) in enumerate(sizes):
                try:
                    pixel_index(point[k], size, axis)
                except InputError as error:
                    mistakes.append(((*where, k), str(error)))
        return mistakes


class _SpotConfig(_Placed, builds="measurements.Spot", kind="spot"):
    """The temperature of one pixel."""

    at: _Point
    """Distances from the left and from the top: fractions, or pixels as '320 px'."""

    @property
    @override
    def places(self) -> dict[tuple[str | int, ...], tuple[Any, Any]]:
        return {("at",): self.at}


class _LineConfig(_Placed, builds="measurements.Line", kind="line"):
    """Temperatures along a line."""

    ends: _Points

    two_points: ClassVar = "ends"


class _BoxConfig(_Placed, builds="measurements.Box", kind="box"):
    """Temperatures within a rectangle."""

    corners: _Points
    """Two opposite corners."""

    two_points: ClassVar = "corners"


class _IsothermConfig(
    _Placed, TemperatureModel, builds="measurements.Isotherm", kind="isotherm"
):
    """The fraction of the bodies in the image between two temperatures."""

    above: si.Temperature | None = None
    """Lower end of the range [K]."""
    below: si.Temperature | None = None
    """Upper end of the range [K]."""

    @override
    def mistakes(self) -> list[Mistake]:
        if self.above is None and self.below is None:
            return [((), "missing `above` or `below`: give one of them, or both")]
        if self.above is None or self.below is None or self.above < self.below:
            return []
        ends = f"{self.below:g} K is not above `above`, {self.above:g} K"
        return [(("below",), ends)]


MeasurementConfig = Annotated[
    _SpotConfig | _LineConfig | _BoxConfig | _IsothermConfig, ByKind()
]
