"""Every kind of term in a config: read, written out again, and built as it says."""

import math
from typing import get_args

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import config_hash, load_config, to_yaml
from jaxthermo.config.schema.selection import WhereConfig
from jaxthermo.config.schema.terms import (
    TermConfig,
    _AreaSourceConfig,
    _HeatFluxConfig,
    _WakeDeficitConfig,
    _WindConfig,
)
from jaxthermo.physics.convection.nusselt import AVERAGES
from jaxthermo.physics.term import AbstractTerm


SCENE = """
bodies:
  - &cube
    shape: {{kind: box, size: [0.04, 0.04, 0.04]}}
    pitch: 1 cm
    material: copper
    temperature: 20 degC
  - *cube
terms: [{terms}]
time: {{end: 60, save_at: [60]}}
"""

TABLE = "{times: [0, 1 min], values: [1, 2 kW/m^2]}"

TERMS = {
    "{kind: sun, direction: [0, 0, -1], irradiance: 1 kW/m^2, until: 9}": jt.Sun(
        (0.0, 0.0, -1.0), jt.Until(1000.0, 9.0)
    ),
    "{kind: sun, direction: {times: [0, 1 h], values: [[1, 0, -1], [0, 0, -2]]}, "
    f"irradiance: {TABLE}}}": jt.Sun(
        jt.DirectionTable((0.0, 3600.0), ((1.0, 0.0, -1.0), (0.0, 0.0, -2.0))),
        jt.Table((0.0, 60.0), (1.0, 2000.0)),
    ),
    "{kind: point_source, position: [1 m, 0, 50 cm], radiant_intensity: 20 W/sr}": (
        jt.PointSource((1.0, 0.0, 0.5), 20.0)
    ),
    "{kind: point_source, position: {times: [0, 5], values: [[1, 0, 0], [0, 1, 0]]}, "
    "radiant_intensity: 3, min_distance: 2 cm, until: 4}": jt.PointSource(
        jt.PointTable((0.0, 5.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),
        jt.Until(3.0, 4.0),
        min_distance=0.02,
    ),
    "{kind: area_source, centre: [0, 0, 1], normal: [0, 0, -1], size: [1, 20 cm], "
    "radiance: 5 W/(m^2 sr), patches: 2, up: [0, 1, 0]}": jt.AreaSource(
        (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.2), 5.0,
        patches=2, up=(0.0, 1.0, 0.0),
    ),
    "{kind: area_source, centre: [0, 0, 1], normal: [0, 0, -1], size: [1, 1], "
    "temperature: 800, emissivity: 0.8, until: 3}": jt.AreaSource(
        (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 1.0),
        temperature=jt.Until(800.0, 3.0), emissivity=0.8,
    ),
    "{kind: diffuse_sky, irradiance: 100 W/m^2, reflected: 30}": jt.DiffuseSky(
        100.0, 30.0
    ),
    "{kind: surroundings, temperature: 280}": jt.Surroundings(280.0),
    "{kind: surroundings, temperature: 250, ground: 290, occlusion: 64, "
    "linear_within: 2 %}": (
        jt.Surroundings(250.0, ground=290.0, occlusion=64, linear_within=0.02)
    ),
    "{kind: radiative_exchange, temperature: 280}": jt.RadiativeExchange(280.0),
    "{kind: radiative_exchange, temperature: 280, max_patches: 32, directions: 16}": (
        jt.RadiativeExchange(280.0, max_patches=32, directions=16)
    ),
    "{kind: radiative_exchange, temperature: 250, ground: 290, error: 2 %, "
    "max_directions: 1000}": (
        jt.RadiativeExchange(250.0, ground=290.0, error=0.02, max_directions=1000)
    ),
    "{kind: convection, heat_transfer_coefficient: 10, temperature: 290}": (
        jt.Convection(10.0, 290.0)
    ),
    "{kind: wind, velocity: [0, 3 m/s, 0], temperature: 290}": jt.Wind(
        (0.0, 3.0, 0.0), 290.0
    ),
    "{kind: wind, velocity: [0, 36 km/h, 0], temperature: 290, speed: {times: [0, 1], "
    "values: [1, 2 m/s]}, average: profile, wake: {amplitude: 0.9}, cylinders: "
    "[{axis_point: [0, 0, 1 cm], axis: [0, 0, 1], diameter: 3 cm, body: 1}]}": jt.Wind(
        (0.0, 10.0, 0.0), 290.0, speed=jt.Table((0.0, 1.0), (1.0, 2.0)),
        average="profile", wake=jt.WakeDeficit(amplitude=0.9),
        cylinders=[jt.Cylinder((0.0, 0.0, 0.01), (0.0, 0.0, 1.0), 0.03, body=1)],
    ),
    "{kind: wind, velocity: [0, 3, 0], temperature: 290, wake: fitted}": jt.Wind(
        (0.0, 3.0, 0.0), 290.0, wake=jt.FittedWake()
    ),
    "{kind: sun, direction: [0, 0, -1], irradiance: 9, on: {not: {any: [{body: 1}, "
    "{side: {normal: [1, 0, 0], body: 0}}]}}}": jt.Sun(
        (0.0, 0.0, -1.0), 9.0, on=~(jt.Everything(1) | jt.Side((1.0, 0.0, 0.0)))
    ),
    "{kind: linear_wind, speed: 36 km/h, temperature: 290, calm: 4, by_speed: 2 "
    "J/(m^3 K)}": jt.LinearWind(10.0, 290.0, calm=4.0, by_speed=2.0),
    "{kind: free_convection, temperature: 290}": jt.FreeConvection(290.0),
    "{kind: free_convection, temperature: 290, on: {all: [{side: {normal: [1, 0, 0], "
    "body: 0}}, {region: {lower: [0, 0, 0], upper: [1, 1, 1]}}]}}": jt.FreeConvection(
        290.0, on=jt.Side((1.0, 0.0, 0.0))
        & jt.Region((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    ),
    "{kind: heat_source, heat_rate_density: 5, within: {not: {region: {lower: [0, 0, "
    "0], upper: [1, 1, 1]}}}}": jt.HeatSource(
        5.0, within=~jt.Region((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    ),
    "{kind: free_convection, temperature: 290, length: 4 cm}": (
        jt.FreeConvection(290.0, length=0.04)
    ),
    "{kind: free_convection, temperature: 290, body_shape: plate}": (
        jt.FreeConvection(290.0, body_shape="plate")
    ),
    "{kind: wind, velocity: [0, 3, 0], temperature: 290, body_shape: sphere}": jt.Wind(
        (0.0, 3.0, 0.0), 290.0, body_shape="sphere"
    ),
    "{kind: heat_flux, heat_flux: -5, on: {body: 1}}": jt.HeatFlux(
        -5.0, on=jt.Everything(body=1)
    ),
    "{kind: heat_flux, heat_flux: 5, on: {side: {normal: [1, 0, 0], half_angle: "
    "180 deg, body: 0}}}": jt.HeatFlux(
        5.0, on=jt.Side((1.0, 0.0, 0.0), half_angle=math.pi)
    ),
    "{kind: fixed_temperature, temperature: 350, on: {region: {lower: [0, 0, 0], "
    "upper: [1, 1, 1], body: 1}}}": jt.FixedTemperature(
        350.0, on=jt.Region((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), body=1)
    ),
    "{kind: heat_source, heat_rate_density: 5 kW/m^3, until: 3}": jt.HeatSource(
        jt.Until(5000.0, 3.0)
    ),
    "{kind: heat_source, heat_rate_density: 5, within: {body: 1}}": jt.HeatSource(
        5.0, within=jt.Everything(body=1)
    ),
    "{kind: heat_source, heat_rate_density: 5, within: {region: {lower: [0, 0, 0], "
    "upper: [1, 1, 1]}}}": jt.HeatSource(
        5.0, within=jt.Region((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    ),
    "{kind: contact, conductance: 1 kW/(m^2 K)}": jt.Contact(1000.0),
    "{kind: contact, conductance: bonded}": jt.bonded,
    "{kind: contact, conductance: {times: [0, 1], values: [0, 9]}, bodies: [1, 0], "
    "threshold: 2 mm, gap_length: 1 mm, max_pairs: 99}": jt.Contact(
        jt.Table((0.0, 1.0), (0.0, 9.0)), bodies=(1, 0), threshold=0.002,
        gap_length=0.001, max_pairs=99,
    ),
    "{kind: seam, conductance: bonded}": jt.Seam(math.inf),
    "{kind: seam, conductance: 500, bodies: [0, 1], threshold: 2 mm, max_pairs: 9}":
        jt.Seam(500.0, bodies=(0, 1), threshold=0.002, max_pairs=9),
}  # fmt: skip


def same(built, expected) -> bool:
    """Whether two terms are equal, though some of their fields are arrays."""
    if isinstance(expected, int | float | np.ndarray):
        return built == pytest.approx(expected, rel=1e-12)
    if isinstance(expected, jt.Table | AbstractTerm):
        fields = expected.__dataclass_fields__
        return type(built) is type(expected) and all(
            same(getattr(built, field), getattr(expected, field)) for field in fields
        )
    return built == expected


@pytest.fixture
def scene(tmp_path):
    """A function from terms in YAML, and overrides, to the config."""

    def load(terms: str, *overrides: str):
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(terms=terms))
        return load_config(path, overrides)

    return load


@pytest.mark.parametrize("text", TERMS, ids=lambda text: text.split(",")[0][7:])
def test_each_is_built_as_the_config_says(scene, text):
    (config,) = scene(text).terms
    built = config.build()
    assert same(built, TERMS[text]), built


def test_every_kind_is_built():
    members = get_args(get_args(TermConfig)[0])
    names = {member.model_fields["kind"].default for member in members}
    assert names == {text.split(",")[0].removeprefix("{kind: ") for text in TERMS}


def test_all_together_load_again_from_what_is_written(scene, tmp_path):
    listed = [t for t in TERMS if "radiative" not in t and "occlusion" not in t]
    config = scene(", ".join(listed))
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(config))
    assert load_config(again, ("name=scene",)) == config
    assert len(config.terms) == len(listed)


def test_terms_can_be_set(scene):
    wind = "{kind: wind, velocity: [0, 3, 0], temperature: 290, wake: deficit}"
    flux = "{kind: heat_flux, heat_flux: 1, on: {side: {normal: [1, 0, 0]}}}"
    lamp = (
        "{kind: area_source, centre: [0, 0, 1], normal: [0, 0, -1], size: [1, 1], "
        "temperature: 800}"
    )
    config = scene(
        ", ".join((wind, flux, lamp)),
        "terms.0.wake.amplitude=0.9",
        "terms.0.speed=5 km/h",
        "terms.1.on.body=1",
        "terms.2.radiance=7",
    )
    blown, heated, lit = config.terms
    assert isinstance(blown, _WindConfig)
    assert blown.wake == _WakeDeficitConfig(amplitude=0.9)
    assert blown.speed == pytest.approx(5 / 3.6)
    assert heated == _HeatFluxConfig(heat_flux=1, on=WhereConfig(body=1))
    assert isinstance(lit, _AreaSourceConfig)
    assert (lit.radiance, lit.temperature) == (7.0, None)


def test_defaults_and_choices_are_those_of_the_library():
    assert _WakeDeficitConfig() == _WakeDeficitConfig(
        **{f: getattr(jt.WakeDeficit(), f) for f in ("amplitude", "length", "exponent")}
    )
    choices = _WindConfig.model_json_schema()["properties"]["average"]["enum"]
    assert choices == [average.name for average in AVERAGES]


@pytest.mark.parametrize("marks", [np.array([True, False]), np.ones(3)])
def test_fragments_by_a_file(scene, tmp_path, marks):
    np.save(tmp_path / "hot.npy", marks)
    text = "{kind: heat_flux, heat_flux: 1, on: {fragments: {mask: hot.npy, body: 1}}}"
    config = scene(text)
    if marks.dtype != bool:
        with pytest.raises(jt.InputError, match="expected one true or false"):
            config.terms[0].build()
        return
    built = config.terms[0].build()
    assert built == jt.HeatFlux(1.0, on=jt.FragmentMask(marks, body=1))
    first = config_hash(config)
    np.save(tmp_path / "hot.npy", ~marks)
    assert config_hash(config) != first


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ("{kind: point_source, position: [0, 0, 1], radiant_intensity: 5 W}",
         "radiant_intensity: expected a radiant intensity such as '20 W/sr', got"),
        ("{kind: sun, direction: [0, 0, 1], irradiance: 5 W/(m^2 sr)}",
         "irradiance: expected an irradiance"),
        ("{kind: sun, direction: {times: [0, 1], values: [[0, 0, 1], [0, 0, 0]]}, "
         "irradiance: 5}", "terms.0.direction.values.1: must not be [0, 0, 0]"),
        ("{kind: sun, direction: {times: [0, 1], values: [[0, 0, 1], [0, 0, -3]]}, "
         "irradiance: 5}", "terms.0.direction.values.1: is opposite to the one before"),
        ("{kind: sun, direction: {times: [0, 1], values: [[0, 0, 1]]}, irradiance: 5}",
         "terms.0.direction.values: there are 1 values for 2 times"),
        ("{kind: area_source, centre: [0, 0, 1], normal: [0, 0, 0], size: [1, 1], "
         "radiance: 5}", "terms.0.normal: must not be [0, 0, 0]"),
        ("{kind: area_source, centre: [0, 0, 1], normal: [1, 0, 0], size: [1], "
         "radiance: 5}", "terms.0.size: expected two values, got [1]"),
        ("{kind: area_source, centre: [0, 0, 1], normal: [1, 0, 0], size: [1, 0], "
         "radiance: 5}", "terms.0.size.1: must be more than 0"),
        ("{kind: area_source, centre: [0, 0, 1], normal: [1, 0, 0], size: [1, 1]}",
         "terms.0: missing `radiance` or `temperature`"),
        ("{kind: area_source, centre: [0, 0, 1], normal: [1, 0, 0], size: [1, 1], "
         "radiance: 5, emissivity: 1}", "terms.0.emissivity: goes with `temperature`"),
        ("{kind: area_source, centre: [0, 0, 1], normal: [1, 0, 0], size: [1, 1], "
         "temperature: 500, emissivity: 1.5}", "terms.0.emissivity: must be at most 1"),
        ("{kind: surroundings, temperature: 280, occlusion: 4}",
         "terms.0.occlusion: must be at least 8, got 4"),
        ("{kind: surroundings, temperature: 280, linear_within: 2}",
         "terms.0.linear_within: must be less than 1, got 2"),
        ("{kind: radiative_exchange, temperature: 280, max_patches: 5}",
         "terms.0.max_patches: must be at least 6"),
        ("{kind: surroundings, temperature: 280}, "
         "{kind: radiative_exchange, temperature: 280}",
         "terms.1: radiative_exchange would count the emission twice, after "
         "surroundings in terms.0"),
        ("{kind: radiative_exchange, temperature: 280, on: {body: 0}}, "
         "{kind: radiative_exchange, temperature: 280, on: {body: 1}}",
         "terms.1: a second radiative_exchange would not see the surfaces of the one"),
        ("{kind: wind, velocity: 3, temperature: 290}",
         "terms.0.velocity: expected three numbers [x, y, z], got 3"),
        ("{kind: wind, velocity: [0, 0, 0], temperature: 290, speed: 3}",
         "terms.0.velocity: must not be [0, 0, 0]"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, speed: -3}",
         "terms.0.speed: must be at least 0"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, average: profil}",
         "terms.0.average: 'profil' is not known; did you mean 'profile'?"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, wake: defizit}",
         "terms.0.wake.kind: unknown kind 'defizit'; did you mean 'deficit'?"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, wake: {kind: fitted, "
         "length: 2}}", "terms.0.wake.length: unknown key: fitted takes no other keys"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, wake: {exponent: 2}}",
         "terms.0.wake.exponent: must be at most 1.1"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, cylinders: [{axis_point: "
         "[0, 0, 0], axis: [0, 0, 0], diameter: 1}]}",
         "terms.0.cylinders.0.axis: must not be [0, 0, 0]"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, cylinders: [{axis_point: "
         "[0, 0, 0], axis: [0, 0, 1], diameter: 1, body: 2}]}",
         "terms.0.cylinders.0.body: there is no body 2; the last one is 1"),
        ("{kind: free_convection, temperature: 290, length: 0}",
         "terms.0.length: must be more than 0"),
        ("{kind: free_convection, temperature: 290, body_shape: plat}",
         "terms.0.body_shape: 'plat' is not known; did you mean 'plate'?"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, body_shape: disc}",
         "terms.0.body_shape: 'disc' is not known; choose from plate, cyl"),
        ("{kind: heat_source, heat_rate_density: 5 W/m^2}",
         "terms.0.heat_rate_density: expected a heat rate density such as '5 kW/m^3'"),
        ("{kind: heat_source, heat_rate_density: 5, within: {body: 2}}",
         "terms.0.within.body: there is no body 2"),
        ("{kind: heat_flux, heat_flux: 5, on: {body: 0, side: {normal: [1, 0, 0]}}}",
         "terms.0.on.body: give `side` or `face` or `region` or `fragments` or `bod"),
        ("{kind: wind, velocity: [1, 0, 0], temperature: 290, on: {any: [{body: 0}, "
         "{not: {body: 2}}]}}", "terms.0.on.any.1.not.body: there is no body 2"),
        ("{kind: heat_flux, heat_flux: 5, on: {all: [{body: 0}, {body: 1}]}}",
         "terms.0.on.all: its parts are on different bodies"),
        ("{kind: heat_flux, heat_flux: 5, on: {any: []}}",
         "terms.0.on.any: must not be empty"),
        ("{kind: heat_flux, heat_flux: 5, on: {not: {body: 0, sid: 1}}}",
         "terms.0.on.not.sid: unknown key"),
        ("{kind: contact, conductance: bondet}",
         "expected a contact conductance ('bonded' for no resistance) such as"),
        ("{kind: contact, conductance: -1}", "terms.0.conductance: must be at least 0"),
        ("{kind: contact, conductance: 1, bodies: [0]}",
         "terms.0.bodies: expected two values, got [0]"),
        ("{kind: contact, conductance: 1, bodies: [1, 1]}",
         "terms.0.bodies.1: is body 1 again: name two bodies"),
        ("{kind: contact, conductance: 1, bodies: [0, 2]}",
         "terms.0.bodies.1: there is no body 2"),
        ("{kind: contact, conductance: 1, gap_length: 0}",
         "terms.0.gap_length: must be more than 0"),
        ("{kind: contact, conductance: 1, until: 3}", "terms.0.until: unknown key"),
    ],
)  # fmt: skip
def test_each_mistake_has_its_path(scene, terms, message):
    with pytest.raises(jt.InputError) as caught:
        scene(terms)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("terms", "messages"),
    [
        ("{kind: heat_flux, heat_flux: 5, on: {fragments: {mask: no.npy, body: 2}}}",
         ("on.fragments.body: there is no body 2", "on.fragments.mask: there is no")),
        ("{kind: heat_source, heat_rate_density: 5, within: {side: {body: 0}}}",
         ("within.side: unknown key", "within: missing `region` or `body`")),
        ("{kind: wind, velocity: [a, 0, 0], temperature: 20}",
         ("velocity.0: expected a speed", "temperature: 20 K is below 150 K")),
    ],
)  # fmt: skip
def test_two_mistakes_are_two_lines(scene, terms, messages):
    with pytest.raises(jt.InputError) as caught:
        scene(terms)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(messages)
    for line, message in zip(lines, messages, strict=True):
        assert f"terms.0.{message}" in line
