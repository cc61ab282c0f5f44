"""`joints:` of a scene and of an assembly."""

import math

import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config, to_yaml
from jaxthermo.errors import InputError
from tests.assemblies import write_cart


BODIES = """
bodies:
  - {name: left, shape: {kind: box, size: [2 cm, 2 cm, 2 cm]}, pitch: 1 cm,
     material: copper, temperature: 300}
  - {name: right, shape: {kind: box, size: [2 cm, 2 cm, 2 cm]}, pitch: 1 cm,
     material: copper, temperature: 300, pose: {translation: [2 cm, 0, 0]}}
"""
TIME = "time: {end: 60, save_every: 60}\n"


@pytest.fixture
def scene(tmp_path):
    """A function from `joints` to the config, which is written out again."""
    path = tmp_path / "scene.yaml"

    def load(joints, bodies=BODIES):
        path.write_text(f"{bodies}joints: {joints}\n{TIME}")
        config = load_config(path)
        path.write_text(to_yaml(config))
        assert load_config(path) == config
        return config

    return load


def test_rules_are_contacts_in_their_order(scene):
    config = scene(
        "{default: bonded, threshold: 1 mm, pairs: [{parts: [left, right], "
        "conductance: 2 kW/(m^2 K), threshold: 3 mm}, {parts: ['l*', [left, right]], "
        "conductance: bonded}]}"
    )
    pair = ((0,), (1,))
    assert config.build_terms() == (
        jt.Contact(2000.0, bodies=pair, threshold=3e-3),
        jt.Contact(math.inf, bodies=((0,), (0, 1)), threshold=1e-3),
        jt.Contact(math.inf, threshold=1e-3),
    )


def test_sheets_have_seams_and_none_leaves_bodies_apart(scene):
    wall = (
        "  - {name: wall, shape: {kind: rectangle, width: 1, length: 1}, sheet: "
        "{layers: [{material: copper, thickness: 1 mm}]}, temperature: 300}\n"
    )
    config = scene("{default: 50}", BODIES + wall)
    assert config.build_terms() == (jt.Contact(50.0), jt.Seam(50.0))
    assert scene("{default: none}").build_terms() == ()
    assert scene("{}").build_terms() == ()


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ("{pairs: [{parts: [left, x], conductance: 1}]}",
         "joints.pairs.0.parts.1: no body has the name 'x'; there are left, right"),
        ("{pairs: [{parts: [right, x], conductance: 1}]}",
         "joints.pairs.0.parts.1: no body has the name 'x'; there are left, right"),
        ("{pairs: [{parts: [left, 'le*'], conductance: 1}]}",
         "joints.pairs.0.parts: is one body twice: name two bodies"),
        ("{pairs: [{parts: [left], conductance: 1}]}",
         "joints.pairs.0.parts: expected two values"),
        ("{pairs: [{parts: [left, right]}]}", "joints.pairs.0.conductance: missing"),
        ("{default: welded}", "joints.default"),
        ("{default: -1}", "joints.default: must be at least 0"),
    ],
)  # fmt: skip
def test_wrong_joints_are_told(scene, joints, message):
    pattern = message.replace(".", r"\.").split("*")[0]
    with pytest.raises(InputError, match=pattern) as refused:
        scene(joints)
    assert "\n" not in str(refused.value)


def test_an_assembly_has_joints(tmp_path):
    write_cart(tmp_path)
    path = tmp_path / "scene.yaml"
    text = (
        "assembly:\n  mesh: {path: cart.glb, unit: m}\n  pitch: 4 cm\n"
        "  temperature: 300\n"
        "  parts: [{match: 'wheel*', material: copper}, {match: '*', ignore: true}]\n"
        "  joints: {pairs: [{parts: ['wheel_l*', 'wheel_r*'], conductance: 9}]}\n"
    )
    path.write_text(text + TIME)
    (contact,) = load_config(path).build_terms()
    assert contact.conductance == 9.0
    path.write_text(text + "joints: {default: bonded}\n" + TIME)
    with pytest.raises(InputError, match=r"assembly\.joints: .*give one of them"):
        load_config(path)
