"""Sweeps over fits: made once, in the scene of their choice, and used as weights."""

import json
from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.study import fits
from experiments.__main__ import main
from jaxthermo.config.card_file import write_card
from tests.cli.cli_runs import run
from tests.sweeping import SWEEP, sweep_file


CALIBRATION = """
scene: ball.yaml
train:
  - {name: +x}
parameters:
  - {name: weights.within}
reference: truth
truth: {refinement: 2, points: 300, surface_cells: dominant_axis}
fit: {max_steps: 3}
"""
AXES = """
axes:
  weights:
    - {label: of 1}
    - {label: fitted, fit: {calibration: fit.yaml}}
    - {label: "fitted, 2 steps", fit: {calibration: fit.yaml, set: {fit.max_steps: 2}}}
truth: {voxels_high: 16, points: 300, surface_cells: dominant_axis, dtype: float64}
"""
SERIAL = ("--no-times", "--workers", 1)
KEY = "bodies.0.structure.weights.within"


@pytest.fixture
def config(tmp_path) -> Path:
    (tmp_path / "fit.yaml").write_text(CALIBRATION)
    return sweep_file(tmp_path, SWEEP[: SWEEP.index("axes:")] + AXES)


def sweep(config: Path, *options: object) -> dict[str, dict]:
    out = config.parent / "out"
    code, _, err = run("sweep", config, "--out", out, *SERIAL, *options, main=main)
    assert code == 0, err
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    return {f"{row['choice']['weights']} {row['load']}": row for row in rows}


def test_weights_of_a_fit_are_those_of_its_choice(config, monkeypatch):
    calls = []

    def fit(path, out, overrides, report):
        calls.append(overrides)
        weights = jt.ConductionWeights(within=0.5 * len(calls))
        structure = {
            "kind": "aggregate",
            "factor": 2,
            "min_time_constant": 0.45,
            "alignment": 0.7,
        }
        out.mkdir(parents=True)
        write_card(out / "card.yaml", jt.FitCard("ball", structure, weights))

    monkeypatch.setattr(fits, "fit_config", fit)
    rows = sweep(config)
    assert len(rows) == 6
    # The scene of the fit has the changes of its choice, the calibration its own.
    structure = 'set.bodies.0.structure={"kind": "aggregate", "factor": 2}'
    assert calls == [(structure,), (structure, "fit.max_steps=2")]
    error = {name: row["error"]["worst_rms_kelvin"] for name, row in rows.items()}
    # Weights of 0.5 and 1: the second is the plain structure.
    assert error["fitted, 2 steps +x"] == pytest.approx(error["of 1 +x"], rel=1e-6)
    assert error["fitted +x"] != pytest.approx(error["of 1 +x"], rel=1e-3)
    assert sweep(config) == rows and len(calls) == 2


def test_a_mistake_in_a_calibration_is_told_before_anything_is_run(config):
    path = config.parent / "fit.yaml"
    path.write_text(CALIBRATION.replace("weights.within", ""))
    out = config.parent / "out"
    code, _, err = run("sweep", config, "--out", out, main=main)
    assert code == 2 and "fit.yaml" in err and not out.exists()


@pytest.mark.slow
def test_the_cases_of_a_real_fit_run_with_its_weights(config):
    rows = sweep(config)
    row = rows["fitted +x"]
    card = Path(row["set"]["bodies.0.structure"]["weights"]["card"])
    result = json.loads((card.parent / "fit.json").read_text())
    assert result["loss"]["final"] < result["loss"]["initial"]
    within = np.asarray(jt.load_card(card).weights.within).item()
    assert within == pytest.approx(result["parameters"]["weights.within"]["value"])
    # The same weight by hand.
    axes = f"axes:\n  weights: {{key: {KEY}, values: [{within}]}}\n"
    text = SWEEP[: SWEEP.index("axes:")] + axes + AXES[AXES.index("truth:") :]
    (config.parent / "by_hand").mkdir()
    by_hand = sweep(sweep_file(config.parent / "by_hand", text))

    def errors(rows):
        return [row["error"]["worst_rms_kelvin"] for row in rows]

    expected = [rows["fitted +x"], rows["fitted +z"]]
    assert errors(by_hand.values()) == pytest.approx(errors(expected), rel=1e-6)
