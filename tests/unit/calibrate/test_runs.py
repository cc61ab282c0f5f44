"""Cases run alone and together, and the file of their rows."""

import json

import jax
import numpy as np
import pytest

from calibrate.study.case import build_case, loop_size, plan_case
from calibrate.study.evaluate import evaluate, evaluate_group, find_truth
from calibrate.study.rows import Rows, claim_folder
from calibrate.study.sweep import groups
from calibrate.study.times import time_case
from jaxthermo.accuracy.truth_error import truth_error, truth_points
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.run.solution import Solution
from tests.sweeping import SWEEP, sweep_cases


def test_cases_in_one_program_have_the_errors_that_they_have_alone(tmp_path):
    """Other weights, and so other stable steps and numbers of steps."""
    load_cases = [case for case in sweep_cases(tmp_path) if case.load == "+x"]
    truths = {"+x": find_truth(load_cases[0], lambda _: None)}
    together = [evaluated.row for evaluated in evaluate_group(load_cases, truths)]
    assert [row["together"] for row in together] == [3, 3, 3]
    assert len({row["steps"] for row in together}) > 1
    for case, row in zip(load_cases, together, strict=True):
        evaluated = evaluate(case, truths["+x"])
        alone = evaluated.row
        assert alone["together"] == 1 and evaluated.picture is not None
        assert row["steps"] == alone["steps"] and row["id"] == alone["id"] == case.id
        for name in ("rms_kelvin", "p99_kelvin", "bias_kelvin"):
            np.testing.assert_allclose(
                row["error"][name], alone["error"][name], rtol=1e-9, atol=1e-12
            )
    errors = [row["error"]["worst_rms_kelvin"] for row in together]
    assert max(errors) - min(errors) > 1e-4


def test_a_case_that_fails_is_a_row_and_does_not_end_the_others(tmp_path):
    text = SWEEP.replace("[0.8, 1, 1.25]", "[1]").replace(
        "\ntruth", "\n  step: {key: solver.dt, values: [auto, 1000 s]}\ntruth"
    )
    load_cases = [case for case in sweep_cases(tmp_path, text) if case.load == "+x"]
    truths = {"+x": find_truth(load_cases[0], lambda _: None)}
    good, bad = (evaluated.row for evaluated in evaluate_group(load_cases, truths))
    assert "error" in good and "failed" not in good
    assert "dt=1000 s is too long" in bad["failed"] and "error" not in bad
    assert bad["choice"]["step"] == "1000 s" and bad["id"] == load_cases[1].id


def test_groups_hold_cases_of_one_shape_and_load(tmp_path):
    text = SWEEP.replace(
        "\ntruth", "\n  high: {key: bodies.0.voxels_high, values: [8, 9]}\ntruth"
    )
    all_cases = sweep_cases(tmp_path, text)
    grouped = list(groups(all_cases))
    assert [len(group) for group in grouped] == [3, 3, 3, 3]
    for group in grouped:
        assert len({case.load for case in group}) == 1
        assert len({case.config.bodies[0].voxels_high for case in group}) == 1
    assert sorted(c.id for g in grouped for c in g) == sorted(c.id for c in all_cases)


def test_cases_of_another_material_have_another_reference(tmp_path):
    """Though their arrays have the same shapes."""
    material = "{conductivity: 16, density: 8000, specific_heat: 500, absorptivity: 1}"
    steel = f"{{label: other, set: {{bodies.0.material: {material}}}}}"
    text = SWEEP.replace("\ntruth", f"\n  made: [{{label: own}}, {steel}]\ntruth")
    load_cases = [case for case in sweep_cases(tmp_path, text) if case.load == "+x"]
    assert len({case.shape_key for case in load_cases}) == 1
    grouped = list(groups(load_cases))
    assert [len(group) for group in grouped] == [3, 3]
    for group in grouped:
        assert len({case.truth_key for case in group}) == 1
    first, second = (find_truth(group[0], lambda _: None).points for group in grouped)
    expected = [np.asarray(points.expected.temperature) for points in (first, second)]
    assert abs(expected[0] - expected[1]).max() > 1


def test_a_full_volume_of_the_references_voxels_has_no_error_but_that_of_its_steps(
    tmp_path,
):
    text = SWEEP.replace("voxels_high: 16, points", "voxels_high: 8, points")
    text = text.replace(
        "within: {key: bodies.0.structure.weights.within, values: [0.8, 1, 1.25]}",
        "kind: {key: bodies.0.structure, values: [full_volume, "
        "{kind: aggregate, factor: 2}]}",
    )
    load_cases = [case for case in sweep_cases(tmp_path, text) if case.load == "+x"]
    assert all(case.shares_voxels for case in load_cases)
    assert not any(case.shares_voxels for case in sweep_cases(tmp_path))
    full, blocks = (evaluate(c, find_truth(c, lambda _: None)).row for c in load_cases)
    assert full["error"]["worst_rms_percent"] < 0.5
    assert blocks["error"]["worst_rms_percent"] > 1
    assert full["energy_residual"] < 1e-12 and blocks["energy_residual"] < 1e-12


def test_points_of_a_reference_judge_as_the_reference_itself(tmp_path):
    case = sweep_cases(tmp_path)[0]
    coarse, fine = (
        case.config.model_copy(
            update={"bodies": (body.model_copy(update={"voxels_high": high}),)}
        )
        for body in case.config.bodies
        for high in (8, 16)
    )
    runs: list[Solution] = []
    for config in (coarse, fine):
        span = config.time.end, config.time.save_times
        runs.append(jax.block_until_ready(_simulated(config, span)))
    direct = truth_error(*runs, count=500, seed=2)
    by_points = truth_points(runs[1], 500, 2).error(runs[0])
    assert direct.as_dict() == by_points.as_dict()
    assert (
        truth_points(runs[0], 500)
        .error(runs[0])
        .remarks[0]
        .startswith("body 0 has the voxels of the reference")
    )


def _simulated(config, span):
    return simulate(config.build(), *span, solver=config.solver.build())


def test_a_time_is_measured_in_turn_with_the_full_volume(tmp_path):
    row = time_case(sweep_cases(tmp_path)[0], 2)
    assert len(row["loop_s"]) == len(row["full_volume_loop_s"]) == 2
    assert min(row["loop_s"] + row["full_volume_loop_s"] + row["call_s"]) > 0
    assert row["full_volume"]["timed_fraction"] == 1.0
    assert row["full_volume"]["nodes"] > 200 and "core" in row["processor"]
    json.dumps(row, allow_nan=False)


def test_loads_that_differ_in_numbers_only_have_loops_of_one_size(tmp_path):
    """Other weights have other stable steps; a controlled error, no size at all."""
    all_cases = sweep_cases(tmp_path)
    plans = [
        plan_case(case.config, build_case(case.config).scene) for case in all_cases
    ]
    sizes = [loop_size(plan) for plan in plans]
    for case, size in zip(all_cases, sizes, strict=True):
        for paired, its_size in zip(all_cases, sizes, strict=True):
            assert size == its_size or case.names != paired.names
    assert len(set(sizes)) > 1
    controlled = SWEEP.replace(
        "\ntruth",
        "\n  solver: [{label: adaptive, set: {solver: error_control}}]\ntruth",
    )
    case = sweep_cases(tmp_path, controlled)[0]
    plan = plan_case(case.config, build_case(case.config).scene)
    assert plan.control is not None and loop_size(plan) is None


def test_rows_of_a_killed_process_are_kept_but_for_half_a_line(tmp_path):
    path = tmp_path / "rows.jsonl"
    rows = Rows(path, "now")
    rows.append([{"id": "a"}, {"id": "b", "failed": "too long"}])
    rows.close()
    content = path.read_bytes()
    path.write_bytes(content + b'{"id": "c", "err')
    again = Rows(path, "now")
    assert list(again.by_id) == ["a", "b"] and path.read_bytes() == content
    again.append([{"id": "c"}])
    assert again.drop_failed() == 1
    again.close()
    last = Rows(path, "now")
    last.close()
    assert list(last.by_id) == ["a", "c"]
    assert b"failed" not in path.read_bytes()


def test_rows_of_another_program_are_put_aside(tmp_path):
    path = tmp_path / "rows.jsonl"
    for program in ("before", "now"):
        rows = Rows(path, program)
        assert not rows.by_id
        rows.append([{"id": "a"}])
        rows.close()
    aside = (tmp_path / "superseded.jsonl").read_text()
    assert json.loads(aside) == {"id": "a", "program": "before"}
    assert len(path.read_text().splitlines()) == 1


def test_two_processes_do_not_write_to_one_file(tmp_path):
    first = Rows(tmp_path / "rows.jsonl", "now")
    with pytest.raises(InputError, match="another process writes to it"):
        Rows(tmp_path / "rows.jsonl", "now")
    first.close()


def test_a_folder_belongs_to_one_config(tmp_path):
    folder = tmp_path / "new"
    claim_folder(folder, "one")
    claim_folder(folder, "one")
    with pytest.raises(InputError, match="holds the rows of another config") as told:
        claim_folder(folder, "two")
    assert "\n" not in str(told.value)
    # Rows whose config is not known are not mixed either.
    (folder / "rows.jsonl").touch()
    (folder / "config_hash.txt").unlink()
    with pytest.raises(InputError, match="unknown"):
        claim_folder(folder, "one")
