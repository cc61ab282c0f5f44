"""Findings as plain values and bytes of files, and back onto a page."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxthermo.report import page
from jaxthermo.report.chart import chart_svg
from jaxthermo.report.numbers import significant
from jaxthermo.report.table import Cell, Table
from jaxthermo.report.templates import Html

from .exhibit import Finding, Note, Number, Part, Picture, Plot, Row


Plain = dict[str, Any]
Files = dict[str, np.ndarray]
"""Bytes of each file by its name, as an array that a record can keep."""

_NONE = "\N{EN DASH}"


def store(finding: Finding) -> tuple[Plain, Files]:
    """A finding in types that JSON has, and its pictures and charts as files."""
    files: Files = {}
    plain = {
        "verdict": str(finding.verdict),
        "reason": finding.reason,
        "rows": [_plain_row(row) for row in finding.rows],
        "findings": {
            claim: {"verdict": str(verdict), "reason": reason}
            for claim, (verdict, reason) in finding.claims.items()
        },
        "chosen": [list(pair) for pair in finding.chosen],
        "parts": [_plain_part(part, files) for part in finding.parts],
        "numbers": dict(finding.numbers),
    }
    return plain, files


def _plain_row(row: Row) -> Plain:
    return {
        "quantity": row.quantity,
        "thesis": row.thesis,
        "ours": row.ours,
        "note": row.note,
    }


def _plain_part(part: Part, files: Files) -> Plain:
    match part:
        case Picture(name, image, caption):
            stream = io.BytesIO()
            image.save(stream, "PNG", optimize=True)
            files[f"{name}.png"] = np.frombuffer(stream.getvalue(), np.uint8)
            return {"kind": "picture", "file": f"{name}.png", "caption": caption}
        case Plot(name, chart, caption):
            svg = chart_svg(chart).encode("utf-8")
            files[f"{name}.svg"] = np.frombuffer(svg, np.uint8)
            return {"kind": "plot", "file": f"{name}.svg", "caption": caption}
        case Table(columns, rows, title, caption, left):
            cells = [
                [list(c) if isinstance(c, Cell) else c for c in row] for row in rows
            ]
            heads = {"columns": list(columns), "left": list(left)}
            words = {"title": title, "caption": caption}
            return {"kind": "table", **heads, **words, "rows": cells}
        case Note(text):
            return {"kind": "note", "text": text}
    return {"kind": "text", "text": str(part)}


def sections(plain: Plain, files: Files) -> list[page.Section]:
    """The rows and parts of a stored finding, for a page."""
    found: list[page.Section] = []
    if plain["rows"]:
        found.append(_row_table(plain["rows"]))
    if plain["chosen"]:
        found.append(page.terms([(word, text) for word, text in plain["chosen"]]))
    for part in plain["parts"]:
        found += _part_sections(part, files)
    return found


def _row_table(rows: list[Plain]) -> Table:
    lines = [
        [
            Cell(row["quantity"], wraps=True),
            _text(row["thesis"]),
            _text(row["ours"]),
            Cell(row["note"], wraps=True),
        ]
        for row in rows
    ]
    return Table(["quantity", "thesis", "here", ""], lines, left=(0, 3))


def _text(value: Number) -> str:
    if value is None:
        return _NONE
    return value if isinstance(value, str) else significant(value)


def _part_sections(part: Mapping[str, Any], files: Files) -> list[page.Section]:
    match part["kind"]:
        case "picture":
            png = files[part["file"]].tobytes()
            shown = page.embedded(png, part["caption"])
            return [shown, page.paragraph(part["caption"], note=True)]
        case "plot":
            shown = Html(files[part["file"]].tobytes().decode("utf-8"))
            return [shown, page.paragraph(part["caption"], note=True)]
        case "table":
            return _table_sections(part)
        case "note":
            return [page.paragraph(part["text"], note=True)]
    return [part["text"]]


def _table_sections(part: Mapping[str, Any]) -> list[page.Section]:
    # Cells became lists in JSON; plain texts stayed as they are.
    rows = [[c if isinstance(c, str) else Cell(*c) for c in r] for r in part["rows"]]
    shown = Table(part["columns"], rows, left=part["left"])
    above, below = part["title"], part["caption"]
    title = [page.heading(above, level=4)] if above else []
    return [*title, shown, *([page.paragraph(below, note=True)] if below else [])]
