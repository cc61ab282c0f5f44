"""HTML pages in one file: styles, charts and pictures are embedded, no scripts."""

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..atomic import write_text
from .table import Table
from .templates import STYLE, Html, render


# Markup, a table, or plain text, which becomes a paragraph.
Section = Html | Table | str


def _document(title: str, sections: Sequence[Section]) -> Html:
    """The whole page: a title and its sections."""
    return render(
        "document",
        title=title,
        style=Html(STYLE),
        sections=[_html(section) for section in sections],
    )


def write_page(path: Path, title: str, sections: Sequence[Section]) -> None:
    """Write a page, replacing the file in one step.

    Raises:
        InputError: if the file cannot be written.
    """
    write_text(path, _document(title, sections))


def _html(section: Section) -> Html:
    # Markup is a string too, so it comes first.
    if isinstance(section, Html):
        return section
    return section.html() if isinstance(section, Table) else paragraph(section)


def heading(text: str, level: int = 2, anchor: str = "") -> Html:
    """The heading of a section, which `#anchor` links to if it has one."""
    return render("heading", text=text, level=level, anchor=anchor)


def paragraph(text: str, note: bool = False) -> Html:
    """A paragraph of plain text, in grey if it is a `note`."""
    return render("paragraph", text=text, note=note)


def terms(pairs: Sequence[tuple[str, str]]) -> Html:
    """A list of words and their meanings."""
    return render("terms", pairs=pairs)


def picture(path: Path, alt: str) -> Html:
    """A PNG file, embedded, with a text for readers who cannot see it."""
    return embedded(path.read_bytes(), alt)


def embedded(png: bytes, alt: str) -> Html:
    """The bytes of a PNG, embedded, so that the page is one file."""
    return render("image", alt=alt, data=base64.b64encode(png).decode("ascii"))


def details(title: str, content: Section) -> Html:
    """A section that is folded until the reader opens it."""
    return render("details", title=title, content=_html(content))


def pre(text: str) -> Html:
    """Text with its line breaks, in a fixed-width font."""
    return render("pre", text=text)


class Card(NamedTuple):
    """A framed item of a list, with a picture and a link."""

    title: str
    link: str
    """Address of its page, quoted; empty if it has none."""
    lines: Sequence[str]
    notes: Sequence[str] = ()
    """Further lines, in grey."""
    png: bytes = b""
    """Picture, some 100 pixels wide; empty if it has none."""

    @property
    def picture(self) -> str:
        """The picture as the page embeds it."""
        return base64.b64encode(self.png).decode("ascii")


def cards(items: Sequence[Card]) -> Html:
    """Items in rows that fill the page."""
    return render("cards", cards=items)
