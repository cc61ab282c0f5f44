"""Configurations of the documentation load as what they are, parts of a file too."""

import copy
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import trimesh
from doc_pages import PAGES, ROOT, blocks, name, spans

from calibrate.config.loader import load_calibration, scene_config
from calibrate.study.config import load_sweep
from calibrate.study.points import cases_of, choices
from jaxthermo.__main__ import main
from jaxthermo.config.loader import load_config, load_dataset
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.dataset import DatasetConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.schema.sheet import SheetConfig
from jaxthermo.config.shipped_cards import shipped_cards
from jaxthermo.config.strict_yaml import parse_yaml, read_yaml, write_yaml


WITH_CONFIGS = [page for page in PAGES if blocks(page, "yaml")]
BODY = {
    "mesh": {"path": "statue.glb", "unit": "mm"},
    "pitch": "5 mm",
    "material": "gold",
    "temperature": 300,
}
SCENE = {"bodies": [BODY], "time": {"end": 10, "save_at": [5, 10]}}
# Settings that sentences name: a line of YAML, not a sketch with dots or capitals.
_SETTING = re.compile(r"[a-z_.]+: (?!.*(?:\.\.|\b[A-Z]{4}|mean, sd|\{\})).+")
# Of fits and sweeps, whose schemas tests of their own cover.
OF_FITS = {
    "align",
    "bijection",
    "camera_settings",
    "corrected_for",
    "goals",
    "huber",
    "per",
    "prior",
    "reference",
    "time_norm",
}


@pytest.fixture
def folder(tmp_path):
    """A folder like `configs/examples`, with a mesh, beside the shipped scenes."""
    example_folder = tmp_path / "configs" / "examples"
    example_folder.mkdir(parents=True)
    (example_folder.parent / "scenes").symlink_to(ROOT / "configs" / "scenes")
    trimesh.creation.box((30, 20, 40)).export(example_folder / "statue.ply")
    return example_folder


def write(path, data):
    path.write_text(write_yaml(data))
    return path


def load_scene(folder: Path, text: str, *overrides: str) -> None:
    """Load it and compile its program, as `simulate --explain` does."""
    path = folder / "scene.yaml"
    path.write_text(text)
    body = load_config(path).bodies[0]
    assert body.mesh is not None or body.sheet is not None
    changes = [word for change in overrides for word in ("--set", change)]
    with pytest.raises(SystemExit) as stopped:
        main(["simulate", str(path), "--explain", *changes])
    assert stopped.value.code == 0


def load_calibration_block(folder, data):
    for frames in data.get("reference", {}).get("frames", ()):
        for file in frames["files"]:
            (folder / file).touch()
    config = load_calibration(write(folder / "fit.yaml", data))
    for case in (*config.train, *config.held_out):
        assert scene_config(config, case.set).bodies


def load_sweep_block(folder, data):
    config = load_sweep(write(folder / "sweep.yaml", data))
    sweep_choices = choices(config)
    assert len(sweep_choices) == 20
    # The first and the last have every value of a list of two.
    assert all(
        cases_of(config, choice) for choice in (sweep_choices[0], sweep_choices[-1])
    )


def load_assembly_block(folder, text):
    script = runpy.run_path(str(ROOT / "docs" / "examples" / "van_mesh.py"))
    groups = ("panels", "windows", "trim", "interior", "machinery", "wheels")
    parts = [part for group in groups for part in script[group]()]
    script["write_glb"](folder / "van.glb", parts)
    path = folder / "scene.yaml"
    path.write_text(text)
    config = load_config(path)
    assert 40 < len(config.bodies) < len(parts) == 60
    assert len({body.name for body in config.bodies}) == len(config.bodies)


def load_body_part(folder, body_section):
    scene = {**SCENE, "bodies": [{**BODY, **body_section}]}
    assert load_config(write(folder / "part.yaml", scene), find_meshes=False)


@pytest.mark.parametrize("page", WITH_CONFIGS, ids=name)
def test_blocks_of_a_page_load(page, folder, capsys):
    calibration = {}
    for text in blocks(page, "yaml"):
        data = parse_yaml(text, "page")
        if "bodies" in data:
            # Coarse, since only what is written counts here.
            is_sheet = "sheet" in data["bodies"][0]
            pitch = "sheet.pitch=20 cm" if is_sheet else "pitch=5 mm"
            load_scene(folder, text, f"bodies.0.{pitch}")
            assert "included: conduction, sun" in capsys.readouterr().out
        elif "assembly" in data:
            load_assembly_block(folder, text)
        elif "axes" in data:
            load_sweep_block(folder, data)
        elif "parameters" in data or "truth" in data:
            calibration |= data
            load_calibration_block(folder, calibration)
        elif data.keys() <= SceneConfig.model_fields.keys():
            scene = {**SCENE, **data}
            assert load_config(write(folder / "scene.yaml", scene), find_meshes=False)
        else:
            assert data.keys() <= BodyConfig.model_fields.keys()
            load_body_part(folder, data)


def scene_with(setting):
    """A scene with the setting where it belongs, None for a setting of other files."""
    scene = copy.deepcopy(SCENE)
    ((key, value),) = setting.items()
    first, _, subkey = key.partition(".")
    if subkey:
        scene[first] = {subkey: value}
    elif key == "shape":
        scene["bodies"] = [{"temperature": BODY["temperature"], **setting}]
    elif key == "sheet" or key in SheetConfig.model_fields.keys() - {"nodes", "pitch"}:
        geometry = {name: BODY[name] for name in ("mesh", "temperature")}
        sheet = value if key == "sheet" else {"layers": "soil", **setting}
        scene["bodies"] = [{**geometry, "sheet": sheet}]
    elif key in BodyConfig.model_fields:
        scene["bodies"][0][key] = value
        if key == "solid":
            del scene["bodies"][0]["mesh"]
    elif key in SceneConfig.model_fields:
        scene[key] = value
    elif key in ("nodes", "size"):
        scene["bodies"][0]["structure"] = {"kind": "aggregate", **setting}
    elif key == "weights":
        scene["bodies"][0]["structure"] = {"kind": "octree", **setting}
    elif key in ("side", "region", "fragments", "body", "part"):
        scene["bodies"] = [{**BODY, "name": name} for name in ("tyre", "roof")]
        scene["terms"] = [{"kind": "heat_flux", "heat_flux": 10, "on": setting}]
    elif key == "on":
        scene["bodies"] = [{**BODY, "name": name} for name in ("tyre", "roof", "door")]
        scene["terms"] = [{"kind": "heat_flux", "heat_flux": 10, **setting}]
    elif key in ("place", "start", "clear_sky"):
        site = {"latitude": 48, "longitude": 11}
        outdoors = {"place": site, "start": "2026-06-21T12:00Z"}
        scene["outdoors"] = {**outdoors, "clear_sky": {"air": [285, 300]}, **setting}
    else:
        return None
    return scene


SETTINGS = {text for p in PAGES for text in spans(p) if _SETTING.fullmatch(text)}


@pytest.mark.parametrize("text", sorted(SETTINGS))
def test_a_setting_in_a_sentence_is_accepted(text, tmp_path):
    setting = parse_yaml(text, "page")
    scene = scene_with(setting)
    if scene is None and setting.keys() <= DatasetConfig.model_fields.keys():
        write(tmp_path / "scene.yaml", SCENE)
        dataset = {"scene": "scene.yaml", "orbit": {"count": 1}, **setting}
        assert load_dataset(write(tmp_path / "dataset.yaml", dataset))
        return
    if scene is None:
        assert setting.keys() <= OF_FITS
        return
    assert load_config(write(tmp_path / "scene.yaml", scene), find_meshes=False)


def test_the_card_that_is_shown_is_the_shipped_one():
    """Each number to the digits that the page has."""
    (text,) = blocks(ROOT / "docs" / "guide" / "calibrate.md", "text")
    excerpt = parse_yaml(text, "page")
    card = read_yaml(shipped_cards()[excerpt["name"]])
    assert agrees(excerpt, card)


def agrees(excerpt: Any, source: Any) -> bool:
    if isinstance(excerpt, dict):
        return all(agrees(value, source[key]) for key, value in excerpt.items())
    if isinstance(excerpt, list):
        return all(agrees(*pair) for pair in zip(excerpt, source, strict=True))
    if isinstance(excerpt, float):
        return abs(excerpt - source) <= 5e-3 * abs(source)
    return excerpt == source
