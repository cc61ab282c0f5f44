"""References that the site generates: nothing in them is left without a meaning."""

import json
import re

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
