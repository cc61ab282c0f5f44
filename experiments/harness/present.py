"""Tables, pages and pictures, as every experiment shows them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from jaxthermo.choices import Palette
from jaxthermo.console.terminal import open_console
from jaxthermo.image.colour.palette import apply_palette
from jaxthermo.report import page
from jaxthermo.report.difference_scale import (
    BACKGROUND,
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.sheet import Tile, colour_bar, sheet
from jaxthermo.report.table import Cell, Table


Rows = list[dict[str, Any]]
"""Rows of a result, in types that JSON has."""

Column = tuple[str, str | Callable[[Any], str | Cell]]
"""Heading, and a format string of a row's values or a function of the row."""


def table_of(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[Column],
    title: str = "",
    caption: str = "",
    names: int = 1,
    **style: Any,
) -> Table:
    """A table with a line for each row of a result, which is a mapping.

    A row that was refused shows its first `names` columns, and its reason instead of
    the others.
    """
    headings, formats = zip(*columns, strict=True)
    lines = []
    for row in rows:
        used = formats[:names] if "refused" in row else formats
        line = [
            form.format_map(row) if isinstance(form, str) else form(row)
            for form in used
        ]
        if "refused" in row:
            width = len(formats) - names
            line.append(Cell(row["refused"], wraps=True, columns=width))
        lines.append(line)
    return Table(columns=headings, rows=lines, title=title, caption=caption, **style)


def from_to(values: Iterable[float], form: str) -> str:
    """Smallest and largest value in a format, or the one where they read alike."""
    numbers = list(values)
    ends = dict.fromkeys(format(end, form) for end in (min(numbers), max(numbers)))
    return " to ".join(ends)


def show(*sections: page.Section) -> None:
    """Print the tables among the sections of a page."""
    console = open_console()
    for section in sections:
        if isinstance(section, Table):
            console.print(section.rich())


def publish(folder: Path, title: str, sections: Sequence[page.Section]) -> None:
    """Print the tables of a page and write it as `report.html`."""
    show(*sections)
    page.write_page(folder / "report.html", title, sections)


class Shot(NamedTuple):
    """A picture of a body whose values a sheet shows in colours."""

    values: Float[np.ndarray, "h w"]
    body: Bool[np.ndarray, "h w"]
    """True where it shows the body; the sheet is dark elsewhere."""
    name: str
    note: str = ""


def thermal_sheet(
    shots: Sequence[Shot],
    limits: tuple[float, float],
    *,
    scale: str,
    title: str,
    palette: Palette = "iron",
    columns: int | None = None,
) -> Image.Image:
    """Pictures in false colours under one title, with their scale below them.

    Args:
        shots: from left to right.
        limits: ends of the scale.
        scale: its quantity and unit.
        title: of the sheet.
        palette: name of the colours.
        columns: pictures in a row; up to six if None.
    """
    tiles = []
    for shot in shots:
        colours = apply_palette(shot.values, *limits, palette)
        colours[~shot.body] = BACKGROUND
        tiles.append(Tile(colours, shot.name, shot.note))
    return sheet(tiles, colour_bar(*limits, scale, palette), title, columns)


def difference_sheet(
    shots: Sequence[Shot],
    largest: float,
    *,
    scale: str,
    title: str,
    columns: int | None = None,
) -> Image.Image:
    """Differences in blue and red on one scale, which ends near the largest."""
    colours = DifferenceScale(nice_limit(largest))
    tiles = [
        Tile(colours.picture(shot.values, shot.body), shot.name, shot.note)
        for shot in shots
    ]
    return sheet(tiles, difference_bar(colours, scale), title, columns)
