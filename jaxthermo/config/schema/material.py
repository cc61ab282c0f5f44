"""Materials: by name, by their properties, both, or several by labels or parts."""

import csv
from collections.abc import Callable, Mapping
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


_DATA = Path(__file__).parents[2] / "data"


@cache
def material_names() -> tuple[str, ...]:
    """Names and aliases of the tabulated materials, without importing JAX."""
    # From the data file: `jaxthermo.materials` has the same names, but imports JAX.
    names: list[str] = []
    for row in data_rows("names.csv"):
        names += [row["name"], *row["aliases"].split()]
    return tuple(names)


@cache
def finish_names() -> tuple[str, ...]:
    """Names of the tabulated finishes, without importing JAX."""
    return tuple(row["material"] for row in data_rows("emissivity.csv"))


def data_rows(file: str) -> list[dict[str, str]]:
    """Rows of a file of the package's data, without importing JAX."""
    text = (_DATA / file).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


def one_of(kind: str, names: Callable[[], tuple[str, ...]]) -> AfterValidator:
    """Validator of a name of a kind of thing, which refuses unknown ones."""

    def known(name: str) -> str:
        if name not in names():
            raise refuse(f"unknown {kind} '{name}'{close_match(name, names())}")
        return name

    return AfterValidator(known)


FinishName = Annotated[
    str,
    one_of("finish", finish_names),
    Field(json_schema_extra={"enum": [*finish_names()]}),
]


class _MaterialConfig(Model, builds="Material"):
    """A material by name, by its properties, or by name with some of them changed."""

    name: (
        Annotated[
            str,
            one_of("material", material_names),
            Field(json_schema_extra={"enum": [*material_names()]}),
        ]
        | None
    ) = None
    conductivity: AnyConductivity | None = None
    density: Density | None = None
    specific_heat: AnySpecificHeat | None = None
    emissivity: Fraction | None = None
    absorptivity: Fraction | None = None

    def arguments(self) -> dict[str, Any]:
        arguments = super().arguments()
        name = arguments.pop("name", None)
        if name is None:
            return arguments
        named = jaxthermo.materials[name]
        keys = ("conductivity", "density", "specific_heat", "emissivity")
        # An absorptivity that the table leaves open follows a changed emissivity.
        table = {"absorptivity": named.given_absorptivity}
        return table | {key: getattr(named, key) for key in keys} | arguments

    @classmethod
    def raw_mistakes(cls, data: Mapping[str, object]) -> list[Mistake]:
        if data.get("name") is not None:
            return []
        needed = ("conductivity", "density", "specific_heat")
        message = "missing: without a `name` a material has to state it"
        return [((key,), message) for key in needed if data.get(key) is None]


Material = Annotated[_MaterialConfig, Short("name", words=material_names())]


class LabelledConfig(Model, builds="MaterialLabels"):
    """A material for each voxel, by its number in a file."""

    labels: FoundPath
    materials: Annotated[tuple[Material, ...], NotEmpty]

    @override
    def build(self, *args: Any) -> Any:
        return self.target()(read_labels(self.labels), build(self.materials))


class PartsConfig(Model):
    """A material for each named part of a mesh file; `jaxthermo parts` lists them."""

    parts: Annotated[dict[str, Material], NotEmpty]
    """Material by node/mesh/material, or by a pattern without / that matches one of
    the three; `"*"` for all others."""

    def build(self, *args: Any) -> Any:
        """The material of each voxel, for a grid and the parts of its mesh."""
        grid, mesh_parts = args
        materials = {name: material.build() for name, material in self.parts.items()}
        return jaxthermo.materials_by_part(grid, mesh_parts, materials)


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
