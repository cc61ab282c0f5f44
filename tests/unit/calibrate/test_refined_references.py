"""Runs of finer voxels: refused, judged by, and computed once."""

import json
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from calibrate.analysis.truth import Truth
from calibrate.analysis.verdict import judge, truth_times
from calibrate.config.fit_record import read_fit, write_fit
from calibrate.config.loader import load_calibration
from calibrate.config.schema import RefinedReference
from calibrate.problem.reference import TruthReference, refined_reference
from calibrate.problem.targets import surface_target
from calibrate.report.text_summary import _truth_cost, summary, truth_table
from calibrate.run import fit_config
from jaxthermo.config.loader import load_config
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.report.table import Cell
from jaxthermo.scene.scene import BodyGeometry, SolvedSurface
from tests.calibrating import FAST, RESULT, SPHERE, errors_of


ERRORS = errors_of([4.0, 3.0], fitted=[2.0, 1.0])
FIT = """
scene: scene.yaml
train: [{name: "+x"}]
held_out: [{name: "+y", set: {terms.0.direction: [0, -1, 0]}}]
parameters: [{name: weights.within}]
truth: {points: 500}
"""


def truth(default, fitted, reference, is_bound=(False, False)) -> Any:
    times = {"times_s": [30.0, 60.0]}

    def error(kelvin):
        return {
            **times,
            "rms_kelvin": kelvin,
            "rms_percent": [10 * kelvin[0], None],
            "remarks": ["body 0 has the voxels of the reference"],
        }

    own_error = {
        **times,
        "rms_kelvin": reference,
        "rms_percent": [10 * kelvin for kelvin in reference],
        "is_bound": list(is_bound),
        "worst_rms_kelvin": max(reference),
    }
    case = {"default": error(default), "fitted": error(fitted), "reference": own_error}
    run = {
        "case": "+x",
        "pitch_m": [0.002],
        "nodes": 1000,
        "steps": 20,
        "memory_bytes": 2**20,
        "run_time_s": 3.0,
        "cached": True,
        "refinement": 2.0,
        "warnings": ["thin walls"],
    }
    coarser = {
        "run_time_s": 0.5,
        "cached": False,
        "refinement": 1.0,
        "warnings": ["very thin walls"],
    }
    cost = [run, run | coarser]
    return {
        "refinement": 2.0,
        "structure": "full_volume",
        "points": 500,
        "cases": {"train": {"+x": case}},
        "cost": cost,
    }


def test_kelvin_and_the_references_own_error_are_in_the_verdict():
    errors = truth([0.4, 0.3], [0.2, 0.25], [0.02, 0.05])
    verdict: Any = judge(ERRORS, FAST, is_of_weights=True, truth=errors)
    assert verdict["pays"] and verdict["truth"]["worse"] == 0
    assert (
        "against voxels 2 times as fine the error goes from 0.400 K (4.00 %) to 0.250 "
        "K (2.00 %), where these are off by about 0.0500 K" in verdict["words"]
    )
    assert "too much to tell" not in verdict["words"]
    # Without finer voxels nothing is said of them.
    plain: Any = judge(ERRORS, FAST, is_of_weights=True)
    assert plain["truth"] is None and "finer" not in plain["words"]


def test_a_difference_that_the_reference_can_hide_is_not_judged():
    """Larger by 0.1 K: with an own error of 0.04 K it is so, with 0.06 K it may not."""
    for reference, is_worse in ((0.04, True), (0.06, False)):
        errors = truth([0.3, 0.3], [0.2, 0.4], [reference, reference])
        verdict = judge(ERRORS, FAST, is_of_weights=True, truth=errors)
        assert verdict["pays"] is not is_worse
        assert ("LARGER at 1 of 2 times" in verdict["words"]) is is_worse
        assert ("too much to tell" in verdict["words"]) is not is_worse
    assert [row.is_worse for row in truth_times(errors)] == [False, False]


def test_bounds_are_marked_in_the_table_and_the_verdict():
    errors = truth(
        [0.4, 0.3], fitted=[0.2, 0.35], reference=[0.02, 0.01], is_bound=(True, False)
    )
    table = truth_table(RESULT | {"truth": errors})
    assert table is not None
    first, second = table.rows
    assert list(first[:4]) == ["+x", "fitted to", "30", "0.400"]
    own_errors = [row[-1].text for row in table.rows if isinstance(row[-1], Cell)]
    assert own_errors == ["bound 0.0200", "0.0100"]
    assert second[5] == "\N{EN DASH}"
    marks = [row[4].met for row in table.rows if isinstance(row[4], Cell)]
    assert marks == [True, False]
    words = judge(ERRORS, FAST, is_of_weights=True, truth=errors)["words"]
    assert "off by at most about 0.0200 K" in words
    assert truth_table(RESULT | {"truth": None}) is None


def test_the_cost_is_told_and_shared_voxels_are_noted(tmp_path):
    errors = truth([0.4, 0.3], [0.2, 0.25], [0.02, 0.05])
    cost, remark, warning = _truth_cost(RESULT | {"truth": errors})
    assert "2 runs, 0.5 s now and 3 s before this fit (1 from the cache)" in cost
    assert "1,000 nodes and takes about 1.0 MiB" in cost
    assert remark == "Note: body 0 has the voxels of the reference."
    assert warning == "Note: the reference of +x: thin walls."
    # It is read again from the file.
    write_fit(tmp_path / "fit.json", RESULT | {"truth": errors})
    assert _truth_cost(read_fit(tmp_path / "fit.json")) == [cost, remark, warning]
    del errors["cost"][0]["nodes"]
    write_fit(tmp_path / "fit.json", RESULT | {"truth": errors})
    with pytest.raises(InputError, match=r"truth.cost.0.nodes"):
        read_fit(tmp_path / "fit.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("truth.refinement=0.5", "truth.refinement"),
        ("truth.structure=octre", "did you mean"),
        ("truth={pitch: 2 mm}", "unknown key"),
        ("reference=simulated_frames", "`reference` of runs"),
    ],
)
def test_mistakes_in_the_block(tmp_path, change, message):
    (tmp_path / "scene.yaml").write_text(SPHERE)
    (tmp_path / "fit.yaml").write_text(FIT)
    with pytest.raises(InputError, match=message):
        load_calibration(tmp_path / "fit.yaml", (change,))


def test_a_fit_to_finer_voxels_needs_their_block(tmp_path):
    (tmp_path / "scene.yaml").write_text(SPHERE)
    (tmp_path / "fit.yaml").write_text(FIT.replace("truth: {points: 500}", ""))
    with pytest.raises(InputError, match="needs the block `truth`"):
        load_calibration(tmp_path / "fit.yaml", ("reference=truth",))


def _surface(grid):
    body = BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_position,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=jt.Pose(),
    )
    return SolvedSurface(body, jnp.asarray(1.0), jnp.asarray(1.0))


def test_a_linear_field_of_finer_voxels_is_exact_at_the_fragments_of_coarser_ones():
    """Of two bodies, one of which has a part that the finer run lacks."""
    box = jt.shapes.box((0.6, 0.4, 0.2))
    fine, coarse = (_surface(jt.voxelize(box, pitch)) for pitch in (0.05, 0.1))

    def field(body, t):
        return 300.0 + t * body.fragment_position @ [30.0, -20.0, 10.0]

    def values(*bodies):
        return np.stack(
            [
                np.concatenate([n + field(b.geometry, t) for n, b in enumerate(bodies)])
                for t in (1.0, 2.0)
            ]
        )

    times = np.array([1.0, 2.0])
    solution = StoredSolution(times, values(fine, fine), (fine, fine))
    body_solution: Any = None
    reference = TruthReference(solution, body_solution, ())
    read_back, unknown = reference.read_at((coarse, coarse))
    assert not unknown.any() and read_back.surfaces == (coarse, coarse)
    np.testing.assert_allclose(
        read_back.surface_temperature, values(coarse, coarse), rtol=1e-4
    )
    # Far off, nothing is known: no residual, whatever the run has there.
    where = coarse.geometry.fragment_position.copy()
    where[:7] += 5.0
    geometry = replace(coarse.geometry, fragment_position=where)
    moved = coarse._replace(geometry=geometry)
    partly, unknown = reference.read_at((moved, coarse))
    assert unknown.nonzero()[0].tolist() == list(range(7))
    assert np.isfinite(partly.surface_temperature).all()
    target = surface_target(partly, jnp.float64, unknown)
    assert not target.scale[:, :7].any() and (target.scale[:, 7:] > 0).all()
    with pytest.raises(InputError, match="no surface in common"):
        nowhere = replace(moved.geometry, fragment_position=where + 50.0)
        reference.read_at((moved._replace(geometry=nowhere),) * 2)


def test_a_body_of_voxels_has_no_finer_ones(tmp_path):
    np.save(tmp_path / "solid.npy", np.ones((4, 4, 4), bool))
    path = tmp_path / "scene.yaml"
    path.write_text(SPHERE)
    body = (
        "bodies.0={solid: solid.npy, pitch: 0.01, material: copper, temperature: 300}"
    )
    config = load_config(path, (body,))
    with pytest.raises(InputError, match=r"^truth: body 0 is given by its voxels"):
        refined_reference(config, RefinedReference(), lambda _: None)


@pytest.mark.slow
def test_a_run_is_made_once_and_is_as_fine_as_asked(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / "structures"))
    path = tmp_path / "scene.yaml"
    said = []
    path.write_text(SPHERE)
    settings = RefinedReference(points=500)
    config = load_config(path, ("bodies.0.surface_map={kind: linear, at: voxel}",))
    first: Any = refined_reference(config, settings, said.append)
    assert said == [f"running full volume of {h} mm" for h in ("12.5", "25", "50")]
    pitches = [cost["pitch_m"] for cost in first.costs]
    np.testing.assert_allclose(pitches, [[0.0125], [0.025], [0.05]], rtol=1e-3)
    assert not any(cost["cached"] for cost in first.costs)
    assert [first.solution.surfaces[0].geometry.pitch] == pitches[0]
    # A camera, a solver or the structure that is judged is no reason to run it again.
    same = ("camera.width=90", "solver=forward_euler", "bodies.0.structure=octree")
    second: Any = refined_reference(load_config(path, same), settings, said.append)
    assert len(said) == 3 and all(cost["cached"] for cost in second.costs)
    for first_cost, second_cost in zip(first.costs, second.costs, strict=True):
        assert first_cost | {"cached": True} == second_cost
    np.testing.assert_array_equal(
        first.own_error.rms_kelvin, second.own_error.rms_kelvin
    )
    # Finer voxels share runs: those of the coarser ones are there.
    finer = RefinedReference(refinement=4, points=500)
    third: Any = refined_reference(config, finer, said.append)
    assert [cost["cached"] for cost in third.costs] == [False, True, True]
    # A damaged file is written anew.
    for path_of_run in tmp_path.rglob("reference-*.bin"):
        path_of_run.write_bytes(path_of_run.read_bytes()[:-1])
    refined_reference(config, settings, said.append)
    assert len(said) == 7
    # Loads are.
    load = load_config(path, ("terms.0.irradiance=4000",))
    refined_reference(load, settings, said.append)
    assert len(said) == 10


@pytest.mark.slow
def test_a_fit_reports_the_errors_against_finer_voxels(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / "structures"))
    (tmp_path / "scene.yaml").write_text(SPHERE)
    (tmp_path / "fit.yaml").write_text(FIT)
    out = tmp_path / "out"
    result: Any = fit_config(tmp_path / "fit.yaml", out, report=False)
    truth_result = result["truth"]
    assert set(truth_result["cases"]) == {"train", "held_out"}
    for group in truth_result["cases"].values():
        for case in group.values():
            assert case["default"]["times_s"] == [30, 60]
            assert 0 < case["fitted"]["worst_rms_kelvin"] < 5
            assert case["fitted"]["remarks"] == []
            assert all(0 < kelvin < 5 for kelvin in case["reference"]["rms_kelvin"])
    assert len(truth_result["cost"]) == 6
    assert "against voxels 2 times as fine" in result["verdict"]["words"]
    stored: Any = read_fit(out / "fit.json")
    assert json.loads(json.dumps(result["truth"])) == stored["truth"]
    assert any("references of finer voxels took 6 runs" in s for s in summary(stored))
    # A run with fitted values that fails does not cost the fit.
    first = Truth._error
    error = InputError("it diverged")

    def fail(self, name, z):
        return first(self, name, z) if not z.any() else _raise(error)

    monkeypatch.setattr(Truth, "_error", fail)
    with pytest.warns(UserWarning, match="case \\+x: no error .*: it diverged"):
        result = fit_config(tmp_path / "fit.yaml", tmp_path / "other", report=False)
    assert result["truth"] is None and result["verdict"]["truth"] is None
    stored = read_fit(tmp_path / "other" / "fit.json")
    assert stored["truth"] is None
    # What fails before is said before.
    monkeypatch.setattr(Truth, "_error", lambda *_: _raise(error))
    with pytest.raises(InputError, match=r"^case \+x: it diverged$"):
        fit_config(tmp_path / "fit.yaml", tmp_path / "third", report=False)
    assert not (tmp_path / "third").exists()


def _raise(error):
    raise error


@pytest.mark.slow
def test_a_fit_to_finer_voxels_lessens_the_errors_against_them(tmp_path, monkeypatch):
    """With short steps, so that the error in time plays no part."""
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / "structures"))
    (tmp_path / "scene.yaml").write_text(SPHERE.replace("high: 8", "high: 12"))
    (tmp_path / "fit.yaml").write_text(FIT)
    steps = ("reference=truth", "set={solver: {kind: forward_euler, dt: 0.5}}")
    result: Any = fit_config(
        tmp_path / "fit.yaml", tmp_path / "out", steps, report=False
    )
    assert result["reference"] == "truth"
    assert len(result["truth"]["cost"]) == 6
    for group, cases in result["truth"]["cases"].items():
        for name, case in cases.items():
            default_kelvin = case["default"]["rms_kelvin"]
            assert max(case["fitted"]["rms_kelvin"]) < max(default_kelvin)
            # At the fragments instead of points between them: less even.
            reference_kelvin = result["errors"][group]["default"][name]["rms_kelvin"]
            np.testing.assert_allclose(reference_kelvin, default_kelvin, rtol=0.4)
            assert min(reference_kelvin) > min(default_kelvin)
