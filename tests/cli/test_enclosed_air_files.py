"""A scene with computed air, from its file to all results and commands."""

import csv
import json

import numpy as np
import pytest
from cli_runs import scene_file, succeed

from jaxthermo.integrate.run.solution_file import load_solution


SCENE = """
bodies:
  - shape: {kind: box, size: [8 cm, 8 cm, 8 cm]}
    pitch: 4 cm
    material: steel
    temperature: 40 degC
  - shape: {kind: box, size: [60 cm, 40 cm, 40 cm]}
    sheet: {layers: [{material: steel, thickness: 1 mm}], pitch: 8 cm}
    temperature: 20 degC
    interior:
      air: {exchange: 4 1/h, outside: 5 degC, temperature: 30 degC}
      heat_transfer_coefficient: 5 W/(m^2 K)
terms:
  - {kind: convection, heat_transfer_coefficient: 20, temperature: 5 degC}
probes: {air: [18 cm, 0, 0], block: [0, 0, 0]}
surface_outputs: [heat_flux, heat_transfer_coefficient]
time: {end: 20, save_at: [10, 20]}
camera: {width: 32, height: 24}
"""


@pytest.mark.slow
def test_air_is_in_all_results(tmp_path, out):
    path = scene_file(tmp_path, SCENE)
    text = succeed("simulate", path, "--explain")
    (line,) = [line for line in text.splitlines() if "air of body 1" in line][-1:]
    assert line.split()[0] == "interior_air"
    text = succeed("simulate", path, "--out", out)
    assert "\nthe air of body 1 is at " in text
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["bodies"]) == len(summary["structures"]) == 2
    (air,) = summary["airs"]
    assert (air["inside_body"], air["number"]) == (1, 2)
    assert air["volume_m3"] == pytest.approx(0.096, rel=1e-9)
    assert summary["receipt"]["structures"][-1] == "AirVolume, 1 node"
    with np.load(out / "solution.npz") as stored:
        means = stored["mean_temperature"]
        kept = stored["probe_temperature"]
    np.testing.assert_allclose(air["temperature_K"], means[:, 2], rtol=1e-6)
    np.testing.assert_allclose(kept[:, 0], means[:, 2], rtol=1e-6)
    assert 278.15 < means[-1, 2] < means[0, 2] < 303.15
    assert len(load_solution(out / "solution.npz").surfaces) == 2
    with (out / "energy.csv").open(newline="") as lines:
        row = list(csv.DictReader(lines))[-1]
    assert float(row["air of body 1: interior_air_J"]) == pytest.approx(
        air["energy"]["interior_air_J"][-1], rel=1e-5
    )
    for format in ("vtu", "glb", "texture"):
        succeed("export", out, "--format", format, "--out", tmp_path / format)
    succeed("render", out, "--out", tmp_path / "frames")
