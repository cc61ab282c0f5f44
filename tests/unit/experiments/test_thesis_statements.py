"""Texts of the thesis' exhibits: their numbers, tables, claims and pictures."""

import pytest

from experiments.thesis import exhibition, statements
from experiments.thesis.exhibit import CLAIMS
from jaxthermo.report import page
from jaxthermo.report.table import Cell, Table


NUMBERS = {
    "peeled": [18, 20, 8],
    "ratio": 0.5432,
    "holds": False,
    "words": ["a", "b"],
    "nothing": None,
    "by name": {"shell": 1.5, "full": 2.0},
    "rows": [{"size": 1, "step_s": 0.25, "of": {"a_K": 3.0}, "long": list(range(9))}],
}


@pytest.mark.parametrize(
    ("reference", "text"),
    [
        ("peeled", "18/20/8"),
        ("peeled/-1", "8"),
        ("ratio~.1%", "54.3%"),
        ("ratio", "0.543"),
        ("holds~yes, it does/no", "no"),
        ("words", "a, b"),
        ("nothing", "–"),
        ("by name~.2f", "shell 1.50, full 2.00"),
        ("rows/0/of/a_K~.1f", "3.0"),
    ],
)
def test_a_value_is_quoted_in_its_format(reference, text):
    assert statements.quoted(NUMBERS, reference) == text


def test_rows_become_a_table_with_units_and_without_long_lists():
    table = statements.table_of_values(NUMBERS, "rows")
    assert list(table.columns) == ["size", "step [s]", "of, a [K]"]
    assert table.rows == [["1", "0.25", "3"]]
    by_name = statements.table_of_values(NUMBERS, "by name")
    assert [row[1] for row in by_name.rows] == ["1.5", "2"]


def test_a_section_has_reasons_terms_tables_and_captions(monkeypatch):
    body = """
Half: {number}`x:ratio~.2f`.

C09: Of the claim `code`
in two lines.

size
: {number}`x:peeled`
  voxels

place
: there

% dot: A dot, of
% two lines.

| a | b |
|---|---|
| 1 | {number}`x:peeled/0` |

```{measured} x:rows
```

The end.
"""
    monkeypatch.setattr(statements, "_sections", lambda: {"x": ("title", body)})
    assert statements.references("x")[1] == ["rows"]
    found = statements.statement("x", NUMBERS, {"dot": page.pre("picture")})
    assert found.title == "title" and found.reason == "Half: 0.54."
    assert found.claims == {"C09": "Of the claim code in two lines."}
    terms, picture, caption, table, rows, end = found.blocks
    assert "18/20/8 voxels" in str(terms) and "there" in str(terms)
    assert "picture" in str(picture) and "A dot, of two lines." in str(caption)
    assert isinstance(table, Table) and table.rows[0][1] == Cell("18", wraps=True)
    assert isinstance(rows, Table) and end == "The end."


def test_every_exhibit_has_a_text_and_every_text_an_exhibit():
    names = {exhibit.name for exhibit in exhibition.all_exhibits()}
    assert set(statements._sections()) == names
    assert {name for claim in CLAIMS for name in claim.exhibits} <= names
