"""`jaxthermo materials`: the table of named materials, or one of them in full."""

from rich import box
from rich.console import Console
from rich.table import Table

from ..materials import MaterialRow, material_row, material_rows


_COLUMNS = ("k W/(m K)", "rho kg/m^3", "c_p J/(kg K)", "emissivity")


def materials(name: str | None) -> None:
    """Prints all materials, or one with its other names and the source."""
    console = Console(highlight=False, soft_wrap=name is not None)
    if name is None:
        console.print(_table())
        return
    row = material_row(name)
    console.print(f"{row.name} ({row.label})", markup=False)
    for label, number in zip(_COLUMNS, _numbers(row), strict=True):
        console.print(f"  {label:13} {number}", markup=False)
    if row.aliases:
        console.print(f"  also          {', '.join(row.aliases)}", markup=False)
    console.print(f"  source        {row.source}", markup=False)


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
