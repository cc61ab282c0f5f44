"""Sweeps: the shipped ones load, choices are as written, mistakes are one line."""

from pathlib import Path

import pytest

from calibrate.study.config import OptunaSampling, load_sweep, sweep_hash
from calibrate.study.points import Study, cases_of, choices
from jaxthermo.errors import InputError
from tests.sweeping import SWEEP, sweep_file


CONFIGS = Path(__file__).resolve().parents[3] / "configs" / "sweeps"
AXES = """axes:
  kind:
    - {label: blocks, set: {bodies.0.structure: {kind: aggregate, factor: 2}}}
    - {label: octree, set: {bodies.0.structure: octree}}
  pitch: {key: bodies.0.voxels_high, values: [8, 10]}
  within: {key: bodies.0.structure.weights.within, between: [0.5, 2], log: true}
"""


def sampled(folder: Path, sampling: str):
    head, _, tail = SWEEP.partition("axes:")
    truth_block = tail[tail.index("truth:") :]
    return sweep_file(folder, f"{head}{AXES}sampling: {sampling}\n{truth_block}")


def drawn(folder: Path, sampling: str):
    return choices(load_sweep(sampled(folder, sampling)))


PATHS = sorted(CONFIGS.glob("*.yaml"))


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_dozen_cases_of_a_shipped_sweep_are_valid(path):
    config = load_sweep(path)
    all_choices = choices(config)
    _check(config, all_choices[:: len(all_choices) // 12 + 1])


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_every_case_of_a_shipped_sweep_is_valid(path):
    config = load_sweep(path)
    _check(config, choices(config))


def _check(config, choices_of_config):
    one_load = config.model_copy(update={"loads": config.loads[:1]})
    cases = [
        c
        for choice in choices_of_config
        for c in cases_of(one_load, choice, find_meshes=False)
    ]
    cases += cases_of(config, choices_of_config[0], find_meshes=False)
    assert len(cases) == len(choices_of_config) + len(config.loads) >= 4
    assert len({case.names for case in cases}) == len(choices_of_config)


def test_the_sweeps_that_plans_are_compared_with_have_sixty_cases():
    for name in ("part", "figurine-wind", "mixed"):
        assert len(choices(load_sweep(CONFIGS / f"{name}.yaml"))) >= 60


def test_a_grid_is_the_product_of_its_axes(tmp_path):
    config = load_sweep(sweep_file(tmp_path))
    all_choices = choices(config)
    assert [choice.labels for choice in all_choices] == [
        (("within", "0.8"),),
        (("within", "1"),),
        (("within", "1.25"),),
    ]
    first, second = cases_of(config, all_choices[0])
    assert (first.load, second.load) == ("+x", "+z")
    assert first.config.bodies[0].structure.weights.within == 0.8
    assert len({c.id for choice in all_choices for c in cases_of(config, choice)}) == 6
    assert first.shape_key == cases_of(config, all_choices[2])[0].shape_key


@pytest.mark.parametrize("sampling", ["random", "sobol"])
def test_points_that_are_drawn_are_the_same_for_a_seed(tmp_path, sampling):
    points = drawn(tmp_path, f"{{kind: {sampling}, count: 12, seed: 3}}")
    assert points == drawn(tmp_path, f"{{kind: {sampling}, count: 12, seed: 3}}")
    assert points != drawn(tmp_path, f"{{kind: {sampling}, count: 12, seed: 4}}")
    assert len(points) == 12
    values = [c.set["bodies.0.structure.weights.within"] for c in points]
    assert all(0.5 <= value <= 2 for value in values)
    # Even in the logarithm: about half of them are below 1.
    assert 3 <= sum(value < 1 for value in values) <= 9
    assert {dict(c.labels)["kind"] for c in points} == {"blocks", "octree"}


def test_a_point_of_a_list_may_name_several_labels(tmp_path):
    text = """
  kind: list
  points:
    - {kind: octree, pitch: 8, within: 2.0}
    - {kind: blocks, pitch: [8, 10], within: [0.5, 2.0]}"""
    path = sampled(tmp_path, text)
    path.write_text(path.read_text().replace("log: true", "count: 2"))
    all_choices = choices(load_sweep(path))
    assert len(all_choices) == 5
    assert all_choices[0].labels == (
        ("kind", "octree"),
        ("pitch", "8"),
        ("within", "2.0"),
    )


def test_a_study_asks_the_same_when_it_is_told_the_same(tmp_path):
    config = load_sweep(sampled(tmp_path, "{kind: optuna, count: 6, seed: 1}"))
    assert isinstance(config.sampling, OptunaSampling)
    asked = []
    for _ in range(2):
        study = Study(config, config.sampling)
        proposed = []
        for _ in range(3):
            for trial, choice in study.ask(2):
                proposed.append(choice)
                study.tell(
                    trial, float(len(proposed)) if len(proposed) % 3 else None, 5.0
                )
        asked.append(proposed)
    assert asked[0] == asked[1] and len({c.labels for c in asked[0]}) > 3


def test_the_hash_is_that_of_values_not_of_folders(tmp_path):
    errors = []
    for name, text in (("a", SWEEP), ("b", SWEEP), ("c", SWEEP.replace("300", "301"))):
        (tmp_path / name).mkdir()
        errors.append(sweep_hash(load_sweep(sweep_file(tmp_path / name, text))))
    assert errors[0] == errors[1] != errors[2]


WITHIN = "within: {key: bodies.0.structure.weights.within, values: [0.8, 1, 1.25]}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (f"\n  {WITHIN}", " {}", "axes: an empty sweep: give an axis at least"),
        ("[0.8, 1, 1.25]", "[]", "axes.within.values: must not be empty"),
        ("[0.8, 1, 1.25]", "[1, 1]", "axes.within.1: '1' is there twice"),
        (WITHIN, "a: {key: b, between: [1, 2]}", "axes.a.count: missing"),
        (WITHIN, "a: {key: b, between: [2, 1]}", "axes.a.between: 1 is not above 2"),
        (WITHIN, "a: {key: b, between: 3}", "expected two numbers"),
        ("name: +z", "name: +x", "loads.1: '+x' is there twice"),
        ("voxels_high: 16, ", "", "truth: missing `voxels_high` or `pitch`"),
        ("repeats: 2", "sampling: gird", "unknown kind 'gird'; did you mean 'grid'?"),
        (
            "repeats: 2",
            "sampling: {kind: list, points: [{withn: 1}]}",
            "sampling.points.0.withn: names no axis; there are within",
        ),
        (
            "repeats: 2",
            "sampling: {kind: list, points: [{within: 3}]}",
            "points.0.within: the axis has no '3'; it has 0.8, 1, 1.25",
        ),
    ],
)
def test_a_mistake_is_one_line_with_its_path(tmp_path, old, new, message):
    assert old in SWEEP
    with pytest.raises(InputError) as told:
        load_sweep(sweep_file(tmp_path, SWEEP.replace(old, new)))
    assert message in str(told.value) and "\n" not in str(told.value)
