"""`temperature: steady` of bodies, assemblies and scenes in a file."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config


BOX = "shape: {kind: box, size: [4 cm, 4 cm, 4 cm]}, pitch: 2 cm, material: copper"
SCENE = """
{start}
bodies:
  - {{{box}{first}}}
  - {{{box}{second}, pose: {{translation: [10 cm, 0, 0]}}}}
terms:
  - {{kind: convection, heat_transfer_coefficient: 10, temperature: 290}}
  - {{kind: heat_flux, heat_flux: 100}}
time: {{end: 60, save_at: [60]}}
"""


def written(tmp_path, first="", second="", start=""):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(box=BOX, first=first, second=second, start=start))
    return path


@pytest.mark.parametrize(
    ("first", "second", "start", "expected"),
    [
        (", temperature: steady", ", temperature: 350", "", (300.0, 350.0)),
        ("", ", temperature: 350", "temperature: steady", (300.0, 350.0)),
    ],
    ids=["a body", "the scene"],
)
def test_a_body_starts_at_its_steady_state(tmp_path, first, second, start, expected):
    # q + h (T_air - T) = 0.
    scene = jt.load_scene(written(tmp_path, first, second, start)).scene
    steady, other = scene.bodies
    assert callable(steady.temperature)
    kelvin = np.asarray(steady.temperature(steady.structure.nodes().centre))
    np.testing.assert_allclose(kelvin, np.full(8, expected[0]), rtol=0, atol=2e-3)
    assert other.temperature == expected[1]


def test_the_temperature_of_a_scene_is_that_of_bodies_without_one(tmp_path):
    config = load_config(
        written(tmp_path, second=", temperature: 350", start="temperature: 20 degC")
    )
    assert [body.temperature for body in config.bodies] == [293.15, 350.0]


def test_a_body_needs_a_temperature(tmp_path):
    with pytest.raises(jt.InputError, match="bodies.0.temperature: missing, and it"):
        load_config(written(tmp_path, second=", temperature: 350"))


def test_a_word_that_is_none_is_refused_as_a_temperature(tmp_path):
    with pytest.raises(jt.InputError, match="expected a temperature such as"):
        load_config(written(tmp_path, ", temperature: stable", ", temperature: 350"))


def test_ground_that_is_held_at_its_start_needs_a_number(tmp_path):
    path = tmp_path / "ground.yaml"
    path.write_text(
        "bodies:\n"
        "  - shape: {kind: ground, size: [2, 2], layers: asphalt}\n"
        "    temperature: steady\n"
        "terms:\n"
        "  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}\n"
        "time: {end: 60, save_at: [60]}\n"
    )
    with pytest.raises(jt.InputError, match="ground is held at its temperature"):
        load_config(path)


def test_a_scene_without_a_steady_state_says_which_body(tmp_path):
    path = written(tmp_path, ", temperature: steady", ", temperature: 350")
    without = ["terms=[{kind: heat_flux, heat_flux: 100}]"]
    file = jt.load_scene(path, without)
    with pytest.raises(jt.InputError, match=r"temperature: steady: .* enters body 0"):
        assert file.scene
