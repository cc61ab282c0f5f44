"""The section `outdoors`: place, date and weather instead of terms written by hand."""

from datetime import datetime
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field
from typing_extensions import override

from ..messages import quoted
from ..types import quantities as si
from ..types.files import FoundPath
from ..types.model import Mistake, Model
from .terms import Directions


ALL_TERMS = ("sun", "diffuse", "sky", "wind")

# Latitudes are written in degrees everywhere: here a bare number is one of degrees.
Degrees = Annotated[
    float,
    si.Unit("deg", "an angle", "48.1 deg", only=("deg", "degrees", "degree", "°")),
]


def _moment(text: str) -> str:
    try:
        zone = datetime.fromisoformat(text).tzinfo
    except ValueError:
        zone = None
    if zone is None:
        raise si.refuse(
            "expected a date and time with a zone such as '2026-06-21T06:00+02:00', "
            f"got {quoted(text)}"
        )
    return text


class _PlaceConfig(Model, builds="Place"):
    """A place on the earth, and how the scene lies there."""

    latitude: Annotated[Degrees, Field(ge=-90, le=90)]
    """Degrees north of the equator."""
    longitude: Annotated[Degrees, Field(ge=-180, le=180)]
    """Degrees east of Greenwich."""
    altitude: Annotated[si.Length, Field(ge=-500, le=9000)] = 0.0
    """Height above the sea [m]."""


class _ClearSkyConfig(Model, builds="ClearSky"):
    """Cloudless days: air by a sine over the day, warmest at 15 h."""

    air: tuple[si.Temperature, si.Temperature]
    """Lowest and highest temperature of the day [K]."""
    relative_humidity: Annotated[si.Number, Field(ge=0.01, le=1)] = 0.5
    wind_speed: Annotated[si.Speed, Field(le=100)] = 2.0
    """[m/s]"""
    wind_direction: Annotated[Degrees, Field(ge=0, le=360)] = 270.0
    """Direction from which the wind blows, from north towards east [deg]."""
    turbidity: Annotated[si.Number, Field(ge=1, le=10)] = 3.0
    """Linke turbidity [-]."""

    @override
    def mistakes(self) -> list[Mistake]:
        low, high = self.air
        if 150 <= low <= high <= 350:
            return []
        return [(("air",), "give the lowest and then the highest, in 150 to 350 K")]


class OutdoorsConfig(Model, builds="outdoors"):
    """Terms of a scene outdoors; needs the package pvlib."""

    place: _PlaceConfig
    north: si.Direction = (0.0, 1.0, 0.0)
    """Direction of north in the scene, horizontal; z is up."""
    start: Annotated[str, AfterValidator(_moment)]
    """Date and time with a zone, time 0 of the scene."""
    weather: FoundPath | None = None
    """EPW or CSV file."""
    clear_sky: _ClearSkyConfig | None = None
    """Cloudless days, instead of a file."""
    terms: Annotated[
        tuple[Literal["sun", "diffuse", "sky", "wind", "convection"], ...], si.NotEmpty
    ] = ALL_TERMS
    sky: Literal["infrared", "berdahl_martin"] | None = None
    """Sky temperature by the file's radiation, or by the dew point."""
    ground: Literal["air", "sol_air"] = "air"
    """Ground as warm as the air, or dry and in balance with the sun."""
    albedo: si.Fraction = 0.2
    """Fraction of sunlight that the ground reflects [-]."""
    occlusion: Directions | None = None
    every: Annotated[si.Time, Field(ge=1)] = 1800.0
    """Interval at which the sun's shadows are recomputed [s]."""

    exactly_one: ClassVar = (("weather", "clear_sky"),)

    @override
    def mistakes(self) -> list[Mistake]:
        found: list[Mistake] = []
        if self.north[2] != 0:
            found.append((("north",), "must be horizontal: give 0 as the last number"))
        if {"wind", "convection"} <= {*self.terms}:
            found.append((("terms",), "give one of wind and convection"))
        if len({*self.terms}) < len(self.terms):
            found.append((("terms",), "give each once"))
        if self.sky == "infrared" and self.clear_sky is not None:
            found.append((("sky",), "a clear_sky has no infrared: give berdahl_martin"))
        return found

    @override
    def arguments(self) -> dict[str, Any]:
        given = super().arguments()
        x, y, _ = given.pop("north")
        place = _PlaceConfig.target()(**self.place.arguments(), north=(x, y))
        sky = given.pop("clear_sky", None)
        weather = given.pop("weather", None) if sky is None else sky
        start = datetime.fromisoformat(self.start)
        return given | {"place": place, "start": start, "weather": weather}

    @override
    def build(self, *args: Any) -> Any:
        """The terms for a run of a duration [s], the one argument."""
        (duration,) = args
        return self.target()(duration=duration, **self.arguments())
