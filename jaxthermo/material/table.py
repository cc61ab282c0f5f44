"""The table of named materials: `materials["stainless_steel"]` gives a `Material`."""

import difflib
import functools
from collections.abc import Iterator, Mapping

from ..errors import InputError
from .data import MaterialRow, material_rows
from .material import DEFAULT_EMISSIVITY, Material


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
