"""Loading: every file in configs/, overrides, meshes, and writing out again."""

import math
from pathlib import Path

import pytest

from jaxthermo.config.loader import config_hash, load_config, resolved, to_yaml
from jaxthermo.config.schema.geometry import PoseConfig, _Box
from jaxthermo.config.schema.image import OrthographicConfig
from jaxthermo.config.schema.material import _MaterialConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.schema.solver import _ForwardEuler
from jaxthermo.config.schema.terms import _ConvectionConfig, _SunConfig
from jaxthermo.config.schema.time import TimeConfig
from jaxthermo.config.types.varying import _Table


SCENES = Path(__file__).resolve().parents[3] / "configs" / "scenes"

FULL = """
allow_extreme_temperatures: true
dtype: float64
bodies:
  - shape: {kind: box, size: [10 cm, 0.1, 0.1]}
    pitch: 5 mm
    structure: {kind: full_volume}
    material: {name: copper, emissivity: 30 %}
    regions: [{lower: [0, 0, 0], upper: [1, 1, 1 cm], material: gold}]
    temperature: 100 K
    pose: {translation: [0, 0, 1], rotation: {axis: [0, 0, 1], angle: 30 deg}}
terms:
  - {kind: sun, direction: [0, 0, -1], irradiance: 1 kW/m^2, until: 90 s}
  - kind: convection
    heat_transfer_coefficient: 10
    temperature: {times: [0, 1 min], values: [20 degC, 30 degC]}
    on: {side: {normal: [1, 0, 0], body: 0}}
  - {kind: surroundings, temperature: 10 degC}
  - {kind: heat_flux, heat_flux: -5, on: {region: {lower: [0, 0, 0], upper: [1, 1, 1]}}}
  - {kind: fixed_temperature, temperature: 80 degC}
time: {end: 3 min, save_every: 50 s}
solver: {kind: forward_euler, dt: auto}
camera: {kind: orthographic, view_height: 0.6 m, position: [0, -1, 0], look_at: auto}
image: {low: 10 degC, high: auto, frames: [50, 180]}
"""


@pytest.fixture
def full(tmp_path) -> Path:
    path = tmp_path / "full.yaml"
    path.write_text(FULL)
    return path


def test_values_are_si(full):
    config = load_config(full)
    (body,) = config.bodies
    sun, convection = config.terms[:2]
    assert config.name == "full"
    assert isinstance(body.shape, _Box) and body.shape.size == (0.1, 0.1, 0.1)
    assert body.material == _MaterialConfig(name="copper", emissivity=0.3)
    assert isinstance(body.pose, PoseConfig) and body.pose.rotation is not None
    assert body.pose.rotation.angle == pytest.approx(math.pi / 6)
    assert isinstance(sun, _SunConfig) and sun.irradiance == 1000.0
    assert isinstance(convection, _ConvectionConfig)
    assert isinstance(convection.temperature, _Table)
    assert convection.temperature.times == (0.0, 60.0)
    assert convection.temperature.values == pytest.approx((293.15, 303.15))
    assert isinstance(config.camera, OrthographicConfig)
    assert config.camera.look_at is None
    assert config.time.save_times == (50.0, 100.0, 150.0, 180.0)


@pytest.mark.parametrize(("end", "interval", "count"), [(180, 30, 6), (1, 0.1, 10)])
def test_saving_at_every_step_ends_with_the_end(end, interval, count):
    times = TimeConfig.model_validate({"end": end, "save_every": interval}).save_times
    assert len(times) == count
    assert times[-1] == end


def test_written_out_it_loads_to_the_same(full, tmp_path):
    config = load_config(full)
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(config))
    assert load_config(again) == config
    assert config_hash(load_config(again)) == config_hash(config)


def test_overrides(full):
    config = load_config(
        full,
        (
            "bodies.0.voxels_high=30",
            "bodies.0.voxels_high=40",
            "terms.2.temperature=30 degC",
            "time.save_at=[1, 2]",
            "camera=auto",
            "camera.width=320",
            "image.frames=all",
            "solver.dt=1e-3",
            "name=a=b",
        ),
    )
    assert config.bodies[0].pitch is None and config.bodies[0].voxels_high == 40
    assert config.terms[2] == config.terms[2].model_copy(update={"temperature": 303.15})
    assert config.time.save_times == (1.0, 2.0)
    assert config.camera.width == 320 and config.camera.kind == "pinhole"
    assert config.solver == _ForwardEuler(dt=1e-3)
    assert config.name == "a=b"


def test_a_part_is_set_of_what_is_written_short(full):
    text = FULL.replace("{name: copper, emissivity: 30 %}", "copper")
    full.write_text(text)
    (body,) = load_config(full, ("bodies.0.material.emissivity=0.4",)).bodies
    assert body.material == _MaterialConfig(name="copper", emissivity=0.4)


def test_the_hash_follows_the_scene_and_the_mesh_but_not_the_folder(full, tmp_path):
    first = config_hash(load_config(full))
    assert len(first) == 16
    assert config_hash(load_config(full, ("bodies.0.pitch=4 mm",))) != first
    hashes = []
    for folder, content in (("a", "x"), ("b", "x"), ("c", "y")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "m.obj").write_text(content)
        scene = tmp_path / folder / "full.yaml"
        scene.write_text(FULL)
        override = "bodies.0.mesh={path: m.obj, unit: mm}"
        hashes.append(config_hash(load_config(scene, (override,))))
    assert hashes[0] == hashes[1] != hashes[2]


def test_meshes_are_found_beside_the_config_then_in_the_folders(full, monkeypatch):
    shelf = full.parent / "shelf"
    shelf.mkdir()
    (shelf / "m.obj").touch()
    monkeypatch.setenv("JAXTHERMO_MESHES", f"/nowhere:{shelf}")
    override = ("bodies.0.mesh={path: m.obj, height: 50 cm, up: -y}",)
    assert resolved(load_config(full, override))["bodies"][0]["mesh"] == {
        "path": str(shelf / "m.obj"),
        "height": 0.5,
        "up": "-y",
    }
    (full.parent / "m.obj").touch()
    mesh = load_config(full, override).bodies[0].mesh
    assert mesh is not None and mesh.path == full.parent / "m.obj"


@pytest.mark.parametrize(
    ("unit", "metres"), [("mm", 1e-3), (0.5, 0.5), ("2 in", 0.0508)]
)
def test_units_of_a_mesh(full, unit, metres):
    (full.parent / "m.obj").touch()
    override = f"bodies.0.mesh={{path: m.obj, unit: {unit}}}"
    mesh = load_config(full, (override,)).bodies[0].mesh
    assert mesh is not None and mesh.unit == pytest.approx(metres)


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.yaml")), ids=lambda p: p.stem)
def test_every_scene_loads(path, tmp_path, monkeypatch):
    for name in ("happy-buddha.obj", "max-planck.obj"):
        (tmp_path / name).touch()
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    config = load_config(path)
    assert isinstance(config, SceneConfig)
    assert config.name == path.stem
    assert len([term.build() for term in config.terms]) == len(config.terms)
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(config))
    assert load_config(again) == config
