"""Pages of the documentation: their code, numbers and pictures; the release's files."""

import ast
import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml


ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
DATA = sorted((DOCS / "data").glob("*.json"))
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.M | re.S)
_NUMBER = re.compile(r"\{number\}`(\w+):(\w+)`|```\{measured\} (\w+):(\w+)")


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in _BLOCK.findall(page.read_text()) if kind == language]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_code_of_a_page_can_be_parsed(page):
    for text in blocks(page, "python"):
        ast.parse(text)
    for text in blocks(page, "yaml"):
        assert isinstance(yaml.safe_load(text), dict)


def test_every_number_that_is_shown_is_there_and_every_one_there_is_shown():
    shown = set()
    for page in PAGES:
        for a, b, c, d in _NUMBER.findall(page.read_text()):
            shown.add((a or c, "values" if a else "tables", b or d))
    there = {
        (path.stem, kind, name)
        for path in DATA
        for kind in ("values", "tables")
        for name in json.loads(path.read_text())[kind]
    }
    assert shown == there


@pytest.mark.parametrize("path", DATA, ids=lambda p: p.stem)
def test_data_name_their_command_and_machine(path):
    record = json.loads(path.read_text())
    assert record["about"] and record["command"] and record["machine"]
    for table in record["tables"].values():
        assert {len(row) for row in table["rows"]} == {len(table["columns"])}


def test_pictures_are_there_and_small():
    sizes = {p.name: p.stat().st_size for p in (DOCS / "pictures").glob("*.png")}
    assert max(sizes.values()) <= 150_000 and sum(sizes.values()) <= 2_000_000
    text = "".join(page.read_text() for page in PAGES)
    assert set(re.findall(r"pictures/(\w+\.png)", text)) == set(sizes)


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 200


def test_the_citation_names_the_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["cff-version"] and cited["authors"]
    assert cited["version"] == project["version"]
