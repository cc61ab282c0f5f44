"""References that the site generates: nothing in them is left without a meaning."""

import ast
import json
import re
from inspect import cleandoc
from itertools import pairwise

import pytest
from doc_pages import DOCS, PROGRAMS, ROOT

from docs.extension.api_reference import api_reference, exported
from docs.extension.command_reference import command_reference
from docs.extension.config_reference import config_reference


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_argument_of_a_command_has_a_meaning(program):
    text = command_reference(program)
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| `")]
    assert rows and all(row[-1].strip(" |") for row in rows)
    # Not the docstring as it is written.
    assert "Args:" not in text and "inspect" not in text


@pytest.mark.parametrize("program", PROGRAMS)
def test_options_in_the_words_of_a_command_are_code(program):
    text = command_reference(program)
    without_code = re.sub(r"`[^`]*`", "", text)
    assert "`--" in text
    # Two hyphens of plain text become a dash.
    assert not re.findall(r"--[a-z]\S*", without_code)


def field_docstrings() -> list[tuple[str, str]]:
    """Name and docstring of each field of the package."""
    pairs = []
    for path in sorted((ROOT / "jaxthermo").rglob("*.py")):
        for parent in ast.walk(ast.parse(path.read_text())):
            if isinstance(parent, ast.ClassDef):
                pairs += [
                    (f"{parent.name}.{ast.unparse(field.target)}", text.value.value)
                    for field, text in pairwise(parent.body)
                    if isinstance(field, ast.AnnAssign)
                    and isinstance(text, ast.Expr)
                    and isinstance(text.value, ast.Constant)
                ]
    return pairs


def test_no_docstring_of_a_field_is_split_at_a_colon():
    napoleon = pytest.importorskip("sphinx.ext.napoleon", reason="the site needs it")
    from docs.extension.generated import readable_docstring

    pairs = field_docstrings()
    assert sum(": " in text for _, text in pairs) > 20
    for name, text in pairs:
        lines = readable_docstring("attribute", cleandoc(text).splitlines())
        converted = napoleon.GoogleDocstring(lines, what="attribute", name=name)
        assert ":type:" not in str(converted), name
        assert str(converted).endswith(lines[-1])


def test_every_exported_name_is_on_one_page():
    pages = sorted((DOCS / "reference").glob("api-*.md"))
    folders = [re.findall(r"^%generate api (\S+)$", p.read_text(), re.M) for p in pages]
    text = "\n".join(api_reference(folder) for (folder,) in folders)
    documented = re.findall(r"^\.\. auto\w+:: jaxthermo\.(\S+)$", text, re.M)
    # The two that are modules are shown with their members.
    modules = {"shapes": "geometry.shapes", "measurements": "image.measurements"}
    assert sorted(documented) == sorted(modules.get(name, name) for name in exported())


@pytest.mark.parametrize("name", ["scene", "dataset", "calibration", "sweep"])
def test_every_model_of_a_schema_is_in_its_reference(name):
    schema = json.loads((ROOT / "configs" / f"{name}.schema.json").read_text())
    text = config_reference(name)
    fields = {
        key for model in schema["$defs"].values() for key in model.get("properties", ())
    }
    assert fields and {key for key in fields if f"`{key}`" not in text} <= {"kind"}
