"""The section `outdoors` of a scene: its terms, and its mistakes."""

from pathlib import Path

import numpy as np
import pytest

from jaxthermo.config.loader import load_config
from jaxthermo.errors import InputError


DAY = Path(__file__).parents[3] / "configs" / "scenes" / "figurine-day.yaml"


def test_terms_follow_those_of_the_scene():
    config = load_config(DAY, ["terms=[{kind: free_convection, temperature: 290}]"])
    names = [term.name for term in config.build_terms()]
    assert names == ["free_convection", "sun", "diffuse_sky", "emission", "wind"]


def test_north_and_units():
    changes = ["outdoors.north=[1, 0, 0]", "outdoors.terms=[wind]", "time.end=24 h"]
    (wind,) = load_config(DAY, changes).build_terms()
    np.testing.assert_allclose(wind.velocity, (0, -1, 0), atol=1e-12)
    assert wind.temperature.times[-1] == 86400.0
    np.testing.assert_allclose(wind.temperature.values.min(), 285.15, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("outdoors.start=2026-06-21T00:00", "outdoors.start.*with a zone"),
        ("outdoors.place.latitude=91", "outdoors.place.latitude.*at most 90"),
        ("outdoors.north=[0, 1, 1]", "outdoors.north.*horizontal"),
        ("outdoors.terms=[wind, convection]", "outdoors.terms.*one of wind"),
        ("outdoors.sky=infrared", "outdoors.sky.*no infrared"),
        ("outdoors.clear_sky.air=[26 degC, 12 degC]", "clear_sky.air.*lowest"),
        ("outdoors.longwave={west: {face: front}}", "longwave.*columns of a weather"),
        (
            "outdoors.longwave={west: {body: 3}}",
            "longwave.west.body: there is no body 3",
        ),
        ("outdoors.weather=no.epw", "there is no file 'no.epw'|one of"),
        ("terms=[{kind: surroundings, temperature: 280}]", "terms.0.*twice"),
    ],
)
def test_mistakes(change, message):
    with pytest.raises(InputError, match=message):
        load_config(DAY, [change])


def test_planes_of_measured_long_wave_have_names_of_bodies(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(
        """
bodies:
  - {name: roof, shape: &plate {kind: rectangle, width: 1 m, length: 1 m}, sheet: &soil
     {layers: soil, pitch: 0.5 m}, temperature: 12 degC}
  - {name: wall, shape: *plate, sheet: *soil, pose: {translation: [3 m, 0 m, 0 m]},
     temperature: 12 degC}
outdoors:
  place: {latitude: 48.14, longitude: 11.58}
  start: 2026-06-21T00:00+02:00
  weather: weather.csv
  terms: [sky]
  sky: swinbank
  longwave: {west: {face: {name: front, part: wa*}}}
time: {end: 1 h, save_every: 1 h}
"""
    )
    head = "time,air_degC,direct_normal_W_m2,diffuse_W_m2,wind_speed_m_s,"
    rows = [f"2026-06-21T0{h}:00+02:00,20,0,0,1,0,300\n" for h in range(2)]
    head += "wind_direction_deg,longwave_west_W_m2\n"
    (tmp_path / "weather.csv").write_text(head + "".join(rows))
    _, west = load_config(path, []).build_terms()
    assert west.on.bodies == (1,)
    message = r"outdoors.longwave.west.face.part.*no.*'door'"
    with pytest.raises(InputError, match=message):
        load_config(path, ["outdoors.longwave.west.face.part=door"])
