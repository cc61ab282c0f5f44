"""Scenes with weather files in usual states, through the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli_runs import refused, succeed

import jaxthermo as jt
from jaxthermo.config.loader import load_config


SCENES = Path(__file__).parents[1] / "data" / "mesh_and_heat"


def surface_of(scene, out, *options):
    succeed("simulate", scene, "--out", out, *options)
    with np.load(out / "solution.npz") as arrays:
        return arrays["surface_temperature"]


def warning_of(out):
    (line,) = [line for line in out.splitlines() if line.startswith("warning: ")]
    return line.removeprefix("warning: ")


def test_a_sky_without_infrared_says_what_is_assumed():
    with pytest.warns(UserWarning) as warned:
        load_config(SCENES / "day_overcast.yaml").build_terms()
    (message,) = (str(warning.message) for warning in warned)
    assert "the dew point and the cloud cover (Walton 1983)" in message


@pytest.mark.slow
def test_the_summary_has_the_doubts_about_the_weather(tmp_path):
    out = succeed("simulate", SCENES / "day_overcast.yaml", "--out", tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["warnings"] == [warning_of(out)]


@pytest.mark.slow
def test_usual_states_of_files_change_no_temperature(tmp_path):
    clean = tmp_path / "clean.epw"
    content = (SCENES / "latin1.epw").read_bytes()
    clean.write_bytes(content.replace(b"Z\xfcrich", b"Zurich"))
    leap = SCENES / "day_leap.yaml"
    change = f"outdoors.weather={json.dumps(str(clean))}"
    expected = surface_of(leap, tmp_path / "clean", "--set", change)
    for name in ("leap", "latin1", "columns32"):
        surface = surface_of(SCENES / f"day_{name}.yaml", tmp_path / name)
        np.testing.assert_allclose(surface, expected, atol=0.01)
    # A calm with a direction is the same calm.
    lines = (SCENES / "calm.epw").read_text().replace(",999,0.0,", ",270,0.0,")
    clean.write_text(lines)
    expected = surface_of(leap, tmp_path / "still", "--set", change)
    surface = surface_of(SCENES / "day_calm.yaml", tmp_path / "calm")
    np.testing.assert_allclose(surface, expected, atol=0.01)


def test_the_place_of_the_file_is_the_default(tmp_path):
    text = (SCENES / "day_latin1.yaml").read_text()
    weather = json.dumps(str(SCENES / "latin1.epw"))
    text = text.replace("weather: latin1.epw", f"weather: {weather}")
    place = "place: {latitude: 48.0, longitude: 11.0, altitude: 500}, "
    assert place in text
    scene = tmp_path / "a.yaml"
    scene.write_text(text)
    with_place = load_config(scene, ["outdoors.north=[1, 0, 0]"]).build_terms()
    scene.write_text(text.replace(place, ""))
    config = load_config(scene, ["outdoors.north=[1, 0, 0]"])
    for term, other in zip(config.build_terms(), with_place, strict=True):
        assert repr(term) == repr(other)
    with pytest.warns(UserWarning, match="1.5 degrees from the place of the scene"):
        load_config(
            SCENES / "day_latin1.yaml", ["outdoors.place.latitude=49.5"]
        ).build()
    clear = "outdoors={start: 2026-06-21T00:00Z, clear_sky: {air: [280, 290]}}"
    message = refused("simulate", SCENES / "day_latin1.yaml", "--set", clear)
    assert "outdoors.place" in message and "a clear_sky has none" in message


def test_a_damaged_file_is_one_line(tmp_path):
    weather = tmp_path / "cut.epw"
    weather.write_bytes((SCENES / "latin1.epw").read_bytes()[:5120])
    change = f"outdoors.weather={json.dumps(str(weather))}"
    scene = SCENES / "day_latin1.yaml"
    message = refused("simulate", scene, "--explain", "--set", change)
    assert "cut.epw: line 37 has 33 columns, and line 9 has 35" in message
    with pytest.raises(jt.InputError):
        load_config(scene, [change]).build_terms()
