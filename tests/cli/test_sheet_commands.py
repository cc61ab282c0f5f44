"""Commands with scenes of sheets: fits, plans and sweeps."""

import json

import numpy as np
import pytest
from cli_runs import run

import jaxthermo as jt
from calibrate.__main__ import main as calibrate
from experiments.__main__ import main as experiments
from jaxthermo.config.loader import load_config
from tests.sheet_scenes import BOX, PLATE


FITTED = {
    "bodies.0.sheet.layers.0.thickness": 1.4e-3,
    "bodies.0.sheet.layers.1.material.conductivity": 0.06,
    "bodies.0.coatings.0.emissivity": 0.6,
    "interior_air.heat_transfer_coefficient": 7.0,
}


@pytest.mark.slow
def test_a_fit_finds_layers_coatings_by_face_and_inner_air(tmp_path):
    (tmp_path / "scene.yaml").write_text(BOX)
    true = {
        name.replace("interior_air", "bodies.0.interior"): value
        for name, value in FITTED.items()
    }
    config = {
        "scene": "./scene.yaml",
        "train": [{"name": "run"}],
        "reference": {"kind": "full_volume", "set": true},
        "parameters": [{"name": name} for name in FITTED],
    }
    path = tmp_path / "fit.yaml"
    path.write_text(json.dumps(config))
    out = tmp_path / "fit"
    finished = run("fit", path, "--out", out, main=calibrate)
    assert finished.status == 0, finished.err
    result = json.loads((out / "fit.json").read_text())
    for name, value in FITTED.items():
        fitted = result["parameters"][name]["value"]
        assert fitted == pytest.approx(value, rel=0.01), name
    assert "sheet.layers.0.thickness" in (out / "report.html").read_text()
    card = jt.load_card(out / "card.yaml")
    assert card.structure == {"kind": "sheet", "cells": 2}
    scene = tmp_path / "scene.yaml"
    checked = run("check", out / "card.yaml", "--scene", scene, main=calibrate)
    assert checked.status == 0, checked.err


@pytest.mark.slow
@pytest.mark.slice
def test_a_plan_of_a_sheet_is_verified_against_finer_cells(tmp_path):
    path = tmp_path / "plate.yaml"
    path.write_text(PLATE)
    out = tmp_path / "plan"
    finished = run("plan", path, "--tolerance", "2%", "--out", out, main=calibrate)
    assert finished.status == 0, finished.err
    plan = json.loads((out / "plan.json").read_text())
    assert plan["chosen"]["candidate"]["family"] == "sheet"
    planned = load_config(out / "scene.yaml")
    assert planned.bodies[0].sheet is not None
    coarse = jt.simulate(planned.build(), 600.0, planned.time.save_times)
    fine = load_config(path, ("bodies.0.sheet.pitch=4mm",)).build()
    reference = jt.simulate(fine, 600.0, planned.time.save_times)
    error = jt.truth_error(coarse, reference=reference)
    assert np.asarray(error.rms_percent).max() < 2.0


@pytest.mark.slow
def test_a_sweep_has_pitch_cells_and_thickness_of_a_sheet_as_axes(tmp_path):
    (tmp_path / "plate.yaml").write_text(PLATE)
    axes = {
        "pitch": {"key": "bodies.0.sheet.pitch", "values": ["10 cm", "2.5 cm"]},
        "cells": {"key": "bodies.0.sheet.cells", "values": [1, 3]},
        "thickness": {
            "key": "bodies.0.sheet.layers.0.thickness",
            "values": ["1 mm", "3 mm"],
        },
    }
    config = {
        "scene": "./plate.yaml",
        "axes": axes,
        "truth": {"pitch": "1 cm", "points": 1000},
        "repeats": 2,
    }
    path = tmp_path / "sweep.yaml"
    path.write_text(json.dumps(config))
    out = tmp_path / "sweep"
    finished = run(
        "sweep", path, "--out", out, "--no-times", "--workers", 1, main=experiments
    )
    assert finished.status == 0, finished.err
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert len(rows) == 8
    by_choice = {tuple(row["choice"].values()): row for row in rows if "choice" in row}
    for thickness in ("1 mm", "3 mm"):
        for cells in ("1", "3"):
            coarse = by_choice["10 cm", cells, thickness]["error"]["worst_rms_percent"]
            fine = by_choice["2.5 cm", cells, thickness]["error"]["worst_rms_percent"]
            assert fine < coarse / 2
        # Thin steel has no gradient through it.
        one = by_choice["2.5 cm", "1", thickness]["error"]["worst_rms_percent"]
        three = by_choice["2.5 cm", "3", thickness]["error"]["worst_rms_percent"]
        assert three == pytest.approx(one, rel=0.05)
