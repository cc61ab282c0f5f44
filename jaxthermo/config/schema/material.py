"""Materials: by name, by their properties, both, or several by labels or parts."""

import csv
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag
from typing_extensions import override

import jaxthermo

from ..messages import close_match
from ..types.files import FoundPath, read_labels
from ..types.model import Mistake, Model, Short, build
from ..types.quantities import Density, Fraction, NotEmpty, refuse
from ..types.varying import AnyConductivity, AnySpecificHeat


_TABLE = Path(__file__).parents[2] / "data" / "names.csv"


@cache
def _material_names() -> tuple[str, ...]:
    # Of the data file: `jaxthermo.materials` has the same names, and imports JAX.
    rows = [*csv.DictReader(_TABLE.read_text(encoding="utf-8").splitlines())]
    return tuple(name for r in rows for name in (r["name"], *r["aliases"].split()))


def _known_material(name: str) -> str:
    names = _material_names()
    if name not in names:
        raise refuse(f"unknown material '{name}'{close_match(name, names)}")
    return name


class _MaterialConfig(Model, builds="Material"):
    """A material by name, by its properties, or by name with some of them changed."""

    name: (
        Annotated[
            str,
            AfterValidator(_known_material),
            Field(json_schema_extra={"enum": [*_material_names()]}),
        ]
        | None
    ) = None
    conductivity: AnyConductivity | None = None
    density: Density | None = None
    specific_heat: AnySpecificHeat | None = None
    emissivity: Fraction | None = None
    absorptivity: Fraction | None = None

    def arguments(self) -> dict[str, Any]:
        given = super().arguments()
        name = given.pop("name", None)
        if name is None:
            return given
        named = jaxthermo.materials[name]
        keys = ("conductivity", "density", "specific_heat", "emissivity")
        # As given: an absorptivity that is left open follows a changed emissivity.
        table = {"absorptivity": named.given_absorptivity}
        return table | {key: getattr(named, key) for key in keys} | given

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> list[Mistake]:
        if data.get("name") is not None:
            return []
        needed = ("conductivity", "density", "specific_heat")
        message = "missing: without a `name` a material has to state it"
        return [((key,), message) for key in needed if data.get(key) is None]


Material = Annotated[_MaterialConfig, Short("name", words=_material_names())]


class LabelledConfig(Model, builds="MaterialLabels"):
    """A material for each voxel, by its number in a file."""

    labels: FoundPath
    materials: Annotated[tuple[Material, ...], NotEmpty]

    @override
    def build(self, *args: Any) -> Any:
        return self.target()(read_labels(self.labels), build(self.materials))


class PartsConfig(Model):
    """A material for each named part of a mesh file."""

    parts: Annotated[dict[str, Material], NotEmpty]
    """By the node of a GLB or the group of an OBJ; `"*"` for all others."""

    def build(self, *args: Any) -> Any:
        """The material of each voxel, for a voxel grid and the parts of its mesh."""
        grid, parts = args
        given = {name: material.build() for name, material in self.parts.items()}
        return jaxthermo.materials_by_part(grid, parts, given)


def _one_or_several(value: Any) -> str:
    keys = set(value) if isinstance(value, dict) else set()
    if isinstance(value, PartsConfig) or "parts" in keys:
        return "<parts>"
    several = isinstance(value, LabelledConfig) or keys & {"labels", "materials"}
    return "<several>" if several else "<one>"


BodyMaterial = Annotated[
    Annotated[Material, Tag("<one>")]
    | Annotated[LabelledConfig, Tag("<several>")]
    | Annotated[PartsConfig, Tag("<parts>")],
    Discriminator(_one_or_several),
]
