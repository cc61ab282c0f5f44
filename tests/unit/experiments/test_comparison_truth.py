"""Errors against finer voxels in the comparison: merged, summed up, told in words."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.harness.present import table_of
from experiments.harness.record import Record
from experiments.structures.config import common_identity, load_comparison
from experiments.structures.study import Study, rays
from experiments.structures.truth import Truth, scene_config, with_truth
from experiments.structures.truth_lines import (
    ALL_TRUTH_COLUMNS,
    REFERENCE_COLUMNS,
    TRUTH_BY_TIME,
    TRUTH_COLUMNS,
    truth_notes,
    worst_truth,
)
from jaxthermo.config.strict_yaml import read_yaml, write_yaml


SHIPPED = Path(__file__).parents[3] / "configs/experiments/structures-figurine.yaml"
SHARED = "body 0 has the voxels of the reference: the error is that of its structure"


def truth(kelvin, percent, own, is_bound=False, remarks=()):
    worst: dict[str, Any] = {"worst_rms_kelvin": kelvin, "worst_rms_percent": percent}
    worst |= {"worst_p99_kelvin": 3 * kelvin, "worst_bias_kelvin": -kelvin / 2}
    worst |= {"worst_lost_fraction": 0.01, "remarks": list(remarks)}
    series = {"rms_kelvin": [kelvin, 0.001], "rms_percent": [percent, None]}
    own_error: dict[str, Any] = {"rms_kelvin": [own, own / 2], "worst_rms_kelvin": own}
    own_error |= {"is_bound": [is_bound, False], "order": [None, 1.5]}
    return {"error": {**worst, **series}, "own_error": own_error}


def row(load, label="octree", **values):
    return {"body": "ball", "load": load, "label": label, **values}


def test_rows_get_the_error_of_their_body_load_and_structure():
    found = [row("+x", **truth(0.2, 2.0, 0.05)), row("-z", refused="no memory")]
    made = with_truth([row("+x"), row("-z"), row("+x", "shell")], found)
    assert made[0]["truth"]["error"]["worst_rms_kelvin"] == 0.2
    assert made[1]["truth"] is made[2]["truth"] is None


def test_a_line_has_the_largest_errors_and_the_references_own_beside_the_worst():
    rows = [
        row("+x", truth=truth(0.2, 4.0, 0.09)),
        row("-z", truth=truth(0.3, 2.0, 0.05, is_bound=True)),
        row("+y", truth=None),
    ]
    found = worst_truth(rows)
    assert found is not None
    assert found["rms_kelvin"] == {"+x": 0.2, "-z": 0.3}
    assert (found["worst_rms_kelvin"], found["worst_rms_percent"]) == (0.3, 4.0)
    assert found["worst_bias_kelvin"] == -0.15
    assert found["own_kelvin"] == 0.05 and found["own_is_bound"]
    assert worst_truth([row("+x", truth=None), row("-z")]) is None


def test_kelvin_come_first_and_shared_voxels_are_marked():
    shared = worst_truth([row("+x", truth=truth(0.2, 4.0, 0.09, remarks=(SHARED,)))])
    bound = worst_truth([row("+x", truth=truth(0.3, None, 0.05, is_bound=True))])
    lines = [{"label": "a", "truth": shared}, {"label": "b", "truth": bound}]
    lines.append({"label": "c", "truth": None})
    rows = table_of(lines, TRUTH_COLUMNS).rows
    dash = "\N{EN DASH}"
    assert [list(each) for each in rows] == [
        ["0.200", "4.00", "0.0900, same voxels"],
        ["0.300", dash, "bound 0.0500"],
        [dash] * 3,
    ]
    wide = table_of(lines, ALL_TRUTH_COLUMNS).rows
    assert list(wide[0][:5]) == ["+x: 0.200", "4.00", "0.600", "-0.100", "0.0100"]
    by_time = table_of(
        [row("+x", truth=truth(0.2, 4.0, 0.09)), row("+x")], TRUTH_BY_TIME
    )
    assert [list(each) for each in by_time.rows] == [
        ["0.200, 0.00100", f"4.00, {dash}"],
        [dash, dash],
    ]
    notes = truth_notes(lines)
    assert notes[0] == "truth: against finer voxels, whose own error is about 0.0900 K"
    assert notes[1:] == [f"note: a: {SHARED}"]
    assert truth_notes([{"label": "c", "truth": None}]) == []


def test_a_reference_has_its_cost_its_error_and_its_order():
    cost: dict[str, Any] = {"pitch_m": [0.002], "nodes": 1000, "memory_bytes": 2**20}
    cost |= {"run_time_s": 2.0, "cached": False}
    reference = row("+x", costs=[cost, {**cost, "cached": True}])
    reference |= {"own_error": truth(0.2, 4.0, 0.09, is_bound=True)["own_error"]}
    (found,) = table_of([reference], REFERENCE_COLUMNS).rows
    assert list(found[:4]) == ["ball", "+x", "2, 2", "1,000, 1,000"]
    assert list(found[6:]) == [
        "no, yes",
        "bound 0.0900, 0.0450",
        "\N{EN DASH}, 1.50",
    ]


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "short.yaml"
    changed = {"truth": {"points": 500, "refinement": 3}, "loads": ["+x", "-y"]}
    path.write_text(write_yaml(read_yaml(SHIPPED) | changed))
    config = load_comparison(path, 16)
    return Study(config.bodies[0], config, Record(tmp_path))


def test_the_scene_of_a_reference_is_that_of_the_comparison(study):
    """Its terms, bodies and times, by the config as by hand."""
    config = study.config
    for load in config.loads:
        scene = scene_config(study.body, config, study.subject.grid.mesh.axes, load)
        assert scene.time.save_times == config.time.save_times
        (body,) = scene.bodies
        assert body.voxels_high == 16 and body.temperature == config.temperature
        assert body.material == config.material and body.shape == study.body.shape
        sun: Any = scene.terms[0]
        built = sun.build()
        expected = rays(study.subject.grid.mesh.axes, load)
        np.testing.assert_allclose(built.direction, expected)
        assert scene.terms[1:] == config.terms
        assert sun.until == config.sun.until


def test_truth_makes_rows_of_its_own_and_changes_no_other(study):
    assert study.config.truth is not None
    plain = study.config.model_copy(update={"truth": None})
    assert common_identity(plain) == common_identity(study.config)
    cases = Truth(study, study.config.truth).cases
    assert [c.label for c in cases[:2]] == ["full volume", "single shell"]
    assert len(cases) == 1 + len(study.config.structures)
