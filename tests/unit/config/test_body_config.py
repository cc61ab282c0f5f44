"""What bodies are made of and how they move: read, written out again, and built."""

import math

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import config_hash, load_config, to_yaml
from jaxthermo.config.schema.body import _MotionConfig
from jaxthermo.errors import InputError
from jaxthermo.material.material import Material, Property
from jaxthermo.scene.body_materials import MaterialLabels
from jaxthermo.scene.motion import Motion


SCENE = """
bodies:
  - shape: {{kind: box, size: [0.04, 0.04, 0.04]}}
    pitch: 1 cm
    material: {material}
    temperature: 20 degC
    {lines}
time: {{end: 60, save_at: [60]}}
"""

WARM = "{temperatures: [0 degC, 100 degC], values: [10, 20]}"
VARYING = f"{{name: copper, conductivity: {WARM}}}"


@pytest.fixture
def scene(tmp_path):
    """A function from a material and lines of a body, and overrides, to the config."""
    np.save(tmp_path / "parts.npy", np.arange(64).reshape(4, 4, 4) % 2)

    def load(material: str = "copper", lines: str = "", *overrides: str):
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(material=material, lines=lines))
        config = load_config(path, overrides)
        path.write_text(to_yaml(config))
        assert load_config(path) == config
        return config

    return load


def test_a_property_by_temperature(scene):
    body = scene(f"{{name: copper, conductivity: {WARM}, specific_heat: {WARM}}}")
    material = body.bodies[0].build_materials()
    assert isinstance(material, Material)
    for table in (material.conductivity, material.specific_heat):
        assert isinstance(table, Property)
        assert float(table(273.15 + 25)) == pytest.approx(12.5)


def test_tables_of_temperature_beside_other_materials_and_by_axis(scene):
    painted = scene(VARYING, PAINT.replace("gold", VARYING)).bodies[0]
    materials = painted.build_materials().materials
    assert [type(m.conductivity) for m in materials] == [Property, Property]
    by_axis = f"{{name: copper, conductivity: [1, {WARM}, 3]}}"
    along = scene(by_axis).bodies[0].build_materials().conductivity
    assert along[0] == 1.0 and isinstance(along[1], Property)
    assert float(along[1](273.15 + 50)) == pytest.approx(15.0)


def test_a_conductivity_for_each_axis(scene):
    config = scene("{name: copper, conductivity: [1, 2, 3 kW/(m K)]}")
    assert config.bodies[0].build_materials() == Material(
        (1.0, 2.0, 3000.0), 8960.0, 385.0, 0.05
    )
    again = scene("copper", "", "bodies.0.material.conductivity=[1, 2, 3e3]")
    assert again.bodies == config.bodies


def test_a_material_for_each_label(scene, tmp_path):
    config = scene("{labels: parts.npy, materials: [copper, {name: gold}]}")
    body = config.bodies[0].build()
    assert isinstance(body.material, MaterialLabels)
    assert body.material.materials == (jt.materials["copper"], jt.materials["gold"])
    number = body.material.of_nodes(body.structure)
    assert np.bincount(number).tolist() == [32, 32]
    first = config_hash(config)
    np.save(tmp_path / "parts.npy", np.zeros((4, 4, 4), int))
    assert config_hash(config) != first


def test_a_pose_at_each_time(scene):
    turn = "rotation: {axis: [0, 0, 1], angle: 90 deg}"
    poses = f"[{{translation: [1, 0, 0]}}, {{translation: [2, 0, 0], {turn}}}]"
    config = scene("copper", f"pose: {{times: [0, 1 min], poses: {poses}, every: 5 s}}")
    motion = config.bodies[0].pose.build()
    assert isinstance(motion, Motion) and motion.every == 5.0
    halfway = motion.at(30.0)
    assert halfway.translation == (1.5, 0.0, 0.0)
    turned = halfway.rotate(np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(turned, [[math.sqrt(0.5), math.sqrt(0.5), 0]], atol=1e-9)


def test_a_motion_can_be_taken_anew_more_often(scene):
    pose = "pose: {times: [0, 9], poses: [{}, {translation: [1, 0, 0]}]}"
    seldom = scene("copper", pose).bodies[0].pose
    assert isinstance(seldom, _MotionConfig) and seldom.every is None
    often = scene("copper", pose, "bodies.0.pose.every=100 ms").bodies[0].pose
    assert isinstance(often, _MotionConfig) and often.every == 0.1


PAINT = "regions: [{lower: [0, 0, 0], upper: [1, 1, 1], material: gold}]"
LABELS = "{labels: parts.npy, materials: [copper, gold]}"


@pytest.mark.parametrize(
    ("material", "lines", "message"),
    [
        ("{name: copper, conductivity: [1, 2]}", "",
         "material.conductivity: expected three numbers [x, y, z], got [1, 2]"),
        ("{name: copper, conductivity: [1, 2, -3]}", "",
         "material.conductivity.2: must be more than 0"),
        ("{name: copper, conductivity: {temperatures: [300, 400], values: [16, -2]}}",
         "", "material.conductivity.values.1: must be more than 0, got -2"),
        ("{name: copper, specific_heat: {temperatures: [400, 300], values: [1, 2]}}",
         "", "material.specific_heat.temperatures.1: 300 K is not after 400 K"),
        ("{name: copper, specific_heat: {temperatures: [300], values: [1, 2]}}",
         "", "material.specific_heat.values: there are 2 values for 1 temperatures"),
        ("{name: copper, specific_heat: [1, 2, 3]}", "",
         "material.specific_heat: expected a specific heat such as"),
        ("{name: copper, emissivity: 1.2}", "", "material.emissivity: must be at most"),
        (LABELS, PAINT, "regions: the labels of `material` say what is where"),
        ("{labels: none.npy, materials: [gold]}", "",
         "material.labels: there is no file 'none.npy'"),
        ("{labels: parts.npy}", "", "material.materials: missing"),
        ("{labels: parts.npy, materials: []}", "",
         "material.materials: must not be empty"),
        ("{labels: parts.npy, materials: [golt]}", "",
         "material.materials.0.name: unknown material 'golt'; did you mean 'gold'?"),
        ("copper", "pose: {times: [0, 1], poses: [{}]}",
         "pose.poses: there are 1 poses for 2 times"),
        ("copper", "pose: {times: [1, 1], poses: [{}, {}]}",
         "pose.times.1: 1 s is not after 1 s"),
        ("copper", "pose: {times: [], poses: []}", "pose.times: must not be empty"),
        ("copper", "pose: {times: [0], poses: [{}], every: 0}",
         "pose.every: must be more than 0"),
        ("copper", "pose: {times: [0], poses: [{}], translation: [1, 0, 0]}",
         "pose.translation: unknown key"),
    ],
)  # fmt: skip
def test_each_mistake_is_one_line_with_its_path(refused, material, lines, message):
    (line,) = refused(material, lines)
    assert f"bodies.0.{message}" in line


def test_coatings(scene, refused, tmp_path):
    values = np.linspace(0.0, 1.0, 96)
    np.save(tmp_path / "eps.npy", values)
    body = scene(
        "copper",
        "coatings: [{emissivity: 50 %, on: {side: {normal: [0, 0, 1]}}}, "
        "{absorptivity: {fragments: eps.npy}, on: {not: {region: {lower: [0, 0, 0], "
        "upper: [1, 1, 1]}}}}]",
    ).bodies[0]
    top, bottom = body.build().coatings
    assert top == jt.Coating(0.5, on=jt.Side((0.0, 0.0, 1.0)))
    assert bottom.on == ~jt.Region((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert bottom.emissivity is None
    np.testing.assert_array_equal(bottom.absorptivity, values)
    assert refused("copper", "coatings: [{emissivity: 2}, {on: {body: 0}}]") == [
        "bodies.0.coatings.0.emissivity: must be at most 1, got 2",
        "bodies.0.coatings.1: missing `finish`, `emissivity` or `absorptivity`: "
        "give one of them",
    ]
    named = scene(
        "copper",
        "coatings: ['car paint, white', {finish: 'car paint, black', "
        "absorptivity: 0.9, on: {side: {normal: [0, 0, 1]}}}, plywood]",
    ).bodies[0]
    paint, hood, wood = named.build().coatings
    assert paint == jt.Coating(0.9, absorptivity=0.4)
    assert hood == jt.Coating(0.83, absorptivity=0.9, on=jt.Side((0.0, 0.0, 1.0)))
    assert wood == jt.Coating(0.82)
    (line,) = refused("copper", "coatings: ['car paint white']")
    assert line == (
        "bodies.0.coatings.0.finish: unknown finish 'car paint white'; "
        "did you mean 'car paint, white'?"
    )
    np.save(tmp_path / "eps.npy", 2 * values)
    with pytest.raises(InputError, match="eps.npy: expected numbers from 0 to 1"):
        body.coatings[1].build()


SURFACES = {
    "rectangle": ("width: 2 m, length: 3 m", 6.0),
    "disc": ("radius: 50 cm", np.pi / 4),
    "polygon": ("points: [[0, 0, 0], [1 m, 0, 0], [1, 0, 1], [0, 0, 2]]", 1.5),
    "pipe": ("radius: 50 cm, height: 3", 3.0 * np.pi),
    "tray": ("size: [1, 2, 3]", 20.0),
}


@pytest.mark.parametrize("kind", list(SURFACES))
def test_open_shapes_have_their_areas(scene, kind):
    keys, area = SURFACES[kind]
    config = scene("copper", "", f"bodies.0.shape={{kind: {kind}, {keys}}}")
    mesh = config.bodies[0].build_mesh()
    assert mesh.area == pytest.approx(area)
    assert not mesh.is_watertight


def test_a_prism_has_its_volume(scene, refused):
    triangle = "{kind: prism, points: [[0, 0], [1, 0], [0, 2 m]], height: 50 cm}"
    config = scene("copper", "", f"bodies.0.shape={triangle}")
    assert config.bodies[0].build_mesh().volume == pytest.approx(0.5)
    line = "{kind: prism, points: [[0, 0], [1, 0]], height: 1}"
    (message,) = refused("copper", "", f"bodies.0.shape={line}")
    assert message.endswith("shape.points: give three or more points, got 2")
