"""`probes` of a config: the file, the summary, and a point in no body."""

import csv
import json

import numpy as np
import pytest
from cli_runs import SCENE, files, run, scene_file, succeed

from jaxthermo.cli.summary import write_probes
from jaxthermo.integrate.run.solution import Solution
from jaxthermo.integrate.run.solution_file import load_solution
from jaxthermo.scene.named import Probe


WIRED = SCENE + "probes: {core: [0, 0, 0], skin: [2.5 cm, 1 mm, 0]}\n"


def test_a_column_for_every_probe(tmp_path):
    # Nothing else of a solution is read.
    solution = object.__new__(Solution)
    fields = {
        "times": np.array([1.0, 2.5]),
        "probes": (Probe("core", (0.0, 0.0, 0.0)), Probe("the, skin", (0.0, 0.0, 1.0))),
        "probe_temperature": np.array([[300.125, 301.0], [302.0, 303.0]]),
    }
    for name, value in fields.items():
        object.__setattr__(solution, name, value)
    write_probes(tmp_path / "probes.csv", solution)
    with (tmp_path / "probes.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert rows == [
        {"time_s": "1", "core": "300.125", "the, skin": "301"},
        {"time_s": "2.5", "core": "302", "the, skin": "303"},
    ]


@pytest.mark.slow
@pytest.mark.slice
def test_a_run_with_probes_leaves_their_file(tmp_path, out):
    scene = scene_file(tmp_path, WIRED + "surface_outputs: [heat_flux]\n")
    succeed("simulate", scene, "--out", out)
    assert "probes.csv" in files(out)
    summary = json.loads((out / "summary.json").read_text())
    core, skin = (summary["probes"][name] for name in ("core", "skin"))
    assert skin["position_m"] == [0.025, 0.001, 0.0]
    # The sun shines on the side at +x; 5 s are too short for the middle. The rise of a
    # semi-infinite solid, 2 q'' sqrt(t / (pi k rho c)), is that without losses.
    assert core["temperature_K"][0] == pytest.approx(300.0, abs=0.01)
    absorbed = 0.16 * 5000.0 * 0.5 / np.sqrt(0.5**2 + 0.6**2 + 0.7**2)
    limit = 2 * absorbed * np.sqrt(5.0 / (np.pi * 17.0 * 7900.0 * 460.0))
    assert 0.5 * limit < skin["temperature_K"][0] - 300.0 < limit
    with (out / "probes.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    read = [float(row["skin"]) for row in rows]
    assert read == pytest.approx(skin["temperature_K"], rel=1e-8)
    with np.load(out / "solution.npz") as stored:
        fragments = stored["surface_temperature"].shape
        assert stored["heat_flux"].shape == fragments
    assert load_solution(out / "solution.npz").surface_temperature.shape == fragments


@pytest.mark.slow
def test_a_point_in_no_body_is_one_line(tmp_path):
    scene = scene_file(tmp_path, WIRED)
    wrong = "probes.core=[0, 0, 1]"
    code, _, err = run("simulate", scene, "--out", tmp_path / "out", "--set", wrong)
    assert code == 2
    assert "probe core at (0, 0, 1) m is in no body" in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()
