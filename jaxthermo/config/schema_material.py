"""Materials: by name, by their properties, both, or several by a file of labels."""

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag

from .fields import Density, Fraction, NotEmpty, refuse
from .found import FoundPath
from .known import material_names
from .model import Location, Mistake, Model
from .schema_varying import AnyConductivity, AnySpecificHeat, PropertyTable
from .show import close_match


def _known_material(name: str) -> str:
    if name not in material_names():
        raise refuse(f"unknown material '{name}'{close_match(name, material_names())}")
    return name


class MaterialConfig(Model):
    """A material by name, by its properties, or by name with some of them changed."""

    name: Annotated[str, AfterValidator(_known_material)] | None = None
    conductivity: AnyConductivity | None = None
    density: Density | None = None
    specific_heat: AnySpecificHeat | None = None
    emissivity: Fraction | None = None
    absorptivity: Fraction | None = None

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> list[Mistake]:
        """Without a name, what a material cannot do without."""
        if data.get("name") is not None:
            return []
        needed = ("conductivity", "density", "specific_heat")
        message = "missing: without a `name` a material has to state it"
        return [((key,), message) for key in needed if data.get(key) is None]

    def varying(self, where: Location) -> list[Mistake]:
        """Tables of temperature, for which a body of several materials has no law."""
        message = "depends on temperature, which only bodies of one material can"
        return [
            ((*where, key), message)
            for key in ("conductivity", "specific_heat")
            if isinstance(getattr(self, key), PropertyTable)
        ]


def _named(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


Material = Annotated[MaterialConfig, BeforeValidator(_named)]


class LabelledConfig(Model):
    """A material for each voxel, by its number in a file."""

    labels: FoundPath
    materials: Annotated[tuple[Material, ...], NotEmpty]

    def mistakes(self) -> list[Mistake]:
        """Tables of temperature."""
        listed = enumerate(self.materials)
        return [m for i, one in listed for m in one.varying(("materials", i))]


def _one_or_several(value: Any) -> str:
    several = isinstance(value, LabelledConfig)
    if isinstance(value, dict):
        several = "labels" in value or "materials" in value
    return "<several>" if several else "<one>"


BodyMaterial = Annotated[
    Annotated[Material, Tag("<one>")] | Annotated[LabelledConfig, Tag("<several>")],
    Discriminator(_one_or_several),
]
