"""The camera, and how its frames are drawn."""

import math
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
)
from pydantic_core import CoreSchema, core_schema
from typing_extensions import override

from ...errors import InputError
from ...image.colour.palette import palette_names
from ...image.measurements import names_of
from ...image.radiance.response import BANDS, checked_response
from ..messages import close_match
from ..types import quantities as si
from ..types.model import ByKind, Mistake, Model, Short, build
from .effects import EffectConfig
from .measurement import MeasurementConfig


Pixels = Annotated[si.Whole, Field(ge=1, le=16384)]
FieldOfView = Annotated[si.Angle, Field(gt=0, lt=math.pi)]


class _View(Model):
    """Position and direction of a camera; what is not given is chosen to fit."""

    position: Annotated[si.Position | None, si.Auto] = None
    look_at: Annotated[si.Position | None, si.Auto] = None
    up: si.Direction = (0.0, 0.0, 1.0)
    width: Pixels = 640
    height: Pixels = 480

    def mistakes(self) -> list[Mistake]:
        # Checked by the camera's class too, but here before a long run.
        if self.position is None or self.look_at is None:
            return []
        ahead = [b - a for a, b in zip(self.position, self.look_at, strict=True)]
        distance = math.hypot(*ahead)
        if distance == 0.0:
            return [(("look_at",), "is where the camera stands")]
        along = sum(a * b for a, b in zip(ahead, self.up, strict=True))
        # Relative to both lengths, which cosines of tiny angles need to round to 1.
        if abs(along) > (1.0 - 1e-9) * distance * math.hypot(*self.up):
            return [(("up",), "is along the view; choose another up direction")]
        return []


class PinholeConfig(_View, builds="Camera", kind="pinhole"):
    """A perspective camera."""

    field_of_view: Annotated[FieldOfView | None, si.Auto] = None


class OrthographicConfig(_View, builds="OrthographicCamera", kind="orthographic"):
    """A camera with parallel rays."""

    view_height: Annotated[si.PositiveLength | None, si.Auto] = None


def _fitted(value: Any) -> Any:
    return {} if value == "auto" else value


CameraConfig = Annotated[
    PinholeConfig | OrthographicConfig,
    ByKind(),
    Short("kind", "pinhole", words=("auto", "pinhole", "orthographic")),
    BeforeValidator(_fitted),
]


Frames = Annotated[
    Annotated[tuple[si.PositiveTime, ...], si.NotEmpty] | None, si.NoneWord("all")
]


def _known_palette(name: str) -> str:
    names = palette_names()
    if name not in names:
        raise si.refuse(f"unknown palette '{name}'{close_match(name, names)}")
    return name


class BandConfig(Model, builds="Band"):
    """Band of the detector: its name, or wavelengths and the response at each."""

    exactly_one = (("name", "wavelengths"),)

    name: Literal["long-wave", "mid-wave"] | None = None
    """7.5 to 14 um, as of most uncooled cameras, or 3 to 5 um."""
    wavelengths: tuple[si.PositiveLength, ...] | None = None
    """Two or more, increasing [m]."""
    response: tuple[si.Fraction, ...] | None = None
    """Response at each wavelength [-]; 1 if not given."""

    @override
    def mistakes(self) -> list[Mistake]:
        given = self.arguments()
        if given["wavelengths"] is None:
            return []
        try:
            checked_response(**given)
        except InputError as error:
            return [((), str(error).partition(": ")[2])]
        return []

    @override
    def arguments(self) -> dict[str, Any]:
        ends = self.wavelengths if self.name is None else BANDS[self.name]
        return {"wavelengths": ends, "response": self.response}


class _OfWavelengths:
    """Marks a band for which its wavelengths alone may stand: `[8 um, 14 um]`."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        read = lambda v: {"wavelengths": v} if isinstance(v, list | tuple) else v
        inner = handler(source)
        return core_schema.no_info_before_validator_function(read, inner)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        lengths = {"type": "array", "items": {"type": ["number", "string"]}}
        return {"anyOf": [handler(schema), lengths]}


def _once(names: tuple[str, ...]) -> tuple[str, ...]:
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise si.refuse(f"'{twice[0]}' is given twice")
    return names


FrameFile = Literal["exr", "png", "centikelvin", "tiff", "csv"]


class ImageConfig(Model):
    """The colours of the frames, and which saved times become frames."""

    palette: Annotated[
        str,
        AfterValidator(_known_palette),
        Field(json_schema_extra={"enum": [*palette_names()]}),
    ] = "iron"
    quantity: Literal["apparent", "surface"] = "apparent"
    """Apparent temperature, as a camera measures it, or the surface's own."""
    low: Annotated[si.Temperature | None, si.Auto] = None
    """Temperature at the cold end of the colour scale [K]."""
    high: Annotated[si.Temperature | None, si.Auto] = None
    """Temperature at the hot end of the colour scale [K]."""
    gain: Literal["linear", "plateau"] = "linear"
    """Colours over the temperature: linear, or by the histogram of each frame, as
    cameras display; the contact sheet, which has one scale, is linear."""
    smooth: si.Flag = True
    """Interpolate temperatures over the surface instead of one for each voxel."""
    samples: Annotated[si.Whole, Field(ge=1, le=8)] = 2
    """Square root of the number of rays for each pixel, which smooth the edges."""
    occlusion: Annotated[si.PositiveLength | None, si.NoneWord("none")] = None
    """Distance within which surfaces in the image hide the surroundings from what
    others reflect [m]; for scenes whose terms do not detect it."""
    band: Annotated[
        Annotated[BandConfig, Short("name", words=(*BANDS,)), _OfWavelengths()] | None,
        si.NoneWord("all"),
    ] = BandConfig(name="long-wave")
    """Wavelengths that the detector sees; with all of them the sun that surfaces
    reflect is as bright as it heats."""
    effects: tuple[EffectConfig, ...] = ()
    """Effects of surfaces, air, optics and detector, in any order, each once."""
    frames: Frames = None
    """Saved times that become frames [s]."""
    files: Annotated[tuple[FrameFile, ...], si.NotEmpty, AfterValidator(_once)] = (
        "exr",
        "png",
    )
    """Files of each frame: EXR of all channels, PNG in false colours; `quantity` alone
    as grey PNG of 16 bits in 0.01 K (centikelvin), TIFF of float32 or CSV in kelvin."""

    measurements: tuple[MeasurementConfig, ...] = ()
    """Spots, lines, boxes and isotherms: drawn on the pictures, and over time in
    `measurements.csv` and a chart."""

    @override
    def mistakes(self) -> list[Mistake]:
        kinds = [effect.kind for effect in self.effects]
        found: list[Mistake] = [
            (("effects", number), f"{kind} is there already: give it once")
            for number, kind in enumerate(kinds)
            if kind in kinds[:number]
        ]
        low, high = self.low, self.high
        if low is not None and high is not None and low >= high:
            found.append((("high",), f"{high:g} K is not above `low`, {low:g} K"))
        try:
            names_of(build(self.measurements))
        except InputError as error:
            found.append((("measurements",), str(error)))
        return found
