"""Bodies: a mesh or a shape, its voxels, structure, material, temperature and pose."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from ..errors import InputError
from . import units
from .fields import (
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
from .schema_material import BodyMaterial, LabelledConfig, Material
from .schema_place import empty_box
from .schema_pose import AnyPose, PoseConfig
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


class BodyConfig(Model):
    """One body of the scene."""

    mesh: MeshConfig | None = None
    shape: ShapeConfig | None = None
    pitch: PositiveLength | None = None
    voxels_high: Annotated[Whole, Field(ge=1, le=4096)] | None = None
    structure: StructureConfig = FullVolume()
    surface_map: SurfaceMapConfig = FluxCorrectedMap()
    material: BodyMaterial
    regions: tuple[PaintConfig, ...] = ()
    temperature: Temperature
    pose: AnyPose = PoseConfig()

    exactly_one: ClassVar = (("mesh", "shape"), ("pitch", "voxels_high"))

    def mistakes(self) -> list[Mistake]:
        """What a body of several materials cannot have."""
        if not self.regions:
            return []
        if isinstance(self.material, LabelledConfig):
            return [(("regions",), "the labels of `material` say what is where")]
        painted = enumerate(self.regions)
        return [
            *self.material.varying(("material",)),
            *(
                m
                for i, one in painted
                for m in one.material.varying(("regions", i, "material"))
            ),
        ]
