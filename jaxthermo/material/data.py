"""The data behind the named materials, row by row, each with its source."""

import csv
import functools
from dataclasses import dataclass
from pathlib import Path

from .material import DEFAULT_EMISSIVITY


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
