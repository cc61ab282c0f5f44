"""`jaxthermo materials`: the table of named materials, or one of them in full."""

from rich import box
from rich.console import Console
from rich.table import Table

from ..materials import MaterialRow, material_row, material_rows
from .console import open_console, tell


_COLUMNS = ("k W/(m K)", "rho kg/m^3", "c_p J/(kg K)", "emissivity")


def materials(name: str | None) -> None:
    """Prints all materials, or one with its other names and the source."""
    if name is None:
        Console(highlight=False).print(_table())
        return
    console, row = open_console(), material_row(name)
    tell(console, f"{row.name} ({row.label})")
    for label, number in zip(_COLUMNS, _numbers(row), strict=True):
        tell(console, f"  {label:13} {number}")
    if row.aliases:
        tell(console, f"  also          {', '.join(row.aliases)}")
    tell(console, f"  source        {row.source}")


def _table() -> Table:
    table = Table(box=box.SIMPLE)
    table.add_column("name", no_wrap=True)
    for column in _COLUMNS:
        table.add_column(column, justify="right")
    for row in material_rows():
        table.add_row(row.name, *_numbers(row))
    return table


def _numbers(row: MaterialRow) -> tuple[str, ...]:
    values = (row.conductivity, row.density, row.specific_heat, row.emissivity)
    return tuple(f"{value:g}" for value in values)
