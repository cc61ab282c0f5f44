"""Bodies: a mesh or a shape, its voxels, structure, material, temperature and pose."""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from ..errors import InputError
from . import units
from .fields import (
    Angle,
    Direction,
    Position,
    PositiveLength,
    Size,
    Temperature,
    Whole,
    refuse,
)
from .found import FoundPath
from .kinds import by_kind
from .model import Mistake, Model
from .schema_material import Material
from .schema_structure import (
    FluxCorrectedMap,
    FullVolume,
    StructureConfig,
    SurfaceMapConfig,
)
from .show import show
from .units import to_si


def _metres_per_unit(value: Any) -> float:
    """From a unit's name, a length such as "25.4 mm", or metres."""
    is_name = isinstance(value, str) and value[:1].isalpha()
    try:
        return to_si(f"1 {value}" if is_name else value, units.LENGTH)
    except InputError:
        raise refuse(
            f"expected a length unit such as 'mm', got {show(value)}"
        ) from None


MetresPerUnit = Annotated[float, BeforeValidator(_metres_per_unit), Field(gt=0)]


class MeshConfig(Model):
    """A mesh file and its scale: metres per file unit, or the height it shall have."""

    path: FoundPath
    unit: MetresPerUnit | None = None
    height: PositiveLength | None = None
    up: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"

    exactly_one: ClassVar = (("unit", "height"),)


class Box(Model):
    """A block with edges along the axes."""

    kind: Literal["box"] = "box"
    size: Size


class Sphere(Model):
    """A ball."""

    kind: Literal["sphere"] = "sphere"
    radius: PositiveLength


class Cylinder(Model):
    """An upright cylinder."""

    kind: Literal["cylinder"] = "cylinder"
    radius: PositiveLength
    height: PositiveLength


class Slab(Model):
    """A plate, thin along x."""

    kind: Literal["slab"] = "slab"
    thickness: PositiveLength
    width: PositiveLength
    length: PositiveLength


class Figurine(Model):
    """The demo body: thick and thin parts, one behind another."""

    kind: Literal["figurine"] = "figurine"
    height: PositiveLength


ShapeConfig = Annotated[
    Annotated[Box, Tag("<box>")]
    | Annotated[Sphere, Tag("<sphere>")]
    | Annotated[Cylinder, Tag("<cylinder>")]
    | Annotated[Slab, Tag("<slab>")]
    | Annotated[Figurine, Tag("<figurine>")],
    Discriminator(by_kind),
]


class PaintConfig(Model):
    """A box of the body [m] that is made of another material."""

    lower: Position
    upper: Position
    material: Material

    def mistakes(self) -> list[Mistake]:
        """A box without inside."""
        return empty_box(self.lower, self.upper)


class RotationConfig(Model):
    """A turn about an axis through the origin, anticlockwise seen against it."""

    axis: Direction
    angle: Angle


class PoseConfig(Model):
    """Where the body is in the scene: first turned, then moved."""

    translation: Position = (0.0, 0.0, 0.0)
    rotation: RotationConfig | None = None


class BodyConfig(Model):
    """One body of the scene."""

    mesh: MeshConfig | None = None
    shape: ShapeConfig | None = None
    pitch: PositiveLength | None = None
    voxels_high: Annotated[Whole, Field(ge=1, le=4096)] | None = None
    structure: StructureConfig = FullVolume()
    surface_map: SurfaceMapConfig = FluxCorrectedMap()
    material: Material
    regions: tuple[PaintConfig, ...] = ()
    temperature: Temperature
    pose: PoseConfig = PoseConfig()

    exactly_one: ClassVar = (("mesh", "shape"), ("pitch", "voxels_high"))


def empty_box(
    lower: tuple[float, float, float], upper: tuple[float, float, float]
) -> list[Mistake]:
    """The axes along which a box ends before it begins."""
    return [
        (("upper", i), f"{b:g} m is not above the lower corner's {a:g} m")
        for i, (a, b) in enumerate(zip(lower, upper, strict=True))
        if not b > a or math.isnan(b)
    ]
