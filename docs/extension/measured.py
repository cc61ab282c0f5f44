"""Numbers of `docs/data`: a role for one, a directive for a table.

A file of `docs/data` names the command that made it and the machine, and has `values`,
each a text with its unit, and `tables` with `columns` and `rows`. Pages show a value by
the role `number` and a table by the directive `measured`, both with `file:name`; a name
that is not there is an error.
"""

import json
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole


DATA = Path(__file__).resolve().parents[1] / "data"


def load(name: str) -> dict[str, Any]:
    """One file of `docs/data`."""
    return json.loads((DATA / f"{name}.json").read_text())


def lookup(reference: str, kind: str) -> tuple[dict[str, Any], Any]:
    """The file and the entry that `file:entry` names, of `values` or `tables`.

    Raises:
        KeyError: for an entry that is not there.
    """
    name, entry = reference.split(":")
    record = load(name)
    return record, record[kind][entry]


class _Number(SphinxRole):
    """One number with its unit; what made it is shown on hovering."""

    def run(self):
        record, text = lookup(self.text, "values")
        self.env.note_dependency(str(DATA / f"{self.text.split(':')[0]}.json"))
        node = nodes.inline(self.rawtext, text, classes=["measured"])
        node["ids"] = []
        node["command"] = record["command"]
        return [node], []


class _Measured(SphinxDirective):
    """A table, and below it its command and machine."""

    required_arguments = 1

    def run(self):
        record, table = lookup(self.arguments[0], "tables")
        name = self.arguments[0].split(":")[0]
        self.env.note_dependency(str(DATA / f"{name}.json"))
        rows = [table["columns"], *table["rows"]]
        lines = ["| " + " | ".join(map(str, row)) + " |" for row in rows]
        lines.insert(1, "|" + "---|" * len(table["columns"]))
        machine = table.get("machine", record["machine"])
        command = table.get("command", record["command"])
        source = f"`{command}`; {machine}. Data: `docs/data/{name}.json`."
        lines += ["", "{.measured-source}", source]
        return self.parse_text_to_nodes("\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_role("number", _Number())
    app.add_directive("measured", _Measured)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
