"""`jaxthermo materials`: the tables of materials and of finishes, or parts of them."""

import re

from rich import box
from rich.console import Console
from rich.table import Table

from ..errors import InputError
from ..material.table import (
    EmissivityRow,
    MaterialRow,
    emissivity_rows,
    find_materials,
    material_row,
    material_rows,
    materials as by_name,
)
from .console import open_console, print_line


_COLUMNS = ("k W/(m K)", "rho kg/m^3", "c_p J/(kg K)", "emissivity")

_MARKS = (
    "* in Table 5.1 of the thesis.  ~ no surface tabulated: a common value, which bare "
    "metals are far below.  A name shows one in full, --emissivity surfaces by finish."
)

_BAND = (
    "Total, or long-wave infrared. In other bands it may differ: of black anodized "
    "aluminium it is 0.95 there and 0.67 at short waves."
)


def materials(name: str | None, emissivity: bool) -> None:
    """Print the materials or finishes that match a name; a single material in full.

    Args:
        name: of a material, or a part of it; None for all.
        emissivity: True to print finishes.

    Raises:
        InputError: if none matches.
    """
    if emissivity:
        _print(_finishes(_matching(name)), _BAND)
        return
    rows = find_materials(name) if name else material_rows()
    # For an unknown name `material_row` raises with the names that come close.
    if name and (name in by_name or not rows):
        rows = (material_row(name),)
    if len(rows) == 1:
        _log_all(rows[0])
    else:
        _print(_table(rows), _MARKS)


def _matching(part: str | None) -> tuple[EmissivityRow, ...]:
    found = emissivity_rows()
    if part:
        found = tuple(row for row in found if part.lower() in row.surface.lower())
    if not found:
        raise InputError(
            f"no surface has {part!r} in its name: `jaxthermo materials --emissivity` "
            "lists them"
        )
    return found


def _print(table: Table, note: str) -> None:
    console = Console(highlight=False, markup=False)
    console.print(table)
    print_line(open_console(), note)


def _log_all(row: MaterialRow) -> None:
    console = open_console()
    print_line(console, f"{row.name} ({row.label})")
    for label, number in zip(_COLUMNS, _numbers(row), strict=True):
        print_line(console, f"  {label:13} {number}")
    if row.in_thesis:
        density, heat = row.thesis_density, row.thesis_specific_heat
        print_line(
            console, f"  thesis        rho {density:g}, c_p {heat:g} (Table 5.1)"
        )
    if row.aliases:
        print_line(console, f"  also          {', '.join(row.aliases)}")
    print_line(console, f"  source        {row.source}")


def _table(rows: tuple[MaterialRow, ...]) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    names = [row.name + " *" * row.in_thesis for row in rows]
    table.add_column("name", min_width=max(map(len, names)))
    for column in (*_COLUMNS[:3], "eps [-]"):
        # The unit below the symbol: all fits into 80 characters.
        head = column.replace(" ", "\n", 1)
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("source")
    for marked, row in zip(names, rows, strict=True):
        *numbers, emissivity = _numbers(row)
        assumed = "" if row.surface else "~"
        short = _short(row.bulk_source)
        table.add_row(marked, *numbers, assumed + emissivity, short)
    return table


def _finishes(rows: tuple[EmissivityRow, ...]) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    table.add_column("surface", no_wrap=True)
    table.add_column("emissivity", justify="right")
    table.add_column("source")
    for row in rows:
        table.add_row(row.surface, f"{row.emissivity:g}", row.source)
    return table


def _numbers(row: MaterialRow) -> tuple[str, ...]:
    values = (row.conductivity, row.density, row.specific_heat, row.emissivity)
    return tuple(f"{value:g}" for value in values)


def _short(source: str) -> str:
    """Source of the numbers, without how they were derived from it."""
    return re.split(r" / | via | \(|, not | @", source)[0]
