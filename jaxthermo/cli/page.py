"""Pieces of an HTML page that needs nothing but itself."""

import base64
import html
from pathlib import Path


STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #20242c; margin: 2rem auto;
  max-width: 1240px; padding: 0 1.2rem; background: #fff; }
h1 { font-size: 1.6rem; margin-bottom: .3rem; } h2 { margin-top: 2.6rem; }
p, li { max-width: 60rem; } .note { color: #5a606c; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums;
  font-size: 13px; margin: 1rem 0; }
th, td { padding: .28rem .6rem; text-align: right; white-space: nowrap;
  border-bottom: 1px solid #e2e5ea; }
th { font-weight: 600; border-bottom: 2px solid #c8ccd4; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
td.left, th.left { text-align: left; }
td.words { white-space: normal; text-align: left; min-width: 14rem; }
.wide { overflow-x: auto; }
.met { color: #1b7a4a; } .missed { color: #b3261e; font-weight: 600; }
img, svg { max-width: 100%; height: auto; display: block; margin: 1rem 0; }
pre { background: #f4f5f7; padding: 1rem; overflow-x: auto; font-size: 12px; }
summary { cursor: pointer; margin: 1rem 0; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1.2rem;
  max-width: 60rem; font-size: 14px; color: #5a606c; }
dt { font-weight: 600; } dd { margin: 0; }
"""


class Cell(str):
    """A table cell as HTML."""


def document(title: str, sections: list[str]) -> str:
    """The whole page."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head>\n<body>"
        f"<h1>{html.escape(title)}</h1>\n" + "\n".join(sections) + "\n</body></html>\n"
    )


def heading(text: str) -> str:
    """Of a section."""
    return f"<h2>{html.escape(text)}</h2>"


def paragraph(text: str, note: bool = False) -> str:
    """Plain text."""
    return f"<p{' class=note' if note else ''}>{html.escape(text)}</p>"


def terms(pairs: list[tuple[str, str]]) -> str:
    """Words and what they mean."""
    lines = (f"<dt>{html.escape(a)}</dt><dd>{html.escape(b)}</dd>" for a, b in pairs)
    return "<dl>" + "\n".join(lines) + "</dl>"


def table(columns: list[str], rows: list[list[str]], left: bool = False) -> str:
    """Rows of text, or of cells that are made already."""
    cell = lambda t: t if isinstance(t, Cell) else f"<td>{html.escape(t)}</td>"
    align = ' class="left"' if left else ""
    head = "".join(f"<th{align}>{html.escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>\n" for row in rows)
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>"
    )


def marked(text: str, met: bool | None = None) -> Cell:
    """A cell in green, red, or plain."""
    kind = {True: "met", False: "missed", None: ""}[met]
    return Cell(f'<td class="left {kind}">{html.escape(text)}</td>')


def verdicts(texts: list[tuple[str, bool]]) -> Cell:
    """A cell of what was met and what was not, a line each."""
    kinds = (("missed", "\N{BALLOT X}"), ("met", "\N{CHECK MARK}"))
    lines = (
        f'<span class="{kinds[met][0]}">{kinds[met][1]} {html.escape(text)}</span>'
        for text, met in texts
    )
    return Cell(f'<td class="left">{"<br>".join(lines)}</td>')


def prose(texts: list[str]) -> Cell:
    """A cell of sentences, a line each."""
    return Cell(f'<td class="words">{"<br>".join(map(html.escape, texts))}</td>')


def picture(path: Path, words: str) -> str:
    """A PNG within the page."""
    return embedded(path.read_bytes(), words)


def embedded(png: bytes, words: str) -> str:
    """The bytes of a PNG within the page."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{html.escape(words)}" src="data:image/png;base64,{data}">'


def details(title: str, content: str) -> str:
    """What is folded away at first."""
    return f"<details><summary>{html.escape(title)}</summary>\n{content}</details>"


def pre(text: str) -> str:
    """Text as it is."""
    return f"<pre>{html.escape(text)}</pre>"


def spanning(text: str, columns: int) -> Cell:
    """A cell over the rest of a row."""
    return Cell(f'<td class="words" colspan="{columns}">{html.escape(text)}</td>')
