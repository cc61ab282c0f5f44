"""`jaxthermo simulate --steady`: the folder of a steady state."""

import csv
import json

import numpy as np
import pytest
from cli_runs import RESULTS, files, refused, succeed

import jaxthermo as jt


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A steady state, in a folder that has the leftovers of a run."""
    path = tmp_path_factory.mktemp("steady") / "block.yaml"
    path.write_text(
        "bodies:\n"
        "  - shape: {kind: box, size: [4 cm, 4 cm, 4 cm]}\n"
        "    pitch: 1 cm\n"
        "    material: copper\n"
        "    temperature: 350\n"
        "terms:\n"
        "  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}\n"
        "  - kind: heat_flux\n"
        "    heat_flux: {times: [0, 10, 20], values: [100, 200, 200]}\n"
        "probes: {core: [0, 0, 0]}\n"
        "time: {end: 20, save_at: [5, 20]}\n"
        "image: {frames: [5]}\n"
        "camera: {width: 64, height: 48}\n"
    )
    out = path.parent / "out"
    (out / "frames").mkdir(parents=True)
    (out / "measurements.csv").write_text("of an earlier run")
    (out / "frames/t000005.00s.png").write_text("of an earlier run")
    shown = succeed("simulate", path, "--steady", "--at", "15 s", "--out", out)
    return path, out, shown


def test_the_folder_has_one_state(folder):
    _, out, shown = folder
    frame = {"frames/t000015.00s.exr", "frames/t000015.00s.png"}
    assert files(out) == RESULTS | frame | {"probes.csv"}
    # q + h (T_air - T) = 0 with the flux at 15 s.
    summary = json.loads((out / "summary.json").read_text())
    assert summary["result"] == "successful" and summary["steps"] == 0
    assert summary["times_s"] == [15.0]
    assert summary["bodies"][0]["mean_temperature_K"] == pytest.approx(
        [310.0], abs=2e-3
    )
    assert summary["receipt"]["included"] == ["conduction", "convection", "heat_flux"]
    area = summary["bodies"][0]["area_m2"]
    assert summary["energy"]["heat_flux_W"] == pytest.approx([200 * area], rel=1e-5)
    assert summary["energy"]["convection_W"] == pytest.approx([-200 * area], rel=1e-4)
    assert abs(summary["energy"]["residual_relative"][0]) < 1e-4
    rates = {term["mechanism"]: term["mean_heat_rate_W"] for term in summary["terms"]}
    assert rates["heat_flux"] == pytest.approx(200 * area, rel=1e-5)
    (row,) = csv.DictReader((out / "energy.csv").read_text().splitlines())
    assert float(row["heat_flux_W"]) == pytest.approx(200 * area, rel=1e-5)
    assert f"heat_flux {200 * area:.3g} W" in shown and "at t = 15 s" in shown


def test_python_reads_it_and_render_draws_it_again(folder, tmp_path):
    _, out, _ = folder
    run = jt.load_run(out)
    assert run.energy is None and run.heat_rates is not None
    assert run.run is not None and run.run.solver == "steady"
    np.testing.assert_allclose(
        np.asarray(run.probe_temperature), 310.0, rtol=0, atol=2e-3
    )
    succeed("render", out, "--out", tmp_path)
    assert "frames/t000015.00s.png" in files(tmp_path)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--steady", "--animate"), "--animate: a steady state is one frame"),
        (("--steady", "--contact-sheet"), "--contact-sheet: a steady"),
        (("--steady", "--explain"), "--explain: a steady"),
        (("--steady", "--processes", "2"), "--processes: a steady"),
        (("--steady", "--devices", "2"), "--devices: a steady"),
        (("--steady", "--at", "3 kg"), "--at: expected a time such as '3 min'"),
        (("--steady", "--at=-3"), "--at -3: give a time from the start"),
        (("--at", "3 s"), "--at 3 s: give --steady too"),
        (
            ("--steady", "--set", "terms=[{kind: heat_flux, heat_flux: 100}]"),
            "no steady state",
        ),
    ],
)
def test_what_does_not_fit_is_one_line(folder, tmp_path, options, words):
    path, _, _ = folder
    assert words in refused("simulate", path, "--out", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()
