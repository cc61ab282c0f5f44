"""The table of named materials: `materials["stainless_steel"]` gives a `Material`."""

import csv
import difflib
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from .material import DEFAULT_EMISSIVITY, Material


_DATA = Path(__file__).parents[1] / "data"


@dataclass(frozen=True)
class EmissivityRow:
    """The emissivity of one finished surface.

    Attributes:
        surface: material and finish.
        emissivity: eps, total or long-wave infrared [-].
        source: where it comes from.
    """

    surface: str
    emissivity: float
    source: str


@dataclass(frozen=True)
class MaterialRow:
    """One row of the table.

    Attributes:
        name: as the mapping `materials` knows it.
        label: as the data file writes it.
        conductivity: k [W/(m K)].
        density: rho [kg/m^3].
        specific_heat: c_p [J/(kg K)].
        surface: whose emissivity it has; None where none is tabulated.
        bulk_source: where the other numbers come from.
        thesis_density: rho in Table 5.1 of the thesis [kg/m^3], None if not in it.
        thesis_specific_heat: c_p in Table 5.1 of the thesis [J/(kg K)], or None.
        aliases: other names for it.
    """

    name: str
    label: str
    conductivity: float
    density: float
    specific_heat: float
    surface: EmissivityRow | None
    bulk_source: str
    thesis_density: float | None
    thesis_specific_heat: float | None
    aliases: tuple[str, ...]

    @property
    def emissivity(self) -> float:
        """Of its surface [-]; a common value where none is tabulated."""
        return self.surface.emissivity if self.surface else DEFAULT_EMISSIVITY

    @property
    def source(self) -> str:
        """Where all of its numbers come from."""
        origin = "none tabulated, assumed 0.9"
        if self.surface:
            origin = f"of '{self.surface.surface}', {self.surface.source}"
        return f"{self.bulk_source}; emissivity {origin}"

    @property
    def in_thesis(self) -> bool:
        """Whether Table 5.1 of the thesis has it."""
        return self.thesis_density is not None


def _read(file: str, key: str) -> dict[str, dict[str, str]]:
    with (_DATA / file).open(encoding="utf-8", newline="") as lines:
        return {row[key]: row for row in csv.DictReader(lines)}


@functools.cache
def emissivity_rows() -> tuple[EmissivityRow, ...]:
    """Every tabulated surface, in the table's order.

    Source: `jaxthermo/data/README.md`.
    """
    column = "emissivity_total_or_LWIR"
    return tuple(
        EmissivityRow(surface, float(row[column]), row["source"])
        for surface, row in _read("emissivity.csv", "material").items()
    )


@functools.cache
def material_rows() -> tuple[MaterialRow, ...]:
    """Every named material with its numbers and their source, in the table's order.

    Source: `jaxthermo/data/README.md`.
    """
    bulk = _read("materials.csv", "material")
    surfaces = {row.surface: row for row in emissivity_rows()}
    return tuple(
        _row(name, bulk[name["material"]], surfaces.get(name["emissivity_row"]))
        for name in _read("names.csv", "name").values()
    )


def _row(
    name: dict[str, str], bulk: dict[str, str], surface: EmissivityRow | None
) -> MaterialRow:
    thesis = bulk["thesis_rho"]
    return MaterialRow(
        name=name["name"],
        label=bulk["material"],
        conductivity=float(bulk["k_W_mK"]),
        density=float(bulk["rho_kg_m3"]),
        specific_heat=float(bulk["cp_J_kgK"]),
        surface=surface,
        bulk_source=bulk["source"],
        thesis_density=float(thesis) if thesis else None,
        thesis_specific_heat=float(bulk["thesis_cp"]) if thesis else None,
        aliases=tuple(name["aliases"].split()),
    )


__all__ = [
    "DEFAULT_EMISSIVITY",
    "Material",
    "MaterialRow",
    "MaterialTable",
    "find_materials",
    "material_row",
    "material_rows",
    "materials",
    "thesis_material",
]


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


def find_materials(part: str) -> tuple[MaterialRow, ...]:
    """The materials of which a name, or the data file's, has this in it."""
    sought = part.lower()
    return tuple(
        row
        for row in material_rows()
        if any(sought in known.lower() for known in (row.name, row.label, *row.aliases))
    )


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
