"""Pages of the documentation as tests read them: their text, code and commands."""

import re
import shlex
from pathlib import Path


ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
DATA = sorted((DOCS / "data").rglob("*.json"))
PROGRAMS = ("jaxthermo", "calibrate", "experiments")

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.M | re.S)
_FENCED = re.compile(r"^```.*?^```", re.M | re.S)
_SPAN = re.compile(r"(?<!`)`([^`]+)`(?!`)")


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path, language: str) -> list[str]:
    return [text for name, text in _BLOCK.findall(page.read_text()) if name == language]


def without_blocks(page: Path) -> str:
    """The text of a page but for its fenced blocks."""
    return _FENCED.sub("", page.read_text())


def command_lines(page: Path) -> list[list[str]]:
    """Words of each command in the shell blocks of a page."""
    lines = [line for text in blocks(page, "sh") for line in text.splitlines()]
    commands = [command for line in lines for command in line.split(" && ")]
    return [
        words for command in commands if (words := shlex.split(command, comments=True))
    ]


def spans(page: Path) -> list[str]:
    """The code within the sentences of a page; roles such as `number` among it."""
    return [" ".join(text.split()) for text in _SPAN.findall(without_blocks(page))]


def commands_in_text(page: Path) -> list[list[str]]:
    """Words of each command that a page has in its sentences, choices left out."""
    first = (*PROGRAMS, "make", "pip", "python")
    named = (text for text in spans(page) if text.split(" ")[0] in first)
    return [shlex.split(re.sub(r"\[-.*?\]|\[[A-Z].*?\]", "", text)) for text in named]
