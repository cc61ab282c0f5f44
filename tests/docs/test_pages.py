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
