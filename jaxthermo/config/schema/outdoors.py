"""The section `outdoors`: place, date and weather instead of terms written by hand."""

from datetime import datetime
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field
from typing_extensions import override

from ..messages import quoted
from ..types import quantities as si
from ..types.files import FoundPath
from ..types.model import Mistake, Model
from .selection import WhereConfig
from .terms import Directions


SkyModel = Literal[
    "infrared", "cloud_cover", "diffuse_share", "berdahl_martin", "swinbank"
]
ALL_TERMS = ("sun", "diffuse", "sky", "wind")

# Latitudes are usually written in degrees: here a bare number is in degrees.
_Degrees = Annotated[
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

    latitude: Annotated[_Degrees, Field(ge=-90, le=90)]
    """Degrees north of the equator."""
    longitude: Annotated[_Degrees, Field(ge=-180, le=180)]
    """Degrees east of Greenwich."""
    altitude: Annotated[si.Length, Field(ge=-500, le=9000)] = 0.0
    """Height above the sea [m]."""


class _ClearSkyConfig(Model, builds="ClearSky"):
    """Cloudless days: air by a sine over the day, warmest at 15 h."""

    air: tuple[si.Temperature, si.Temperature]
    """Lowest and highest temperature of the day [K]."""
    relative_humidity: Annotated[si.Number, Field(ge=0.01, le=1)] = 0.5
    wind_speed: Annotated[si.Speed, Field(le=100)] = 2.0
    """Speed of the wind [m/s]."""
    wind_direction: Annotated[_Degrees, Field(ge=0, le=360)] = 270.0
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

    place: _PlaceConfig | None = None
    """Place of the scene; by default that of an EPW file."""
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
    sky: SkyModel | None = None
    """Sky temperature by the file's radiation, by the dew point and the clouds or the
    diffuse share of the daylight, by the dew point, or by the air alone; by default the
    first that the weather has."""
    ground: Literal["air", "sol_air"] = "air"
    """Ground as warm as the air, or dry ground in balance with the sun."""
    albedo: si.Fraction = 0.2
    """Fraction of sunlight that the ground reflects [-]."""
    occlusion: Directions | None = None
    every: Annotated[si.Time, Field(ge=1)] = 1800.0
    """Interval at which the sun's shadows are recomputed [s]."""
    longwave: dict[str, WhereConfig] | None = None
    """Surfaces whose long wave is in a column of the file, such as `west` for
    `longwave_west_W_m2`, in the place of sky and ground."""

    exactly_one: ClassVar = (("weather", "clear_sky"),)

    @override
    def mistakes(self) -> list[Mistake]:
        mistakes: list[Mistake] = []
        if self.north[2] != 0:
            mistakes.append(
                (("north",), "must be horizontal: give 0 as the last number")
            )
        if {"wind", "convection"} <= {*self.terms}:
            mistakes.append((("terms",), "give one of wind and convection"))
        if len({*self.terms}) < len(self.terms):
            mistakes.append((("terms",), "give each once"))
        if self.clear_sky is not None and self.sky in ("infrared", "cloud_cover"):
            message = f"a clear_sky has no {self.sky}: give berdahl_martin"
            mistakes.append((("sky",), message))
        if self.longwave and (self.clear_sky is not None or "sky" not in self.terms):
            message = "replaces the term `sky` by columns of a weather file: give both"
            mistakes.append((("longwave",), message))
        if self.clear_sky is not None and self.place is None:
            mistakes.append((("place",), "is missing: a clear_sky has none"))
        return mistakes

    @property
    def moment(self) -> datetime:
        """Date and time of the start."""
        return datetime.fromisoformat(self.start)

    @override
    def build(self, *args: Any) -> Any:
        """The terms for a run; the argument is its duration [s]."""
        (duration,) = args
        arguments = self.arguments()
        north_x, north_y, _ = arguments.pop("north")
        if self.place is None:
            arguments |= {"place": None, "north": (north_x, north_y)}
        else:
            place = _PlaceConfig.target()
            arguments["place"] = place(
                **self.place.arguments(), north=(north_x, north_y)
            )
        clear_sky = arguments.pop("clear_sky", None)
        weather_file = arguments.pop("weather", None)
        arguments["longwave"] = {
            plane: surface.build() for plane, surface in (self.longwave or {}).items()
        }
        arguments["start"] = self.moment
        arguments["weather"] = clear_sky or weather_file
        return self.target()(duration=duration, **arguments)
