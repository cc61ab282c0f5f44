"""The camera, and how its frames are drawn."""

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from .fields import (
    Angle,
    Auto,
    Direction,
    Flag,
    NotEmpty,
    Position,
    PositiveLength,
    PositiveTime,
    Temperature,
    Whole,
    refuse,
)
from .kinds import by_kind
from .known import palette_names
from .model import Mistake, Model
from .show import close_match


Pixels = Annotated[Whole, Field(ge=1, le=16384)]
FieldOfView = Annotated[Angle, Field(gt=0, lt=math.pi)]


class _View(Model):
    """Where a camera stands and looks; what is not given is found from the scene."""

    position: Annotated[Position | None, Auto] = None
    look_at: Annotated[Position | None, Auto] = None
    up: Direction = (0.0, 0.0, 1.0)
    width: Pixels = 640
    height: Pixels = 480

    def mistakes(self) -> list[Mistake]:
        """A camera that looks at itself, or along its own up direction."""
        if self.position is None or self.look_at is None:
            return []
        ahead = [b - a for a, b in zip(self.position, self.look_at, strict=True)]
        distance = math.hypot(*ahead)
        if distance == 0.0:
            return [(("look_at",), "is where the camera stands")]
        along = sum(a * b for a, b in zip(ahead, self.up, strict=True))
        if abs(along) > (1.0 - 1e-9) * distance * math.hypot(*self.up):
            return [(("up",), "is along the view; choose another up direction")]
        return []


class PinholeConfig(_View):
    """A perspective camera."""

    kind: Literal["pinhole"] = "pinhole"
    field_of_view: Annotated[FieldOfView | None, Auto] = None


class OrthographicConfig(_View):
    """A camera with parallel rays."""

    kind: Literal["orthographic"] = "orthographic"
    view_height: Annotated[PositiveLength | None, Auto] = None


def _camera(value: Any) -> Any:
    if value == "auto":
        return PinholeConfig()
    is_pinhole = isinstance(value, dict) and "kind" not in value
    return {"kind": "pinhole", **value} if is_pinhole else value


CameraConfig = Annotated[
    Annotated[PinholeConfig, Tag("<pinhole>")]
    | Annotated[OrthographicConfig, Tag("<orthographic>")],
    Discriminator(by_kind),
    BeforeValidator(_camera),
]


def _all(value: Any) -> Any:
    return None if value == "all" else value


Frames = Annotated[
    Annotated[tuple[PositiveTime, ...], NotEmpty] | None,
    BeforeValidator(_all),
]


def _known_palette(name: str) -> str:
    if name not in palette_names():
        raise refuse(f"unknown palette '{name}'{close_match(name, palette_names())}")
    return name


class ImageConfig(Model):
    """The colours of the frames, and which saved times become frames.

    `samples` squared rays a pixel smooth the edges.
    """

    palette: Annotated[str, AfterValidator(_known_palette)] = "iron"
    quantity: Literal["apparent", "surface"] = "apparent"
    low: Annotated[Temperature | None, Auto] = None
    high: Annotated[Temperature | None, Auto] = None
    smooth: Flag = True
    samples: Annotated[Whole, Field(ge=1, le=8)] = 2
    frames: Frames = None

    def mistakes(self) -> list[Mistake]:
        """A colour scale that ends before it begins."""
        if self.low is None or self.high is None or self.low < self.high:
            return []
        return [(("high",), f"{self.high:g} K is not above `low`, {self.low:g} K")]
