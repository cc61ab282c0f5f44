"""Numbers of the documentation: each from a file of `docs/data`, or named here."""

import json
import re
from typing import Any

import pytest
from doc_pages import DATA, PAGES, ROOT, name, without_blocks

from jaxthermo.config.shipped_cards import shipped_cards
from jaxthermo.config.strict_yaml import read_yaml


_SHOWN = re.compile(r"\{number\}`([\w.-]+):([^`]+)`|```\{measured\} ([\w.-]+):([^\n]+)")
_NOT_PROSE = re.compile(
    r"\$\$.*?\$\$|\{number\}`[^`]*`|`[^`]*`|\$[^$\n]*\$|\]\([^)]*\)", re.S
)
_UNIT = (
    r"%|[mun]?s|min|minutes?|hours?|m?K|[kmu]?m|degrees|degC|[KMG]i?B|times|million"
    r"|nodes"
)
_NUMERAL = re.compile(
    rf"(?<![\w.,^-])\d[\d., ]*(?:\s+to\s+[\d.,]+)?\s*(?:{_UNIT})(?!\w)"
)

# Settings, defaults, definitions and sizes of examples: not measured, page by page.
GIVEN = {
    "README.md": "1, 3, 5 min; 1, 4, 10 min",
    "docs/guide/calibrate.md": "1.25 times",
    "docs/guide/camera.md": "10 ms; 10 um; 12 um; 15 %; 150 K; 2 degrees; 20 mK; "
    "300 K; 5 mm; 50 mK; 6000 K; 7.5 to 14 um",
    "docs/guide/live.md": "20 s",
    "docs/guide/other-programs.md": "0.01 K",
    "docs/guide/outdoors.md": "10 m; 30 min",
    "docs/guide/own-mesh.md": "2 mm; 24 hours; 25 degC; 3 min",
    "docs/guide/python.md": "512 MiB",
    "docs/guide/results.md": "0.01 K; 655.35 K",
    "docs/guide/scene.md": "1 %; 1 min; 1.2 times; 25 degrees; 50 degrees",
    "docs/guide/sheets.md": "0.8 mm; 1 min; 2 mm",
    "docs/guide/structures.md": "1 GiB; 15 000 nodes; 180 s; 5 %; 99.5 %",
    "docs/guide/sweeps.md": "0.1 %; 1 %; 3 %",
    "docs/scaling.md": "25 GB",
    "docs/limits.md": "1 K; 1 s; 1000 s; 15 %; 150 K; 150 to 6000 K; 2 %; 20 degC; "
    "25 degrees; 280 K; 280 degC; 3 %; 5 %; 5 degrees; 6000 K; 64 times",
    "docs/stages/image.md": "5800 K",
    "docs/stages/time.md": "0 K; 0.1 %; 1 mK; 1 mm; 30 s; 300 K; 400 K; 5 million",
    "docs/stages/voxels.md": "2 %",
    "docs/thesis/chapter-3.md": "180 s; 2 %",
    "docs/thesis/chapter-4.md": "2 %",
    "docs/thesis/chapter-5-1.md": "1 m; 10 m; 100 K; 268.15 K; 298.15 K; "
    "30 minutes; 300 K; 303.15 K; 330 K; 400 K",
    "docs/thesis/chapter-5-3.md": "0 s; 0.05 s; 0.1 to 1 m; 0.1 to 10 s; 1 K; "
    "100 K; 2 s",
    "docs/thesis/chapter-5-4.md": "1.3 times; 10 %; 15 %; 2 %; 22 %; 300 K; 340 K; "
    "4 %; 5 m; 600 s",
    "docs/thesis/chapter-6-1.md": "0.05 s; 0.5 m; 90 s; 180 s; 84 %",
    "docs/thesis/chapter-6-3.md": "1.5 times; 1.6 times; 10 %; 11.4 %; "
    "13 to 55 ms; 2.3 to 2.7 million; 2.5 million; 25 %; 3 m; 6.7 times",
    "docs/thesis/text.md": "0.1 m; 0.2 to 1 m; 1 m; 1 mm; 180 s; 300 K; 5800 K",
}


def numerals(text: str) -> list[str]:
    """The numerals with a unit in the sentences and tables of a page."""
    prose = _NOT_PROSE.sub(" . ", text)
    return [" ".join(match[0].split()) for match in _NUMERAL.finditer(prose)]


def texts(value: Any) -> list[str]:
    """All texts in plain data."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [text for entry in value for text in texts(entry)]
    return [str(value)]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_number_in_prose_is_from_data_or_given(page):
    numerals_of_page = set(numerals(without_blocks(page)))
    allowed = set(GIVEN[name(page)].split("; ")) if name(page) in GIVEN else set()
    if page.name == "README.md":
        # No roles there: what it says is compared with the data.
        data = [text for path in DATA for text in texts(json.loads(path.read_text()))]
        numerals_of_page -= {
            numeral
            for numeral in numerals_of_page
            if any(numeral in text for text in data)
        }
    assert numerals_of_page == allowed


def test_numerals_are_found():
    text = (
        "It takes 3.4 s, `2 s`, {number}`a:b` and 1 to 2 %,\n$x = 3 s$ or 12\nms, x 8."
    )
    assert numerals(text) == ["3.4 s", "1 to 2 %", "12 ms"]


def test_the_front_of_the_readme_is_that_of_the_data():
    front = json.loads((ROOT / "docs" / "data" / "front.json").read_text())
    rows = [row[1:5] for row in front["tables"]["best"]["rows"] if "Buddha" in row[0]]
    text = (ROOT / "README.md").read_text()
    table = re.search(r"^\| error \|.*?\n\n", text, re.M | re.S)
    assert table
    shown_rows = [
        line.strip("|").split("|") for line in table[0].strip().splitlines()[2:]
    ]
    assert shown_rows and all(
        [cell.strip() for cell in row] in rows for row in shown_rows
    )


def test_errors_of_cards_are_those_of_the_shipped_cards():
    """The largest error of all cases, to the digits of the page."""
    data = json.loads((ROOT / "docs" / "data" / "cards.json").read_text())
    structures = ("octree", "shell-over-core")
    voxels = []
    for body, *errors, _ in data["tables"]["largest_error"]["rows"]:
        for structure, shown_errors in zip(structures, errors, strict=True):
            card = read_yaml(shipped_cards()[f"{body}/{structure}"])
            cases = card["error_kelvin"].values()
            for which, text in zip(
                ("default", "fitted"), shown_errors.split(" to "), strict=True
            ):
                assert f"{max(case[which] for case in cases):.3g}" == text
            voxels.append(int(card["origin"]["nodes"].split()[-1]))
    assert len(voxels) == len(shipped_cards())
    ends = f"{min(voxels):,} to {max(voxels):,}".replace(",", " ")
    assert data["values"]["voxels"]["text"] == ends


def test_every_number_that_is_shown_is_there_and_every_one_there_is_shown():
    used = set()
    for page in PAGES:
        for a, b, c, d in _SHOWN.findall(page.read_text()):
            used.add((a or c, "values" if a else "tables", b or d))
    defined = {
        (path.stem, section, name)
        for path in DATA
        for section in ("values", "tables")
        for name in json.loads(path.read_text())[section]
    }
    assert used == defined


@pytest.mark.parametrize("path", DATA, ids=lambda p: p.stem)
def test_data_name_their_command_and_machine(path):
    record = json.loads(path.read_text())
    assert record["about"] and record["command"] and record["machine"]
    for table in record["tables"].values():
        assert {len(row) for row in table["rows"]} == {len(table["columns"])}
