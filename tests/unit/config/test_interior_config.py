"""Air inside bodies, in files."""

import pytest
from numpy.testing import assert_array_equal

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


VOLUME = "{air: {AIR}, heat_transfer_coefficient: 5 W/(m^2 K)}"


def with_air(text):
    return VOLUME.replace("AIR", text)


def test_a_volume_of_air_is_a_body_after_all_others(load):
    text = "volume: 0.9 m^3, exchange: 2 1/h, outside: 5 degC, temperature: 30 degC"
    scene = load(with_air(text)).build()
    *_, air = scene.bodies
    assert len(scene.bodies) == 3
    assert air.structure.volume == 0.9
    assert air.temperature == pytest.approx(303.15)
    *_, term = scene.terms
    assert term == jt.EnclosedAir(5.0, 2 / 3600, 278.15, body=1, air=2)


def test_its_volume_is_that_of_the_closed_sheet(load):
    *_, air = load(with_air("")).build().bodies
    assert air.structure.volume == pytest.approx(1.0, rel=1e-9)
    assert air.temperature == pytest.approx(293.15)


def test_air_from_outdoors_has_the_temperature_of_its_weather(load):
    pytest.importorskip("pvlib")
    outdoors = (
        "{place: {latitude: 48 deg, longitude: 11 deg}, "
        "start: 2026-06-21T06:00+02:00, clear_sky: {air: [10 degC, 20 degC]}}"
    )
    config = load(with_air("exchange: 1 1/h"), f"outdoors={outdoors}", "terms=[]")
    terms = config.build_terms()
    (wind,) = [term for term in terms if term.name == "wind"]
    (air,) = [term for term in terms if term.name == "interior_air"]
    assert_array_equal(air.temperature.values, wind.temperature.values)


OPEN_TRAY = "bodies.1.shape={kind: tray, size: [1 m, 1 m, 1 m]}"


@pytest.mark.parametrize(
    ("text", "override", "words"),
    [
        ("", OPEN_TRAY, "bodies.1.interior.air: .* encloses no air; its mesh"),
        ("volume: 1 m^3", OPEN_TRAY, "body 1 encloses no air; its mesh has a border"),
    ],
)
def test_air_needs_a_closed_body(load, text, override, words):
    config = load(with_air(text), override)
    with pytest.raises(InputError, match=words) as error:
        jt.compile_scene(config.build())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("interior", "overrides", "words"),
    [
        ("{temperature: 25 degC}", (), "interior.heat_transfer_coefficient: missing"),
        (AIR.replace("5 W", "-5 W"), (), "interior.heat_transfer_coefficient: must"),
        (AIR, ("bodies.1.inside=open",), "interior: outer air is in the cavities"),
        (with_air("volume: 0 m^3"), (), "interior.air.volume: must be more than 0"),
        (with_air("exchange: -1 1/h"), (), "interior.air.exchange: must be"),
        (with_air("exchange: 1 1/h"), (), "interior.air.outside: missing"),
        (with_air("size: 1"), (), "interior.air.size: unknown key"),
        (with_air("volume: 1 m"), (), "interior.air.volume: expected a volume"),
        (AIR.replace("{", "{air: {}, "), (), "interior.air: give `temperature` or"),
        ("{heat_transfer_coefficient: 5}", (), "interior: missing `temperature` or"),
    ],
)
def test_mistakes_have_one_line(load, interior, overrides, words):
    with pytest.raises(InputError, match="bodies.1." + words):
        load(interior, *overrides)
