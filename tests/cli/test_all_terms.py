"""Every kind of term in one scene, from its file to its results."""

import json

import numpy as np
import pytest
from cli_runs import scene_file, succeed

import jaxthermo as jt
from jaxthermo.config.loader import load_config


SCENE = """
bodies:
  - shape: &cube {kind: box, size: [4 cm, 4 cm, 4 cm]}
    pitch: 1 cm
    material:
      conductivity: {temperatures: [250, 400], values: [16, 20]}
      density: 8000
      specific_heat: {temperatures: [250, 400], values: [480, 520]}
    temperature: 300
  - shape: *cube
    pitch: 1 cm
    material:
      labels: parts.npy
      materials: [copper, {name: copper, conductivity: [400, 300, 200]}]
    temperature: 350
    pose:
      times: [10, 10.5]
      poses: [{translation: [0, 0, 4 cm]}, {translation: [0, 0, 8 cm]}]
terms:
  - {kind: contact, conductance: {times: [0, 20], values: [1000, 500]}}
  - {kind: sun, direction: [1, 0, -1], irradiance: 500 W/m^2}
  - {kind: point_source, position: [0.3, 0, 0], radiant_intensity: 10 W/sr}
  - kind: area_source
    centre: [0, 0, 30 cm]
    normal: [0, 0, -1]
    size: [10 cm, 10 cm]
    temperature: 600
    patches: 2
  - {kind: radiative_exchange, temperature: 280, max_patches: 12, directions: 16}
  - {kind: wind, velocity: [2, 0, 0], temperature: 290, wake: deficit}
  - {kind: free_convection, temperature: 290}
  - {kind: convection, heat_transfer_coefficient: 5, temperature: 290, on: {body: 1}}
  - {kind: heat_source, heat_rate_density: 100 kW/m^3, within: {body: 1}}
  - kind: fixed_temperature
    temperature: 300
    on: {side: {normal: [0, 0, -1]}}
  - {kind: heat_flux, heat_flux: 100, on: {fragments: {mask: hot.npy}}}
time: {end: 20, save_at: [10, 20]}
camera: {width: 64, height: 48}
image: {samples: 1}
"""


@pytest.mark.slow
def test_all_of_them_together(tmp_path, out):
    np.save(tmp_path / "parts.npy", np.arange(64).reshape(4, 4, 4) % 2)
    cube = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
    np.save(tmp_path / "hot.npy", cube.fragment_normal[:, 0] > 0.9)
    scene = scene_file(tmp_path, SCENE)
    succeed("simulate", scene, "--out", out)
    assert load_config(out / "config.yaml") == load_config(scene)
    summary = json.loads((out / "summary.json").read_text())
    config = load_config(scene)
    names = {term.kind for term in config.terms} - {"radiative_exchange"}
    assert set(summary["receipt"]["included"]) == {"conduction", "emission", *names}
    assert summary["receipt"]["snapshots"] == 3
    assert np.abs(summary["energy"]["residual_relative"]).max() < 1e-5
    for name in ("sun", "point_source", "area_source", "heat_flux", "heat_source"):
        assert min(summary["energy"][f"{name}_J"]) > 0
