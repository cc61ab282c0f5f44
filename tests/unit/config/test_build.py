"""Building: the config's values arrive in the objects that are simulated."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.loader import load_config
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.geometry import PartsShape, PoseConfig
from jaxthermo.config.schema.image import OrthographicConfig, PinholeConfig
from jaxthermo.config.schema.material import _MaterialConfig
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.image.surface.camera import Camera, OrthographicCamera
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.material.table import materials
from jaxthermo.physics.boundary import Convection, FixedTemperature, HeatFlux
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.physics.radiation.source import Sun
from jaxthermo.physics.time_varying import Table, Until
from jaxthermo.scene.body_materials import MaterialMap
from jaxthermo.voxels.selection import FragmentCentres, Region, Side


SCENE = """
dtype: float64
bodies:
  - shape: {kind: box, size: [0.1, 0.1, 0.2]}
    voxels_high: 10
    material: {name: copper, emissivity: 0.3}
    regions: [{lower: [-1, -1, 0], upper: [1, 1, 1], material: gold}]
    temperature: 20 degC
    pose: {translation: [0, 0, 1]}
terms:
  - {kind: sun, direction: [0, 0, -1], irradiance: 1 kW/m^2, until: 90 s}
  - kind: convection
    heat_transfer_coefficient: 10
    temperature: {times: [0, 60], values: [290, 300]}
    on: {side: {normal: [1, 0, 0]}}
  - {kind: surroundings, temperature: 280}
  - kind: heat_flux
    heat_flux: -5
    until: 30 s
    on: {region: {lower: [0, 0, 0], upper: [1, 1, 1]}}
  - {kind: fixed_temperature, temperature: 350}
time: {end: 60, save_at: [60]}
solver: {dt: 0.5}
"""


def test_a_side_without_a_body_is_that_of_all_bodies(tmp_path: Path):
    """As every term without `on` acts on all bodies; one with a body stays there."""
    box = "{shape: {kind: box, size: [0.1, 0.1, 0.1]}, pitch: 5 cm, "
    rest = "material: copper, temperature: 300}"
    fluxes = [
        f"{{kind: heat_flux, heat_flux: 1, on: {on}}}"
        for on in (
            "{side: {normal: [0, 0, 1]}}",
            "{side: {normal: [0, 0, 1], body: 1}}",
            "{all: [{side: {normal: [0, 0, 1]}}, {body: 1}]}",
            "{not: {side: {normal: [0, 0, 1]}}}",
        )
    ]
    path = tmp_path / "scene.yaml"
    path.write_text(
        f"bodies: [{box}{rest}, {box}{rest}]\n"
        f"terms: [{', '.join(fluxes)}]\n"
        "time: {end: 60, save_at: [60]}\n"
    )
    config = load_config(path)
    terms: Any = config.build_terms()
    everywhere, second, both, others = (term.on for term in terms)
    up = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    fragments = FragmentCentres(np.zeros((2, 3)), up)
    assert [s.bodies for s in (everywhere, second, both)] == [(0, 1), (1,), (1,)]
    for body in (0, 1):
        part = everywhere.on_body(body)
        assert part is not None and part.select(fragments).tolist() == [True, False]
        rest_of_body = others.on_body(body)
        assert rest_of_body is not None
        assert rest_of_body.select(fragments).tolist() == [False, True]
    with pytest.raises(InputError) as caught:
        load_config(path, ("terms.0.on.side.normal=[0, 0]",))
    assert "terms.0.on.side.normal" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_scene_holds_what_the_config_says(tmp_path: Path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    config = load_config(path)
    scene = config.build()
    (body,) = scene.bodies
    assert scene.dtype == "float64"
    assert config.solver.build() == ForwardEuler(dt=0.5)
    assert body.structure.node_count == 5 * 5 * 10
    assert body.temperature == pytest.approx(293.15)
    assert isinstance(body.material, MaterialMap)
    assert body.material.base.emissivity == 0.3
    assert body.material.painted[0][1] == materials["gold"]
    sun, convection, surroundings, flux, fixed = scene.terms
    assert isinstance(sun, Sun) and sun.irradiance == Until(1000.0, 90.0)
    assert isinstance(convection, Convection)
    assert convection.temperature == Table((0.0, 60.0), (290.0, 300.0))
    assert convection.on == Side(normal=(1.0, 0.0, 0.0), body=0)
    assert isinstance(surroundings, Surroundings) and surroundings.temperature == 280.0
    assert isinstance(flux, HeatFlux) and isinstance(flux.on, Region)
    assert flux.heat_flux == Until(-5.0, 30.0)
    assert isinstance(fixed, FixedTemperature) and fixed.on is None


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        ({"kind": "sphere", "radius": 0.05}, 4 / 3 * math.pi * 0.05**3),
        ({"kind": "cylinder", "radius": 0.03, "height": 0.1}, math.pi * 9e-5),
        ({"kind": "slab", "thickness": 0.02, "width": 0.1, "length": 0.1}, 2e-4),
    ],
)
def test_shapes_have_their_volume(shape, volume):
    config = BodyConfig.model_validate(
        {"shape": shape, "pitch": 0.01, "material": "copper", "temperature": 300}
    )
    grid = config.build().structure.grid
    assert grid.mesh.volume == pytest.approx(volume, rel=0.02)


@pytest.mark.parametrize("kind", ["cylinder", "capsule", "tube", "pipe", "disc"])
def test_round_shapes_have_the_sections_that_are_given(kind):
    """As many corners lie farthest from the axis at one height as there are sides."""
    keys = {"radius": 0.05}
    keys |= {} if kind == "disc" else {"height": 0.2}
    keys |= {"inner_radius": 0.02} if kind == "tube" else {}
    for sections, stated in ((64, {}), (12, {"sections": 12})):
        shape = PartsShape.model_validate(
            {
                "kind": "parts",
                "parts": {"round": {"shape": {"kind": kind, **keys, **stated}}},
            }
        )
        vertices = shape.build().vertices
        radius = np.hypot(*vertices[:, :2].T)
        rim = vertices[radius > radius.max() * (1 - 1e-9)]
        assert len(rim) / len(np.unique(rim[:, 2].round(9))) == sections


def test_a_rotation_turns_anticlockwise_about_its_axis():
    pose = PoseConfig.model_validate(
        {"translation": [1, 0, 0], "rotation": {"axis": [0, 0, 2], "angle": "90 deg"}}
    )
    placed = pose.build().at(0.0).to_world(np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(placed, [[1.0, 1.0, 0.0]], atol=1e-15)


def test_a_material_without_a_name():
    config = _MaterialConfig.model_validate(
        {"conductivity": 16, "density": 8000, "specific_heat": 500, "emissivity": 0.5}
    )
    built = config.build()
    assert (built.conductivity, built.absorptivity) == (16.0, 0.5)


@pytest.mark.parametrize("width", [30, 90])
@pytest.mark.parametrize(
    "config",
    [
        PinholeConfig(),
        PinholeConfig(field_of_view=1.0),
        PinholeConfig(look_at=(0.0, 0.0, 0.1)),
        PinholeConfig(up=(1.0, 0.0, 0.0)),
        OrthographicConfig(),
    ],
)
def test_a_camera_left_open_sees_everything(config, width):
    triangles = shapes.box((0.1, 0.2, 0.3)).triangles
    sized = config.model_copy(update={"width": width, "height": 60})
    camera = build_camera(sized, triangles)
    raster, _ = camera.to_raster(triangles)
    inside = raster.reshape(-1, 3)[:, :2]
    assert (inside >= 0).all() and (inside <= (width, 60)).all()


def test_a_camera_stands_where_the_config_says():
    triangles = shapes.box(0.1).triangles
    pinhole = build_camera(
        PinholeConfig(position=(0.0, -1.0, 0.0), field_of_view=0.4), triangles
    )
    assert isinstance(pinhole, Camera) and pinhole.position == (0.0, -1.0, 0.0)
    assert pinhole.field_of_view == 0.4
    flat = build_camera(OrthographicConfig(view_height=0.6), triangles)
    assert isinstance(flat, OrthographicCamera) and flat.view_height == 0.6
