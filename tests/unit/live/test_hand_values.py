"""Sliders for the values of a config, and the texts of a page."""

import ast
import math

import pytest

from jaxthermo.config.loader import load_config
from jaxthermo.live.hand_values import hand_values
from jaxthermo.live.panels import RunStatus, status_lines, temperature_bar


SCENE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 8 cm]}
    pitch: 1 cm
    material: copper
    temperature: 300
terms:
  - {kind: sun, direction: [0, -1, -1], irradiance: 2 kW/m^2, until: 20}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290.15}
  - kind: surroundings
    temperature: {times: [0, 9], values: [280, 290]}
  - {kind: wind, velocity: [0, 3, 1], temperature: 290}
  - {kind: sun, direction: [0, 0, -1], irradiance: 10}
time: {end: 30, save_at: [30]}
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    config_path = tmp_path_factory.mktemp("values") / "box.yaml"
    config_path.write_text(SCENE)
    return config_path


def test_numbers_and_directions_have_sliders(path):
    by_path = {value.path: value for value in hand_values(load_config(path))}
    # Not what follows a table, nor the time at which a source ends.
    assert list(by_path) == [
        "terms.0.direction",
        "terms.0.irradiance",
        "terms.1.heat_transfer_coefficient",
        "terms.1.temperature",
        "terms.3.velocity",
        "terms.3.temperature",
        "terms.4.direction",
        "terms.4.irradiance",
    ]
    assert [v.title for v in by_path.values()][::7] == ["sun 1", "sun 2"]
    sun = by_path["terms.0.direction"].sliders
    # Rays towards -y and down come from +y, at half height.
    assert [s.value for s in sun] == [90, 45]
    (air,) = by_path["terms.1.temperature"].sliders
    assert air.label == "temperature [°C]" and air.value == pytest.approx(17.0)
    (strong,) = by_path["terms.0.irradiance"].sliders
    assert strong.high == 6000.0 and strong.label == "irradiance [W/m²]"
    for value in by_path.values():
        for slider in value.sliders:
            assert slider.low <= slider.value <= slider.high


def test_what_sliders_write_is_read_as_the_same_values(path):
    values = hand_values(load_config(path))
    texts = [f"{v.path}={v.text(tuple(s.value for s in v.sliders))}" for v in values]
    config = load_config(path)
    again = load_config(path, texts)
    for expected, term in zip(config.terms, again.terms, strict=True):
        for name, value in expected:
            if name == "direction":
                # Rounded to whole degrees, and of length 1.
                size = math.hypot(*value)
                value = tuple(x / size for x in value)
            assert getattr(term, name) == pytest.approx(value, abs=1e-9), name


def test_a_velocity_keeps_its_vertical_part(path):
    (wind,) = [v for v in hand_values(load_config(path)) if v.path.endswith("velocity")]
    assert ast.literal_eval(wind.text((2.0, 90.0))) == pytest.approx([0.0, 2.0, 1.0])


def test_a_bar_has_its_ends_and_round_numbers():
    bar = temperature_bar(
        273.15 + 18.2, high=273.15 + 33.0, palette="iron", title="a <b>"
    )
    for text in ("20.0", "32.5", "[°C]", "a &lt;b&gt;", "linear-gradient"):
        assert text in bar
    assert "35.0" not in bar and "15.0" not in bar


def test_the_status_says_what_runs_and_how_fast():
    running = status_lines(
        RunStatus(time=90.0, end=900.0, state="running", simulated=9.96, frames=19.8)
    )
    assert "t = 90 s" in running and "of 15 min 00 s, running" in running
    assert "9.96 simulated s/s, 19.8 frames/s" in running
    still = status_lines(
        RunStatus(
            time=0.0,
            end=900.0,
            state="paused",
            simulated=None,
            frames=None,
            note="a < b",
        )
    )
    assert "–" in still and "a &lt; b" in still
