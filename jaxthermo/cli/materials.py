"""`jaxthermo materials`: the tables of materials, stacks and finishes, or some rows."""

import re

from rich.console import Console

from ..console.terminal import open_console, print_line
from ..errors import InputError
from ..material.stacks import LayerRow, stack_rows
from ..material.table import (
    EmissivityRow,
    MaterialRow,
    emissivity_rows,
    find_materials,
    material_row,
    material_rows,
    materials as by_name,
)
from ..report.table import Table


_COLUMNS = ("k W/(m K)", "rho kg/m^3", "c_p J/(kg K)", "emissivity")
_FINISH_COLUMNS = ("surface", "emissivity", "solar\nabsorptivity", "source")

_MARKS = (
    "* in Table 5.1 of the thesis.  ~ no surface tabulated: a common value, which bare "
    "metals are far below.  A name shows one in full, --emissivity surfaces by finish."
)

_BAND = (
    "Emissivities are total, or long-wave infrared. In other bands they may differ: of "
    "black anodized aluminium it is 0.95 there and 0.67 at short waves. Where there is "
    "no solar absorptivity, the emissivity stands for it."
)


def materials(name: str | None, emissivity: bool) -> None:
    """Print the materials and stacks, or the finishes, that match a name.

    A single material is printed in full.

    Args:
        name: of a material, in full or in part; None for all.
        emissivity: True to print finishes.

    Raises:
        InputError: if no name matches.
    """
    console = open_console()
    if emissivity:
        finishes = [
            (
                row.surface,
                f"{row.emissivity:g}",
                _optional_number(row.absorptivity),
                row.sources,
            )
            for row in _matching(name)
        ]
        table = Table(_FINISH_COLUMNS, finishes, left=(0, 3), framed=False)
        console.print(table.rich())
        print_line(console, _BAND)
        return
    rows = find_materials(name) if name else material_rows()
    stacks = [
        layers
        for stack, layers in stack_rows().items()
        if name is None or name.lower() in stack
    ]
    # For an unknown name `material_row` raises with the names that come close.
    if name and (name in by_name or not (rows or stacks)):
        rows = (material_row(name),)
    if len(rows) == 1:
        _print_row(console, rows[0])
    elif rows:
        console.print(_table(rows).rich())
    if stacks:
        console.print(_stack_table(stacks).rich())
    if len(rows) > 1:
        print_line(console, _MARKS)


# Finishes have long names: a part of one is enough.
def _matching(name: str | None) -> tuple[EmissivityRow, ...]:
    rows = emissivity_rows()
    if name:
        rows = tuple(row for row in rows if name.lower() in row.surface.lower())
    if not rows:
        raise InputError(
            f"no surface has {name!r} in its name: `jaxthermo materials --emissivity` "
            "lists them"
        )
    return rows


def _print_row(console: Console, row: MaterialRow) -> None:
    print_line(console, f"{row.name} ({row.label})")
    for label, number in zip(_COLUMNS, _numbers(row), strict=True):
        print_line(console, f"  {label:13} {number}")
    if row.absorptivity is not None:
        print_line(console, f"  absorptivity  {row.absorptivity:g} (of sunlight)")
    if row.in_thesis:
        print_line(
            console,
            f"  thesis        rho {row.thesis_density:g}, "
            f"c_p {row.thesis_specific_heat:g} (Table 5.1)",
        )
    if row.aliases:
        print_line(console, f"  also          {', '.join(row.aliases)}")
    print_line(console, f"  source        {row.source}")


def _table(rows: tuple[MaterialRow, ...]) -> Table:
    # The unit below the symbol: all fits into 80 characters.
    heads = [head.replace(" ", "\n", 1) for head in (*_COLUMNS[:3], "eps [-]")]
    lines = []
    for row in rows:
        *numbers, emissivity = _numbers(row)
        assumed = "" if row.surface else "~"
        # The source alone, without the derivation of the numbers.
        source = re.split(r" / | via | \(|, not | @", row.bulk_source)[0]
        name = row.name + " *" * row.in_thesis
        lines.append((name, *numbers, assumed + emissivity, source))
    return Table(("name", *heads, "source"), lines, left=(0, 5), framed=False)


def _stack_table(stacks: list[tuple[LayerRow, ...]]) -> Table:
    lines = [
        (
            layer.stack if number == 0 else "",
            layer.material,
            f"{layer.thickness:g}",
            layer.source.split(" (")[0],
        )
        for layers in stacks
        for number, layer in enumerate(layers)
    ]
    heads = ("stack", "layers, from the front", "m", "what it is")
    return Table(heads, lines, left=(0, 1, 3), framed=False)


def _optional_number(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def _numbers(row: MaterialRow) -> tuple[str, ...]:
    values = (row.conductivity, row.density, row.specific_heat, row.emissivity)
    return tuple(f"{value:g}" for value in values)
