"""References that the site generates where a page has a line `%generate KIND NAME`."""

import re

from docutils import nodes
from sphinx.application import Sphinx

from .api_reference import api_reference, literal_equations
from .command_reference import command_reference
from .config_reference import config_reference


GENERATORS = {
    "api": api_reference,
    "commands": command_reference,
    "config": config_reference,
}
_LINE = re.compile(r"^%generate (\w+) (\S+)$", re.M)


def fill(text: str) -> str:
    """The text of a page with its generated parts."""
    return _LINE.sub(lambda match: GENERATORS[match[1]](match[2]), text)


def _fill_page(app: Sphinx, name: str, source: list[str]) -> None:
    source[0] = fill(source[0])


def readable_docstring(what: str, lines: list[str]) -> list[str]:
    """Lines of a docstring as napoleon takes them for sections and equations."""
    converted = literal_equations(lines)
    if what in ("attribute", "property", "data"):
        # Napoleon takes what is before a colon in the first line for a type: the first
        # line is an empty comment.
        return ["..", "", *converted]
    return converted


def _docstring(app, what, name, thing, options, lines: list[str]) -> None:
    lines[:] = readable_docstring(what, lines)


def _short_types(app: Sphinx, doctree: nodes.document) -> None:
    """Name the arrays of signatures as users import them."""
    for text in list(doctree.findall(nodes.Text)):
        if "jaxlib._jax." in text:
            text.parent.replace(text, nodes.Text(text.replace("jaxlib._jax.", "")))


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", _fill_page)
    # Before napoleon, which rewrites the sections.
    app.connect("autodoc-process-docstring", _docstring, priority=100)
    app.connect("doctree-read", _short_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
