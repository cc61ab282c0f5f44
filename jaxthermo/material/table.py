"""Table of named materials with their sources: `materials["copper"]`."""

import csv
import difflib
import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from typing_extensions import override

from ..errors import InputError
from .material import DEFAULT_EMISSIVITY, Material
from .named_table import AbstractNamedTable


_DATA = Path(__file__).parents[1] / "data"


@dataclass(frozen=True)
class EmissivityRow:
    """Radiative properties of one finished surface.

    Attributes:
        surface: name of the finish.
        emissivity: total or long-wave infrared [-].
        source: source of the emissivity.
        absorptivity: of sunlight [-]; None if not tabulated.
        absorptivity_source: source of the absorptivity.
    """

    surface: str
    emissivity: float
    source: str
    absorptivity: float | None
    absorptivity_source: str

    @property
    def sources(self) -> str:
        """Sources of both numbers, as one text."""
        if self.absorptivity is None:
            return self.source
        return f"{self.source}; absorptivity {self.absorptivity_source}"


@dataclass(frozen=True)
class MaterialRow:
    """One row of the table.

    Attributes:
        name: key in `materials`.
        label: name in the data file.
        conductivity: k [W/(m K)].
        density: rho [kg/m^3].
        specific_heat: c_p [J/(kg K)].
        surface: source of the emissivity; None if not tabulated.
        bulk_source: source of the other numbers.
        thesis_density: rho in Table 5.1 of the thesis [kg/m^3], or None.
        thesis_specific_heat: c_p in Table 5.1 of the thesis [J/(kg K)], or None.
        aliases: alternative keys.
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
        """Emissivity of the surface [-]; a common value if not tabulated."""
        return self.surface.emissivity if self.surface else DEFAULT_EMISSIVITY

    @property
    def absorptivity(self) -> float | None:
        """Absorptivity of sunlight of the surface [-]; None if not tabulated."""
        return self.surface.absorptivity if self.surface else None

    @property
    def source(self) -> str:
        """Sources of all numbers, as one text."""
        origin = "none tabulated, assumed 0.9"
        if self.surface:
            origin = f"of '{self.surface.surface}', {self.surface.sources}"
        return f"{self.bulk_source}; emissivity {origin}"

    @property
    def in_thesis(self) -> bool:
        """True if it is in Table 5.1 of the thesis."""
        return self.thesis_density is not None


def _read(file: str, key: str) -> dict[str, dict[str, str]]:
    with (_DATA / file).open(encoding="utf-8", newline="") as lines:
        return {row[key]: row for row in csv.DictReader(lines)}


# Read once, at first use, so that `import` does not wait for the tables.
@functools.cache
def emissivity_rows() -> tuple[EmissivityRow, ...]:
    """All tabulated surfaces, in the order of the data file."""
    column = "emissivity_total_or_LWIR"
    return tuple(
        EmissivityRow(
            surface=surface,
            emissivity=float(row[column]),
            source=row["source"],
            absorptivity=_number_or_none(row["solar_absorptivity"]),
            absorptivity_source=row["absorptivity_source"],
        )
        for surface, row in _read("emissivity.csv", "material").items()
    )


@functools.cache
def material_rows() -> tuple[MaterialRow, ...]:
    """All named materials, in the order of the data file (`data/README.md`)."""
    bulk = _read("materials.csv", "material")
    surfaces = {row.surface: row for row in emissivity_rows()}
    # Bulk properties have no surface finish: the names say which surface is typical.
    names = _read("names.csv", "name").values()
    pairs = [(name, bulk[name["material"]]) for name in names]
    return tuple(
        MaterialRow(
            name=name["name"],
            label=row["material"],
            conductivity=float(row["k_W_mK"]),
            density=float(row["rho_kg_m3"]),
            specific_heat=float(row["cp_J_kgK"]),
            surface=surfaces.get(name["emissivity_row"]),
            bulk_source=row["source"],
            thesis_density=_number_or_none(row["thesis_rho"]),
            thesis_specific_heat=_number_or_none(row["thesis_cp"]),
            aliases=tuple(name["aliases"].split()),
        )
        for name, row in pairs
    )


def _number_or_none(text: str) -> float | None:
    return float(text) if text else None


@functools.cache
def _by_name() -> dict[str, MaterialRow]:
    rows = material_rows()
    return {name: row for row in rows for name in (row.name, *row.aliases)}


def material_row(name: str) -> MaterialRow:
    """Row of a material, by its name or an alias.

    Raises:
        InputError: for an unknown name, with similar names.
    """
    rows = _by_name()
    if name in rows:
        return rows[name]
    hint = ", ".join(similar_names(name, rows) or materials)
    raise InputError(f"material {name!r} is not known: did you mean {hint}?")


def emissivity_row(surface: str) -> EmissivityRow:
    """Row of a finished surface, by its name.

    Raises:
        InputError: for an unknown name, with similar names.
    """
    rows = {row.surface: row for row in emissivity_rows()}
    if surface in rows:
        return rows[surface]
    # Names of finishes have commas in them.
    hint = " or ".join(map(repr, similar_names(surface, rows) or rows))
    raise InputError(f"finish {surface!r} is not known: did you mean {hint}?")


def similar_names(name: object, names: Iterable[str]) -> list[str]:
    """Names that contain a name or are close to it."""
    text = str(name).lower()
    names = list(names)
    close = difflib.get_close_matches(text, names, n=3, cutoff=0.6)
    # Users often type a substring of a name, which has a large edit distance.
    containing = [known for known in names if len(text) > 2 and text in known]
    return list(dict.fromkeys([*containing, *close]))


def find_materials(text: str) -> tuple[MaterialRow, ...]:
    """Materials whose name, alias or label contains `text`."""

    def is_match(row: MaterialRow) -> bool:
        names = (row.name, row.label, *row.aliases)
        return any(text.lower() in name.lower() for name in names)

    return tuple(filter(is_match, material_rows()))


def thesis_material(name: str) -> Material:
    """Material with the density and specific heat of Table 5.1 of the thesis (2010).

    Raises:
        InputError: for a material that is not in Table 5.1.
    """
    row = material_row(name)
    if row.thesis_density is None or row.thesis_specific_heat is None:
        in_thesis = ", ".join(r.name for r in material_rows() if r.in_thesis)
        raise InputError(
            f"material {name!r} is not in Table 5.1: use one of {in_thesis}"
        )
    # The thesis gives no conductivity, hence the table's; its bodies are black.
    return Material(
        conductivity=row.conductivity,
        density=row.thesis_density,
        specific_heat=row.thesis_specific_heat,
        emissivity=1.0,
    )


class _MaterialTable(AbstractNamedTable[Material]):
    """Mapping of names and aliases to `Material`; iterates over names only."""

    def __getitem__(self, name: str) -> Material:
        row = material_row(name)
        return Material(
            conductivity=row.conductivity,
            density=row.density,
            specific_heat=row.specific_heat,
            emissivity=row.emissivity,
            absorptivity=row.absorptivity,
        )

    def __iter__(self) -> Iterator[str]:
        return (row.name for row in material_rows())

    def __len__(self) -> int:
        return len(material_rows())

    @property
    @override
    def known_names(self) -> Mapping[str, object]:
        return _by_name()


materials = _MaterialTable()
