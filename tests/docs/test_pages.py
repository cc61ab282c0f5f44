"""Pages of the documentation: their Python and pictures; the files of the release."""

import ast
import re
import tomllib

import pytest
import yaml
from doc_pages import DOCS, PAGES, ROOT, blocks, name


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_python_of_a_page_can_be_parsed(page):
    for text in blocks(page, "python"):
        ast.parse(text)


def test_pictures_are_there_and_small():
    sizes = {p.name: p.stat().st_size for p in (DOCS / "pictures").glob("*.webp")}
    assert max(sizes.values()) <= 150_000 and sum(sizes.values()) <= 2_000_000
    text = "".join(page.read_text() for page in PAGES)
    assert set(re.findall(r"pictures/(\w+\.webp)", text)) == set(sizes)


@pytest.mark.parametrize(
    "page", sorted({*DOCS.glob("stages/*.md")} - {DOCS / "stages/index.md"}), ids=name
)
def test_a_stage_has_its_picture_and_equations(page):
    text = page.read_text()
    assert f"pictures/{page.stem}.webp" in text and "$$" in text


def test_every_limit_and_decision_has_a_tag():
    text = (DOCS / "limits.md").read_text()
    entries = re.findall(r"^- .*", text, re.M)
    tag = re.compile(r"- \{tag\}`(physical|numerical|convenience)` [A-Z]")
    assert len(entries) >= 20 and all(map(tag.match, entries))


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 200


def test_the_changelog_is_short():
    assert (ROOT / "CHANGELOG.md").stat().st_size <= 8_000


def test_the_citation_names_the_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["cff-version"] and cited["authors"]
    assert cited["version"] == project["version"]
