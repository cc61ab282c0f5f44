"""JSON Schemas: the committed files are current, and shipped configs follow them."""

import functools
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from calibrate.config.schema import CalibrationConfig
from calibrate.study.config import SweepConfig
from jaxthermo.config.json_schema import json_schema
from jaxthermo.config.schema.dataset import DatasetConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.strict_yaml import read_yaml


CONFIGS = Path(__file__).resolve().parents[3] / "configs"
MODELS = {
    "scene": SceneConfig,
    "dataset": DatasetConfig,
    "calibration": CalibrationConfig,
    "sweep": SweepConfig,
}
FOLDERS = {
    "scenes": "scene",
    "datasets": "dataset",
    "calibration": "calibration",
    "sweeps": "sweep",
}
PROGRAMS = {
    "scene": "jaxthermo schema",
    "dataset": "jaxthermo schema dataset",
    "calibration": "calibrate schema",
    "sweep": "experiments schema",
}


@functools.cache
def validator(name: str) -> jsonschema.Draft202012Validator:
    text = (CONFIGS / f"{name}.schema.json").read_text(encoding="utf-8")
    return jsonschema.Draft202012Validator(json.loads(text))


@pytest.mark.parametrize("name", MODELS)
def test_the_committed_file_is_current(name):
    committed = (CONFIGS / f"{name}.schema.json").read_text(encoding="utf-8")
    program = PROGRAMS[name]
    assert json_schema(MODELS[name]) == committed, (
        f"write it again: {program} > configs/{name}.schema.json"
    )
    jsonschema.Draft202012Validator.check_schema(json.loads(committed))


@pytest.mark.parametrize(
    "path", sorted(CONFIGS.glob("*/*.yaml")), ids=lambda path: path.stem
)
def test_shipped_configs_name_their_schema_and_follow_it(path):
    name = FOLDERS[path.parent.name]
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first == f"# yaml-language-server: $schema=../{name}.schema.json"
    assert not list(validator(name).iter_errors(read_yaml(path)))


SCENE = {
    "bodies": [
        {
            "shape": {"kind": "box", "size": [1, "10 cm", 0.1]},
            "pitch": "5 mm",
            "structure": "octree",
            "material": "copper",
            "temperature": "20 degC",
        }
    ],
    "terms": [{"kind": "contact", "conductance": "bonded"}],
    "time": {"end": 9, "save_at": [9]},
    "solver": {"dt": "auto"},
    "camera": "auto",
}


def changed(*where, value):
    """The scene with one value changed."""
    data = json.loads(json.dumps(SCENE))
    inner = data
    for key in where[:-1]:
        inner = inner[key]
    inner[where[-1]] = value
    return data


def test_short_forms_are_valid():
    assert not list(validator("scene").iter_errors(SCENE))


@pytest.mark.parametrize(
    ("where", "value"),
    [
        (("bodies", 0, "pitch"), "mm"),
        (("bodies", 0, "pitch"), -1),
        (("bodies", 0, "voxels_high"), 30),
        (("bodies", 0, "pich"), 1),
        (("bodies", 0, "structure"), "octre"),
        (("bodies", 0, "material"), "coper"),
        (("bodies", 0, "shape", "kind"), "bax"),
        (("terms", 0, "conductance"), "glued"),
        (("terms", 0), {"conductance": 1}),
        (("solver",), {"kind": "trbdf2", "error": 0}),
        (("image",), {"palette": "irn"}),
    ],
)
def test_an_editor_sees_mistakes(where, value):
    assert list(validator("scene").iter_errors(changed(*where, value=value)))


def test_numbers_have_units_and_fields_descriptions():
    schema: Any = validator("scene").schema
    definitions = schema["$defs"]
    sun = definitions["SunConfig"]["properties"]["irradiance"]
    assert "[W/m^2]" in sun["description"]
    assert '"unit": "W/m^2"' in json.dumps(sun)
    described = [
        bool(field.get("description"))
        for definition in definitions.values()
        for key, field in definition["properties"].items()
        if key != "kind"
    ]
    assert sum(described) / len(described) > 0.8
