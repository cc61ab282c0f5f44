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
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema
from typing_extensions import override

from ...choices import Palette
from ...errors import InputError
from ...image.colour.palette import palette_names
from ...image.measurements import names_of
from ...image.radiance.response import BANDS, checked_response
from ...image.surface.lens import (
    CameraPose,
    Lens,
    check_lens,
    checked_distortion,
    lens_of_matrix,
    pose_of_matrix,
)
from ..messages import close_match
from ..types import quantities as si
from ..types.model import ByKind, Mistake, Model, Short, build
from .effects import EffectConfig, range_mistakes
from .measurement import MeasurementConfig


Pixels = Annotated[si.Whole, Field(ge=1, le=16384)]
FieldOfView = Annotated[si.Angle, Field(gt=0, lt=math.pi)]


class _View(Model):
    """Position and direction of a camera, by default chosen to show all bodies."""

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


_Row3 = Annotated[tuple[si.Number, si.Number, si.Number], si.Three]
_Row4 = tuple[si.Number, si.Number, si.Number, si.Number]


class PinholeConfig(_View, builds="Camera", kind="pinhole"):
    """A perspective camera; one that is calibrated has matrices as OpenCV's."""

    field_of_view: Annotated[FieldOfView | None, si.Auto] = None
    K: tuple[_Row3, _Row3, _Row3] | None = None
    """Intrinsic matrix [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]] [pixels] instead of
    `field_of_view`, of pictures of `width` and `height`; the centre of the first pixel
    is at (0, 0)."""
    distortion: tuple[si.Number, ...] = ()
    """Coefficients k1, k2, p1, p2 and perhaps k3 of Brown and Conrady, with `K`."""
    world_to_camera: Annotated[tuple[_Row4, ...], Field(min_length=3, max_length=4)] | (
        None
    ) = None
    """Matrix [R, t] of the pose [-, m] instead of `position`, `look_at` and `up`: a
    point X of the world is at R X + t in the axes right, down and forward. A last row
    [0, 0, 0, 1] may follow, as `jaxthermo dataset` has none."""

    @property
    def lens(self) -> Lens | None:
        """Lens of `K`.

        Raises:
            InputError: for a matrix of another form, or of pictures of another size.
        """
        if self.K is None:
            return None
        return lens_of_matrix(
            self.K, width=self.width, height=self.height, distortion=self.distortion
        )

    @property
    def pose(self) -> CameraPose | None:
        """Pose of `world_to_camera`.

        Raises:
            InputError: for a matrix that does more than turn and move.
        """
        if self.world_to_camera is None:
            return None
        return pose_of_matrix(self.world_to_camera)

    @override
    def mistakes(self) -> list[Mistake]:
        mistakes = super().mistakes()
        written = self.model_fields_set
        if self.K is None and self.distortion:
            mistakes.append((("distortion",), "belongs to a matrix: give K, too"))
        if self.K is not None:
            if self.field_of_view is not None:
                mistakes.append((("field_of_view",), "is that of K: leave it out"))
            mistakes += [
                ((key,), "is missing: give the size of the pictures that K is of")
                for key in ("width", "height")
                if key not in written
            ]
        if self.world_to_camera is not None:
            mistakes += [
                ((key,), "is that of world_to_camera: leave it out")
                for key in ("position", "look_at", "up")
                if getattr(self, key) != type(self).model_fields[key].default
            ]
        if mistakes:
            return mistakes
        # In this order: a lens is one of valid coefficients and a valid K.
        checks = (
            ("distortion", lambda: checked_distortion(self.distortion)),
            ("K", lambda: self.lens),
            ("world_to_camera", lambda: self.pose),
            ("distortion", self._check_folds),
        )
        for key, check in checks:
            try:
                check()
            except InputError as error:
                return [((key,), str(error).partition(": ")[2])]
        return []

    def _check_folds(self) -> None:
        lens = self.lens
        if lens is not None and lens.distortion:
            check_lens(lens)


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


class _BandConfig(Model, builds="Band"):
    """Band of the detector: a name, or wavelengths and the response at each."""

    exactly_one = (("name", "wavelengths"),)

    name: Literal["long-wave", "mid-wave"] | None = None
    """Long-wave is 7.5 to 14 um, as in most uncooled cameras; mid-wave is 3 to 5 um."""
    wavelengths: tuple[si.PositiveLength, ...] | None = None
    """Two or more wavelengths, increasing [m]."""
    response: tuple[si.Fraction, ...] | None = None
    """Response at each wavelength [-]; 1 if not given."""

    @override
    def mistakes(self) -> list[Mistake]:
        if self._wavelengths is None:
            return []
        try:
            checked_response(self._wavelengths, self.response)
        except InputError as error:
            return [((), str(error).partition(": ")[2])]
        return []

    @property
    def _wavelengths(self) -> tuple[float, ...] | None:
        return self.wavelengths if self.name is None else BANDS[self.name]

    @override
    def build(self, *args: Any) -> Any:
        return self.target()(wavelengths=self._wavelengths, response=self.response)


class _OfWavelengths:
    """Marks a band that may be written as its wavelengths alone: `[8 um, 14 um]`."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def read(value: object) -> object:
            if isinstance(value, list | tuple):
                return {"wavelengths": value}
            return value

        return core_schema.no_info_before_validator_function(read, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        wavelengths = {"type": "array", "items": {"type": ["number", "string"]}}
        return {"anyOf": [handler(schema), wavelengths]}


def _once(names: tuple[str, ...]) -> tuple[str, ...]:
    for k, name in enumerate(names):
        if name in names[:k]:
            raise si.refuse(f"'{name}' is given twice")
    return names


_FrameFile = Literal["exr", "png", "centikelvin", "tiff", "csv"]


class ImageConfig(Model):
    """The colours of the frames, and which saved times become frames."""

    palette: Annotated[
        Palette,
        AfterValidator(_known_palette),
        Field(json_schema_extra={"enum": [*palette_names()]}),
    ] = "iron"
    quantity: Literal["apparent", "surface"] = "apparent"
    """Apparent temperature, as a camera measures it, or that of the surface."""
    low: Annotated[si.Temperature | None, si.Auto] = None
    """Temperature at the cold end of the colour scale [K]."""
    high: Annotated[si.Temperature | None, si.Auto] = None
    """Temperature at the hot end of the colour scale [K]."""
    gain: Literal["linear", "plateau"] = "linear"
    """Colours linear in the temperature, or by the histogram of each frame, as cameras
    display them. The contact sheet has one scale and is always linear."""
    smooth: si.Flag = True
    """Interpolate temperatures over the surface; if false, a voxel has one colour."""
    samples: Annotated[si.Whole, Field(ge=1, le=8)] = 2
    """Square root of the number of rays for each pixel; more rays smooth the edges."""
    occlusion: Annotated[si.PositiveLength | None, si.NoneWord("none")] = None
    """Distance within which surfaces in the image hide the surroundings that others
    reflect [m]; for scenes whose terms do not detect occlusion."""
    band: Annotated[
        Annotated[_BandConfig, Short("name", words=(*BANDS,)), _OfWavelengths()] | None,
        si.NoneWord("all"),
    ] = _BandConfig(name="long-wave")
    """Wavelengths that the detector sees. With `all` of them, reflected sunlight is as
    bright as it heats."""
    effects: tuple[EffectConfig, ...] = ()
    """Effects of surfaces, air, optics and detector, in any order, each once."""
    frames: Frames = None
    """Saved times that become frames [s]."""
    files: Annotated[tuple[_FrameFile, ...], si.NotEmpty, AfterValidator(_once)] = (
        "exr",
        "png",
    )
    """Files of each frame: EXR with all channels, PNG in false colours, or `quantity`
    alone: grey 16-bit PNG in 0.01 K (centikelvin), float32 TIFF or CSV in kelvin."""

    measurements: tuple[MeasurementConfig, ...] = ()
    """Spots, lines, boxes and isotherms. They are drawn on the pictures, and written to
    `measurements.csv` and a chart over time."""

    @override
    def mistakes(self) -> list[Mistake]:
        effect_kinds = [effect.kind for effect in self.effects]
        mistakes: list[Mistake] = [
            (("effects", number), f"{effect_kind} is there already: give it once")
            for number, effect_kind in enumerate(effect_kinds)
            if effect_kind in effect_kinds[:number]
        ]
        mistakes += range_mistakes(self.low, self.high)
        try:
            names_of(build(self.measurements))
        except InputError as error:
            mistakes.append((("measurements",), str(error)))
        return mistakes
