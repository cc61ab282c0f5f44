"""Docstrings open with a noun or a verb, never with a question's or a list's word."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest


ROOT = Path(__file__).resolve().parents[2]
FILES = sorted(
    file.relative_to(ROOT)
    for package in ("jaxthermo", "calibrate", "experiments")
    for file in (ROOT / package).rglob("*.py")
)
FORBIDDEN = re.compile(r"(Of|What|How|Whether|Where|Yes)\b")


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of every string that stands alone: attribute docstrings too."""
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield node.lineno, text.strip()


def forbidden(source: str) -> list[str]:
    return [
        f"line {line}: {text.splitlines()[0]}"
        for line, text in docstrings(ast.parse(source))
        if FORBIDDEN.match(text)
    ]


@pytest.mark.parametrize("package", ["jaxthermo", "calibrate", "experiments"])
def test_no_docstring_opens_with_a_forbidden_word(package):
    forbidden_lines = {
        str(file): lines
        for file in FILES
        if file.parts[0] == package
        and (lines := forbidden((ROOT / file).read_text(encoding="utf-8")))
    }
    assert not forbidden_lines


def test_all_kinds_of_docstring_are_seen():
    source = '''"""What a module is."""
rate = 1.0
"""Of a rate."""
class Law:
    """How it acts."""
    slope: float
    """Whether it is steep."""
    def heat(self):
        """Where it flows."""
'''
    assert [line.split(":")[0] for line in forbidden(source)] == [
        "line 1",
        "line 3",
        "line 5",
        "line 7",
        "line 9",
    ]


def test_a_word_that_only_begins_alike_is_allowed():
    assert not forbidden('"""Offset of the origin [m]."""')
    assert not forbidden('"""Heat rate: what the surface receives [W]."""')
