"""Air inside bodies, in files."""

import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config
from jaxthermo.errors import InputError


SCENE = """
bodies:
  - shape: {kind: box, size: [20 cm, 20 cm, 20 cm]}
    pitch: 10 cm
    material: steel
    temperature: 20 degC
  - shape: {kind: box, size: [1 m, 1 m, 1 m]}
    sheet: {layers: [{material: steel, thickness: 1 mm}], pitch: 50 cm}
    temperature: 20 degC
    interior: INTERIOR
terms:
  - {kind: convection, heat_transfer_coefficient: 20, temperature: 5 degC}
time: {end: 60, save_at: [60]}
"""
AIR = "{temperature: 25 degC, heat_transfer_coefficient: 5 W/(m^2 K)}"


@pytest.fixture
def load(tmp_path):
    def loaded(interior: str, *overrides: str):
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.replace("INTERIOR", interior))
        return load_config(path, overrides)

    return loaded


def test_it_is_a_term_on_the_inside_of_its_body(load):
    *_, air = load(AIR).build_terms()
    assert air == jt.InteriorAir(5.0, 298.15, body=1)
    scene = load(AIR).build()
    receipt = jt.compile_scene(scene).receipt
    acting = {(part.mechanism, part.bodies) for part in receipt.parts}
    assert ("interior_air", (0,)) in acting
    assert ("interior_air", (1,)) in acting
    assert ("convection", (0,)) not in acting


@pytest.mark.parametrize(
    ("interior", "overrides", "words"),
    [
        ("{temperature: 25 degC}", (), "interior.heat_transfer_coefficient: missing"),
        (AIR.replace("5 W", "-5 W"), (), "interior.heat_transfer_coefficient: must"),
        (AIR, ("bodies.1.inside=open",), "interior: outer air is in the cavities"),
    ],
)
def test_mistakes_have_one_line(load, interior, overrides, words):
    with pytest.raises(InputError, match="bodies.1." + words):
        load(interior, *overrides)
