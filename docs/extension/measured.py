"""Numbers of `docs/data`: a role for one, a directive for a table.

A file of `docs/data` names the command that made it and the machine, and has `values`,
each a text with its unit, and `tables` with `columns` and `rows`. A value with a
command or machine of its own is a mapping with `text`. Pages show a value by the role
`number` and a table by the directive `measured`, both with `file:name`; a name that is
not there is an error.
"""

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole


DATA = Path(__file__).resolve().parents[1] / "data"


class Source(NamedTuple):
    """What made a number, and where."""

    command: str
    machine: str


def load(name: str) -> dict[str, Any]:
    """One file of `docs/data` or of a folder in it."""
    return json.loads(path_of(name).read_text())


def path_of(name: str) -> Path:
    """Path of a file of `docs/data` or of a folder in it, by its name without ending.

    Raises:
        KeyError: if there is none.
    """
    for path in DATA.rglob(f"{name}.json"):
        return path
    raise KeyError(name)


def lookup(reference: str, section: str) -> tuple[Any, Source]:
    """The entry that `file:entry` names, of `values` or `tables`, and its source.

    Raises:
        KeyError: for an entry that is not there.
    """
    name, entry = reference.split(":", maxsplit=1)
    record = load(name)
    entry_value = record[section][entry]
    origin = {**record, **(entry_value if isinstance(entry_value, dict) else {})}
    return entry_value, Source(origin["command"], origin["machine"])


def text_of(value: str | dict[str, str]) -> str:
    """The text of a value, of a mapping too."""
    return value if isinstance(value, str) else value["text"]


def _unbroken(text: str) -> str:
    """The text with no line break between a number and its unit."""
    return re.sub(r"(?<=[\d)]) (?=(?:%|K|[mun]?s|mm|times)(?:\W|$))", "\u00a0", text)


class _Number(SphinxRole):
    """One number with its unit; what made it is shown on hovering."""

    def run(self):
        value, source = lookup(self.text, "values")
        self.env.note_dependency(str(path_of(self.text.split(":")[0])))
        node = nodes.abbreviation(self.rawtext, _unbroken(text_of(value)))
        node["classes"] = ["measured"]
        node["explanation"] = f"{source.command}; {source.machine}"
        return [node], []


class _Measured(SphinxDirective):
    """A table, and below it its command and machine."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self):
        table, source = lookup(self.arguments[0], "tables")
        name = self.arguments[0].split(":")[0]
        path = path_of(name)
        self.env.note_dependency(str(path))
        rows = [table["columns"], *table["rows"]]
        lines = ["| " + " | ".join(map(_unbroken, row)) + " |" for row in rows]
        lines.insert(1, "|" + "---|" * len(table["columns"]))
        file = f"docs/data/{path.relative_to(DATA)}"
        about = f"`{source.command}`; {source.machine}. Data: `{file}`."
        lines += ["", "{.measured-source}", about]
        return self.parse_text_to_nodes("\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_role("number", _Number())
    app.add_directive("measured", _Measured)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
