"""Texts of exhibits: sections of `docs/thesis/*.md`, with the numbers of a run.

A section begins with a heading such as `## figure-4.3: title`. The role `number` quotes
a value, such as `figure-4.3:peeled/0~.2f`: the exhibit, the keys on the way to the
value, and a format; that of a truth value has the words for both cases,
`holds~yes/no`. The directive `measured` shows values as a table. The first paragraph is
the reason of the verdict, a paragraph that begins with `C09:` that of a claim, and a
comment such as `% file: caption` stands for a picture. Pages of the documentation show
the same text with the values in `docs/data/thesis`.
"""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from jaxthermo.report import page
from jaxthermo.report.numbers import significant
from jaxthermo.report.table import Cell, Table


_FOLDER = Path(__file__).parents[2] / "docs" / "thesis"
_HEADING = re.compile(r"^## ([\w.-]+): (.+)$", re.MULTILINE)
_NUMBER = re.compile(r"\{number\}`[\w.-]+:([^`]+)`")
_TABLE = re.compile(r"```\{measured\} [\w.-]+:(\S.*)\n```")
_CAPTION = re.compile(r"% (\S+): (.+)", re.DOTALL)
_CLAIM = re.compile(r"(C\d\d): (.+)", re.DOTALL)
_NOTHING = "\N{EN DASH}"
# Longest list that a cell of a table shows.
_MAX_LIST = 4
_UNITS = {
    "W_m2": "W/m²",
    "J_m2": "J/m²",
    "K_s": "K/s",
    "percent": "%",
    "bytes": "bytes",
    "deg": "°",
    "cm2": "cm²",
    "mm": "mm",
    "ms": "ms",
    "m2": "m²",
    "ns": "ns",
    "s": "s",
    "K": "K",
    "C": "°C",
    "J": "J",
    "m": "m",
}


class Statement(NamedTuple):
    """The text of an exhibit, with its numbers."""

    title: str
    reason: str
    """Full sentences: why the verdict is what it is."""
    claims: dict[str, str]
    """Reasons of the verdicts of single claims, by their id."""
    blocks: tuple[page.Section, ...]
    """Everything below the reasons, in the order of the page."""


@cache
def _sections() -> dict[str, tuple[str, str]]:
    """Title and Markdown of each exhibit by its name."""
    sections = {}
    for path in sorted(_FOLDER.glob("*.md")):
        _, *pieces = _HEADING.split(path.read_text(encoding="utf-8"))
        for name, title, body in zip(
            pieces[::3], pieces[1::3], pieces[2::3], strict=True
        ):
            sections[name] = (title, body)
    return sections


def title_of(name: str) -> str:
    """Title of an exhibit."""
    return _sections()[name][0]


def references(name: str) -> tuple[list[str], list[str]]:
    """Values and tables that the text of an exhibit shows, as it names them."""
    _, body = _sections()[name]
    return _NUMBER.findall(body), _TABLE.findall(body)


def quoted(numbers: Mapping[str, Any], reference: str) -> str:
    """The text of the value that a reference such as "peeled/0~.2f" names."""
    path, _, form = reference.partition("~")
    return _shown(_value(numbers, path), form)


def _value(numbers: Any, path: str) -> Any:
    for key in path.split("/"):
        numbers = numbers[int(key)] if isinstance(numbers, list) else numbers[key]
    return numbers


def _shown(value: Any, form: str = "") -> str:
    match value:
        case None:
            return _NOTHING
        case bool():
            return (form or "yes/no").split("/")[not value]
        case str():
            return value
        case list():
            joint = ", " if any(isinstance(item, str) for item in value) else "/"
            return joint.join(_shown(item, form) for item in value) or "none"
        case dict():
            return ", ".join(f"{key} {_shown(v, form)}" for key, v in value.items())
    return format(value, form) if form else significant(value)


def table_of_values(numbers: Mapping[str, Any], path: str) -> Table:
    """A table of a list of rows, of rows by name, or of values by name."""
    value = _value(numbers, path)
    if isinstance(value, dict):
        if not all(isinstance(row, dict) for row in value.values()):
            value = {key: {"value": item} for key, item in value.items()}
        value = [{"": name, **row} for name, row in value.items()]
    rows = [_flat(row) for row in value]
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = [[_cell(row.get(key)) for key in columns] for row in rows]
    words = [
        number
        for number, key in enumerate(columns)
        if any(isinstance(row.get(key), str) for row in rows)
    ]
    return Table(columns=[_heading(key) for key in columns], rows=lines, left=words)


def _flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values of a row and of the rows in it; long lists are left out."""
    values: dict[str, Any] = {}
    for key, value in row.items():
        name = f"{prefix}, {key}" if prefix else key
        if isinstance(value, dict):
            values |= _flat(value, name)
        elif not isinstance(value, list) or len(value) <= _MAX_LIST:
            values[name] = value
    return values


def _heading(key: str) -> str:
    for suffix, unit in _UNITS.items():
        if key.endswith(f"_{suffix}"):
            name = key.removesuffix(f"_{suffix}")
            return f"{name.replace('_', ' ')} [{unit}]"
    return key.replace("_", " ")


def _cell(value: Any) -> str | Cell:
    text = "" if value is None else _shown(value)
    return Cell(text, wraps=True) if isinstance(value, str) else text


def statement(
    name: str, numbers: Mapping[str, Any], pictures: Mapping[str, page.Section]
) -> Statement:
    """The text of an exhibit with the numbers and the pictures of a measurement."""
    title, body = _sections()[name]
    claims: dict[str, str] = {}
    blocks: list[page.Section] = []
    first, *blocks_below = (block.strip() for block in body.strip().split("\n\n"))
    terms: list[tuple[str, str]] = []
    for block in blocks_below:
        if "\n: " in block:
            terms += _terms(block, numbers)
            continue
        if terms:
            blocks.append(page.terms(terms))
            terms = []
        if tabled := _TABLE.fullmatch(block):
            blocks.append(table_of_values(numbers, tabled[1]))
        elif block.startswith("|"):
            blocks.append(_markdown_table(block, numbers))
        elif caption := _CAPTION.fullmatch(block):
            # Not every size of an exhibit has every picture.
            if caption[1] in pictures:
                text = _sentence(caption[2].replace("\n% ", "\n"), numbers)
                blocks.append(pictures[caption[1]])
                blocks.append(page.paragraph(text, note=True))
        elif claim := _CLAIM.fullmatch(block):
            claims[claim[1]] = _sentence(claim[2], numbers)
        else:
            blocks.append(_sentence(block, numbers))
    if terms:
        blocks.append(page.terms(terms))
    return Statement(
        title=title,
        reason=_sentence(first, numbers),
        claims=claims,
        blocks=tuple(blocks),
    )


def _sentence(markdown: str, numbers: Mapping[str, Any]) -> str:
    text = _NUMBER.sub(lambda match: quoted(numbers, match[1]), markdown)
    return " ".join(text.replace("`", "").split())


def _markdown_table(block: str, numbers: Mapping[str, Any]) -> Table:
    lines = [
        [_sentence(cell, numbers) for cell in line.strip("|").split("|")]
        for line in block.splitlines()
    ]
    headings, _, *rows = lines
    cells = [[Cell(text, wraps=True) for text in row] for row in rows]
    return Table(columns=headings, rows=cells, left=range(len(headings)))


def _terms(block: str, numbers: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    pairs = []
    for entry in re.split(r"\n(?!: |  )", block):
        word, meaning = entry.split("\n: ", maxsplit=1)
        pairs.append((word, _sentence(meaning, numbers)))
    return pairs
