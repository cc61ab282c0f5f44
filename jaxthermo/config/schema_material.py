"""Materials: by name, by their properties, or by name with some of them changed."""

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator

from .fields import Conductivity, Density, Fraction, SpecificHeat, refuse
from .known import material_names
from .model import Mistake, Model
from .show import close_match


def _known_material(name: str) -> str:
    if name not in material_names():
        raise refuse(f"unknown material '{name}'{close_match(name, material_names())}")
    return name


class MaterialConfig(Model):
    """A material by name, by its properties, or by name with some of them changed."""

    name: Annotated[str, AfterValidator(_known_material)] | None = None
    conductivity: Conductivity | None = None
    density: Density | None = None
    specific_heat: SpecificHeat | None = None
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


def _named(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


Material = Annotated[MaterialConfig, BeforeValidator(_named)]
