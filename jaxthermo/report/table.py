"""One table for the terminal (rich) and for a page (HTML)."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rich import box
from rich.table import Table as RichTable
from rich.text import Text

from .templates import Html, render


# Longest text of a first column that is never folded [characters]: half a terminal.
_MAX_NAME_WIDTH = 40


class Cell(NamedTuple):
    """Text of a table cell that is more than plain."""

    text: str
    met: bool | None = None
    """Result of a check: green if True, red if False, plain if None."""
    wraps: bool = False
    """True to break long lines, as in prose; otherwise the cell stays on one line."""
    columns: int = 1
    """Number of columns that the cell spans."""
    is_number: bool = False
    """True to align right on a page, as numbers do."""
    is_heading: bool = False
    """True for the heading of the rows below."""
    links: bool = False
    """True if each line is the anchor of a heading on the page, to be linked."""

    @property
    def html_class(self) -> str:
        """Classes of the page's style sheet."""
        mark = {True: " met", False: " missed", None: ""}[self.met]
        side = "" if self.is_number else "words" if self.wraps else "left"
        heading = " heading" if self.is_heading else ""
        return (side + mark + heading).strip()

    @property
    def rich_text(self) -> Text:
        """The text with its colour on a terminal."""
        # Bold as well: red and green are one colour to some readers.
        style = {True: "green", False: "bold red", None: ""}[self.met]
        return Text(self.text, f"{style} bold" if self.is_heading else style)


def prose(*lines: str) -> Cell:
    """A cell of sentences, each on a line of its own."""
    return Cell("\n".join(lines), wraps=True)


@dataclass(frozen=True)
class Table:
    """Rows of text under their headings."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    title: str = ""
    """Title on a terminal; a page has a heading above the table instead."""
    caption: str = ""
    """Text below the table on a terminal."""
    left: Collection[int] = (0,)
    """Indices of the columns that are aligned left; numbers align right."""
    framed: bool = True
    """True for a frame on a terminal, False for a line under the headings only."""

    def rich(self) -> RichTable:
        """The table for a rich console."""
        table = RichTable(
            title=Text(self.title) if self.title else None,
            title_justify="left",
            caption=Text(self.caption) if self.caption else None,
            box=box.HEAVY_HEAD if self.framed else box.SIMPLE,
            pad_edge=self.framed,
        )
        for index, name in enumerate(self.columns):
            justify = "left" if index in self.left else "right"
            # Numbers, and names in the first column, are not folded: a folded number
            # reads as two. Long texts are folded where they do not fit.
            cells = [row[index] for row in self.rows if index < len(row)]
            texts = [cell.text if isinstance(cell, Cell) else cell for cell in cells]
            name_width = max(map(len, texts), default=0)
            is_name = index == 0 and name_width <= _MAX_NAME_WIDTH
            unfolded = justify == "right" or is_name
            table.add_column(
                Text(name), justify=justify, no_wrap=unfolded, overflow="fold"
            )
        for row in self.rows:
            # Text may contain square brackets, which a console may read as markup.
            formatted = [cell if isinstance(cell, Cell) else Cell(cell) for cell in row]
            table.add_row(*(cell.rich_text for cell in formatted))
        return table

    def html(self) -> Html:
        """The table for a page; all text is escaped."""
        rows = [
            [_as_cell(cell, index in self.left) for index, cell in enumerate(row)]
            for row in self.rows
        ]
        return render("table", table=self, rows=rows)


class _Number(NamedTuple):
    """A cell of plain text, as the template reads it."""

    text: str
    html_class: str
    columns: int = 1
    links: bool = False


def _as_cell(cell: str | Cell, left: bool) -> Cell | _Number:
    return cell if isinstance(cell, Cell) else _Number(cell, "left" if left else "")
