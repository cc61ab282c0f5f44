"""The table of named materials: `materials["stainless_steel"]` gives a `Material`."""

import csv
import difflib
import functools
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from .errors import InputError
from .material import DEFAULT_EMISSIVITY, Material


__all__ = [
    "DEFAULT_EMISSIVITY",
    "Material",
    "MaterialRow",
    "MaterialTable",
    "material_row",
    "material_rows",
    "materials",
    "thesis_material",
]

_DATA = Path(__file__).with_name("data")


@dataclass(frozen=True)
class MaterialRow:
    """One row of the table.

    Attributes:
        name: as the mapping `materials` knows it.
        label: as the data file writes it.
        conductivity: k [W/(m K)].
        density: rho [kg/m^3].
        specific_heat: c_p [J/(kg K)].
        emissivity: eps [-].
        source: where the numbers come from.
        thesis_density: rho in Table 5.1 of the thesis [kg/m^3], None if not in it.
        thesis_specific_heat: c_p in Table 5.1 of the thesis [J/(kg K)], or None.
        aliases: other names for it.
    """

    name: str
    label: str
    conductivity: float
    density: float
    specific_heat: float
    emissivity: float
    source: str
    thesis_density: float | None
    thesis_specific_heat: float | None
    aliases: tuple[str, ...]

    @property
    def in_thesis(self) -> bool:
        """Whether Table 5.1 of the thesis has it."""
        return self.thesis_density is not None


def _read(file: str, key: str) -> dict[str, dict[str, str]]:
    with (_DATA / file).open(encoding="utf-8", newline="") as lines:
        return {row[key]: row for row in csv.DictReader(lines)}


def _row(name: dict[str, str], bulk: dict[str, str], surface) -> MaterialRow:
    if surface is None:
        emissivity, origin = DEFAULT_EMISSIVITY, "none tabulated, assumed 0.9"
    else:
        emissivity = float(surface["emissivity_total_or_LWIR"])
        origin = f"of '{surface['material']}', {surface['source']}"
    thesis = bulk["thesis_rho"]
    return MaterialRow(
        name=name["name"],
        label=bulk["material"],
        conductivity=float(bulk["k_W_mK"]),
        density=float(bulk["rho_kg_m3"]),
        specific_heat=float(bulk["cp_J_kgK"]),
        emissivity=emissivity,
        source=f"{bulk['source']}; emissivity {origin}",
        thesis_density=float(thesis) if thesis else None,
        thesis_specific_heat=float(bulk["thesis_cp"]) if thesis else None,
        aliases=tuple(name["aliases"].split()),
    )


@functools.cache
def material_rows() -> tuple[MaterialRow, ...]:
    """Every named material with its numbers and their source, in the table's order.

    Source: `jaxthermo/data/README.md`.
    """
    bulk = _read("materials.csv", "material")
    surface = _read("emissivity.csv", "material")
    return tuple(
        _row(name, bulk[name["material"]], surface.get(name["emissivity_row"]))
        for name in _read("names.csv", "name").values()
    )


@functools.cache
def _by_name() -> dict[str, MaterialRow]:
    rows = material_rows()
    return {name: row for row in rows for name in (row.name, *row.aliases)}


def material_row(name: str) -> MaterialRow:
    """The row of a material, by its name or an alias.

    Raises:
        InputError: for an unknown name, with the names that come close.
    """
    known = _by_name()
    if name in known:
        return known[name]
    close = difflib.get_close_matches(str(name).lower(), known, n=3, cutoff=0.6)
    # A part of a name is not close by edits, yet it is what one types first.
    parts = [k for k in known if len(str(name)) > 2 and str(name).lower() in k]
    hint = ", ".join(dict.fromkeys([*parts, *close])) or ", ".join(materials)
    raise InputError(f"material {name!r} is not known: did you mean {hint}?")


def thesis_material(name: str) -> Material:
    """A material of Table 5.1 with the thesis' density and specific heat.

    The thesis gives no conductivity, so that is the table's; it lets the body absorb
    everything, so the emissivity is 1.

    Source: thesis (2010), Table 5.1.

    Raises:
        InputError: for a material that is not in Table 5.1.
    """
    row = material_row(name)
    if row.thesis_density is None or row.thesis_specific_heat is None:
        known = ", ".join(r.name for r in material_rows() if r.in_thesis)
        raise InputError(f"material {name!r} is not in Table 5.1: use one of {known}")
    return Material(row.conductivity, row.thesis_density, row.thesis_specific_heat, 1.0)


class MaterialTable(Mapping[str, Material]):
    """The named materials: `materials["copper"]`. Iterates over names, not aliases."""

    def __getitem__(self, name: str) -> Material:
        row = material_row(name)
        return Material(
            row.conductivity, row.density, row.specific_heat, row.emissivity
        )

    def __iter__(self) -> Iterator[str]:
        return (row.name for row in material_rows())

    def __len__(self) -> int:
        return len(material_rows())

    def __contains__(self, name: object) -> bool:
        return name in _by_name()

    def get(self, key: str, default=None):
        """The material, or `default` for an unknown name."""
        # The inherited one waits for a KeyError, which an InputError is not.
        try:
            return self[key]
        except InputError:
            return default

    def __repr__(self) -> str:
        return f"MaterialTable({', '.join(self)})"


materials = MaterialTable()
"""The named materials."""


class _SubscriptableModule(ModuleType):
    """Lets the module stand in for its mapping.

    Once anything imports this module, Python binds `jaxthermo.materials` to it, in
    place of the mapping of that name which the package would give.
    """

    def __getitem__(self, name: str) -> Material:
        return materials[name]

    def __iter__(self) -> Iterator[str]:
        return iter(materials)

    def __len__(self) -> int:
        return len(materials)

    def __contains__(self, name: object) -> bool:
        return name in materials


sys.modules[__name__].__class__ = _SubscriptableModule
