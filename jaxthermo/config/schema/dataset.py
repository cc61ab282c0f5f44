"""Schema of a dataset: a scene, its variations, and the cameras that see them."""

import math
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import BeforeValidator, Field
from typing_extensions import override

from ..types import quantities as si
from ..types.files import FoundPath
from ..types.model import Mistake, Model
from .effects import range_mistakes
from .image import CameraConfig, FieldOfView, Frames, Pixels
from .scene import unit_of


_Key: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]
_Changes: TypeAlias = dict[_Key, Any]
_Count = Annotated[si.Whole, Field(ge=1, le=10_000)]
_RightAngle = math.pi / 2


def _pair(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise si.refuse("expected two numbers, [lowest, highest]")
    return tuple(value)


_Elevation = Annotated[si.Angle, Field(ge=-_RightAngle, le=_RightAngle)]
_Elevations = Annotated[tuple[_Elevation, _Elevation], BeforeValidator(_pair)]
_Azimuths = Annotated[tuple[si.Angle, si.Angle], BeforeValidator(_pair)]
_Distances = Annotated[
    tuple[si.PositiveLength, si.PositiveLength], BeforeValidator(_pair)
]


class _ManyCamerasConfig(Model):
    """Cameras at several places, which look at the bodies."""

    count: _Count
    look_at: Annotated[si.Position | None, si.Auto] = None
    """Point that the cameras look at [m]; the middle of the bodies if not given."""
    field_of_view: FieldOfView = 0.6
    """Angle from the top to the bottom of the image [rad]."""
    width: Pixels = 320
    height: Pixels = 240


class PathConfig(_ManyCamerasConfig):
    """Cameras at equal distances on a line from point to point, both ends included."""

    points: Annotated[tuple[si.Position, ...], Field(min_length=2)]
    """Points of the line [m]."""

    @override
    def mistakes(self) -> list[Mistake]:
        pairs = zip(self.points, self.points[1:], strict=False)
        return [
            (("points", number), "is the point before it: leave it out")
            for number, (point, following) in enumerate(pairs, start=1)
            if point == following
        ]


class KeypointConfig(Model):
    """A point of a body whose pixel is a label of every frame."""

    body: Annotated[si.Whole, Field(ge=0)] | _Key = 0
    """Number or name of the body."""
    position: si.Position
    """Place in the world at the start [m]; it moves with the body."""


class OrbitConfig(_ManyCamerasConfig):
    """Cameras at random places around the bodies, which they look at."""

    elevation: _Elevations = (math.radians(10), math.radians(50))
    """Lowest and highest angle above the horizon [rad]."""
    azimuth: _Azimuths = (0.0, 2 * math.pi)
    """Range of the angle from the x axis towards the y axis [rad]."""
    distance: Annotated[_Distances | None, si.Auto] = None
    """Smallest and largest distance [m]; by default once and 1.5 times the distance at
    which the bodies fill the view."""

    @override
    def mistakes(self) -> list[Mistake]:
        pairs = {"elevation": self.elevation, "azimuth": self.azimuth}
        if self.distance is not None:
            pairs["distance"] = self.distance
        return [
            ((name,), f"{high:g} is below {low:g}: give the lowest first")
            for name, (low, high) in pairs.items()
            if high < low
        ]


class DatasetConfig(Model):
    """A complete dataset: every variation, from every view, at every time."""

    exactly_one: ClassVar = (("views", "orbit", "path"),)

    scene: FoundPath
    """Config file of the scene."""
    allow_extreme_temperatures: si.Flag | None = None
    """Accept temperatures below 150 K and above 6000 K here and in the scene."""
    set: _Changes = {}
    """Changes of all variations, by dotted key as after `--set`."""
    variations: dict[_Key, Annotated[tuple[Any, ...], si.NotEmpty]] = {}
    """Values by dotted key; every combination of them is a run."""
    ranges: dict[_Key, Annotated[tuple[Any, Any], BeforeValidator(_pair)]] = {}
    """Lowest and highest value by dotted key; each run draws a value between them."""
    samples: _Count = 1
    """Number of runs with drawn values for each combination of the variations."""
    seed: Annotated[si.Whole, Field(ge=0)] = 0
    """Seed of drawn values, places of cameras and noise."""
    views: Annotated[tuple[CameraConfig, ...], si.NotEmpty] | None = None
    """Cameras that see every variation."""
    orbit: OrbitConfig | None = None
    """Cameras around the bodies, instead of a list."""
    path: PathConfig | None = None
    """Cameras on a line, instead of a list."""
    times: Frames = None
    """Saved times that become frames [s]."""
    low: Annotated[si.Temperature | None, si.Auto] = None
    """Temperature of black in 8-bit images [K]; by default from each frame."""
    high: Annotated[si.Temperature | None, si.Auto] = None
    """Temperature of white in 8-bit images [K]; by default from each frame."""
    categories: Annotated[tuple[_Key, ...], si.NotEmpty] | None = None
    """Class name of each body; by default the name of its mesh file or shape."""
    keypoints: dict[_Key, KeypointConfig] = {}
    """Points of bodies by name, whose pixels are labels."""
    validation: Annotated[si.Fraction | None, Field(gt=0, lt=1)] = None
    """Fraction of the runs whose frames are for validation; the others are for
    training."""

    @override
    def mistakes(self) -> list[Mistake]:
        mistakes: list[Mistake] = []
        for name in self.ranges:
            for where, message in self._range_mistakes(name):
                mistakes.append((("ranges", name, *where), message))
        for name in {*self.ranges} & {*self.variations}:
            mistakes.append((("ranges", name), "is in `variations` too: give it once"))
        if self.samples > 1 and not self.ranges:
            message = "all samples would be equal: give `ranges` to draw from"
            mistakes.append((("samples",), message))
        return mistakes + range_mistakes(self.low, self.high)

    def _range_mistakes(self, name: str) -> list[Mistake]:
        mistakes: list[Mistake] = []
        ends = []
        for i, value in enumerate(self.ranges[name]):
            try:
                ends.append(_number(name, value))
            except Exception as error:  # of any of the units' checks
                mistakes.append(((i,), " ".join(str(error).split())))
        if len(ends) == 2 and not ends[0] < ends[1]:
            mistakes.append(((1,), f"{ends[1]:g} is not above {ends[0]:g}"))
        return mistakes

    def range_of(self, name: str) -> tuple[float, float]:
        """Both ends of a range in SI."""
        low, high = (_number(name, value) for value in self.ranges[name])
        return low, high


def _number(key: str, value: Any) -> float:
    return si.to_si(value, unit_of(key) or si.NUMBER)
