"""The camera's frame of a live view: that of `render`, with its band and effects."""

import math

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config
from jaxthermo.config.types.model import build
from jaxthermo.integrate.run.solution_file import load_run
from jaxthermo.live.live_camera import LiveCamera
from jaxthermo.live.playback import Playback


SCENE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 8 cm]}
    pitch: 1 cm
    material: stainless_steel
    temperature: 300
terms:
  - {kind: sun, direction: [-1, 0, -0.4], irradiance: 2 kW/m^2}
  - {kind: surroundings, temperature: 280}
time: {end: 20, save_at: [10, 20]}
camera: {width: 32, height: 24}
"""
EFFECTS = (
    "{kind: specular_reflection, fraction: 0.3, exponent: 8}",
    "{kind: blur, sigma: 0.8}",
    "{kind: detector_noise, netd: 50 mK, seed: 3}",
)
LAG = "{kind: bolometer_lag, time_constant: 4 s}"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    config_path = tmp_path_factory.mktemp("detector") / "box.yaml"
    config_path.write_text(SCENE)
    return config_path


def config_with(path, *effects: str, **settings: str):
    texts = [f"{name.replace('__', '.')}={text}" for name, text in settings.items()]
    return load_config(path, (f"image.effects=[{', '.join(effects)}]", *texts))


@pytest.fixture(scope="module")
def solution(path):
    return jt.simulate(load_config(path).build(), 20.0, [10.0, 20.0])


@pytest.fixture
def run(solution, path, tmp_path):
    solution.save(tmp_path)
    return Playback(load_run(tmp_path))


@pytest.mark.parametrize("band", ["long-wave", "all", "[3 um, 5 um]"])
def test_the_frame_is_that_of_render(run, solution, path, band):
    config = config_with(path, *EFFECTS, image__band=band)
    detector = LiveCamera(config, run.surfaces)
    run.seek(20.0)
    drawn = jt.render(
        solution,
        detector.camera,
        band=build(config.image.band),
        effects=build(config.image.effects),
    )
    expected = np.asarray(drawn.apparent_temperature, float)
    expected[np.asarray(drawn.object_id) < 0] = math.nan
    np.testing.assert_allclose(detector.frame(run), expected, rtol=1e-6)


def test_a_detector_lags_while_time_goes_on_and_settles_at_a_standstill(run, path):
    lagging = LiveCamera(config_with(path, LAG), run.surfaces)
    at_once = LiveCamera(config_with(path), run.surfaces)
    cold = lagging.frame(run)
    np.testing.assert_array_equal(cold, at_once.frame(run))
    run.seek(18.0)
    warm = at_once.frame(run)
    late = lagging.frame(run)
    risen = np.nanargmax(warm - cold)
    # A ramp is followed by what it gains in one time constant later.
    followed = 1 - (4 / 8) * (1 - math.exp(-8 / 4))
    gained = (late - cold).flat[risen] / (warm - cold).flat[risen]
    assert gained == pytest.approx(followed, abs=0.01)
    np.testing.assert_array_equal(lagging.frame(run), warm)
    run.seek(10.0)
    np.testing.assert_array_equal(lagging.frame(run), cold)


def test_a_large_frame_is_reduced_with_its_blur(run, path):
    blur = "{kind: blur, sigma: 2}"
    config = config_with(path, blur, camera__width="620", camera__height="400")
    detector = LiveCamera(config, run.surfaces)
    assert detector.camera.size == (310, 200)
    assert detector._recorder.effects.spread == pytest.approx(1.0)
