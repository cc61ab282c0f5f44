"""A run of an assembly: names in its results, and few lines about many bodies."""

import json
import re

import numpy as np
import pytest
from cli_runs import refused, succeed

from jaxthermo.cli import simulate
from jaxthermo.config.loader import load_config
from jaxthermo.image.files.exr import read_exr
from tests.assemblies import NAMES, write_cart


SCENE = """
assembly:
  mesh: {path: cart.glb, unit: m}
  pitch: 10 cm
  temperature: 300
  parts:
    - {match: decal, ignore: true}
    - {match: "wheel*", material: copper, pitch: 4 cm}
    - {match: roof, sheet: {layers: [{material: copper, thickness: 1 mm}], cells: 1}}
terms:
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290,
     on: {part: "wheel_?*"}}
  - {kind: heat_flux, heat_flux: 100, on: {part: roof}}
time: {end: 20, save_at: [20]}
camera: {width: 64, height: 48}
"""

MANY = """
bodies:
{bodies}
terms:
  - {{kind: convection, heat_transfer_coefficient: 10, temperature: 290}}
  - {{kind: surroundings, temperature: 280}}
time: {{end: 20, save_at: [20]}}
camera: {{width: 64, height: 48}}
"""


@pytest.fixture(scope="module")
def cart_run(tmp_path_factory):
    """The folder of a run of the cart, and what the run printed."""
    folder = tmp_path_factory.mktemp("cart")
    write_cart(folder)
    (folder / "scene.yaml").write_text(SCENE)
    out = folder / "out"
    return out, succeed("simulate", folder / "scene.yaml", "--out", out)


def test_results_have_the_names(cart_run):
    out, printed = cart_run
    summary = json.loads((out / "summary.json").read_text())
    assert [body["name"] for body in summary["bodies"]] == NAMES[:4]
    assert summary["receipt"]["body_names"] == NAMES[:4]
    flux = [term for term in summary["terms"] if term["mechanism"] == "heat_flux"]
    assert [(term["bodies"], term["body_names"]) for term in flux] == [([3], ["roof"])]
    # Both wheels lose what their surfaces lose, the roof gains 100 W/m^2 on two faces.
    left, right, _, roof = summary["bodies"]
    assert left["energy"]["convection_J"] == right["energy"]["convection_J"]
    assert left["energy"]["convection_J"][-1] < 0.0
    gain = roof["energy"]["heat_flux_J"][-1]
    assert gain == pytest.approx(2 * 0.4 * 100.0 * 20.0, rel=1e-4)
    for body in (left, roof):
        kelvin = body["surface_temperature_K"]
        assert kelvin["min"][-1] - 1e-6 <= kelvin["mean"][-1]
        assert kelvin["mean"][-1] <= kelvin["max"][-1] + 1e-6
    header = (out / "energy.csv").read_text().splitlines()[0]
    assert "body 3 (roof): heat_flux_J" in header
    assert "body 3 (roof)" in printed
    (frame,) = (out / "frames").glob("*.exr")
    _, notes = read_exr(frame)
    assert json.loads(notes["bodies"]) == dict(zip("0123", NAMES, strict=False))


def test_the_config_of_a_run_is_the_same_scene_of_bodies(cart_run):
    out, _ = cart_run
    config = load_config(out / "config.yaml")
    assert config.assembly is None
    assert [body.name for body in config.bodies] == NAMES[:4]
    mesh = config.bodies[1].mesh
    assert mesh is not None
    assert mesh.part == "wheel_right/wheel/-"


def test_exported_meshes_have_the_names(cart_run, tmp_path):
    out, _ = cart_run
    succeed("export", out, "--format", "glb", "--out", tmp_path)
    (path,) = tmp_path.glob("*.glb")
    for number, name in enumerate(NAMES[:4]):
        assert f"body{number}_{name}".encode() in path.read_bytes()


def test_a_frame_is_drawn_again(cart_run, tmp_path):
    out, _ = cart_run
    succeed("render", out, "--out", tmp_path, "--set", "camera.width=32")
    assert np.isfinite(
        read_exr(next((tmp_path / "frames").glob("*.exr")))[0]["radiance"]
    ).all()


def test_a_mistake_of_a_rule_is_one_line(tmp_path):
    write_cart(tmp_path)
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.replace("match: roof", "match: rof"))
    line = refused("simulate", path, "--explain")
    assert (
        "assembly.parts.2.match: there is no part 'rof'; there are wheel_left" in line
    )


def test_the_time_of_very_many_bodies_is_told_beforehand(tmp_path, monkeypatch):
    write_cart(tmp_path)
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    assert "until the first step" not in succeed("simulate", path, "--explain")
    monkeypatch.setattr(simulate, "_VERY_MANY", 4)
    first = succeed("simulate", path, "--explain").splitlines()[0]
    assert re.fullmatch(r"\d bodies: at least \d+ s more until the first step", first)


@pytest.mark.slow
def test_many_bodies_are_explained_in_few_lines(tmp_path):
    size = "[4 cm, 4 cm, {height} cm]"
    bodies = [
        f"  - {{name: box {n}, shape: {{kind: box, size: "
        f"{size.format(height=4 + n % 4)}}}, pitch: 2 cm, material: copper, "
        f"temperature: 300, pose: {{translation: [{0.1 * n}, 0, 0]}}}}"
        for n in range(20)
    ]
    path = tmp_path / "many.yaml"
    path.write_text(MANY.format(bodies="\n".join(bodies)))
    printed = succeed("simulate", path, "--explain")
    assert "20 bodies of 4 kinds:" in printed
    assert "5 bodies (body 0 (box 0), body 4 (box 4), body 8 (box 8), ..)" in printed
    assert len(printed.splitlines()) <= 60
