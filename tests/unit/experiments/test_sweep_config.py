"""Sweeps: the shipped ones load, choices are as written, mistakes are one line."""

from pathlib import Path

import pytest

from experiments.sweep.config import OptunaSampling, load_sweep, sweep_hash
from experiments.sweep.points import Study, cases_of, choices
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
    rest = tail[tail.index("truth:") :]
    return sweep_file(folder, f"{head}{AXES}sampling: {sampling}\n{rest}")


def drawn(folder: Path, sampling: str):
    return choices(load_sweep(sampled(folder, sampling)))


PATHS = sorted(CONFIGS.glob("*.yaml"))


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_dozen_cases_of_a_shipped_sweep_are_valid(path):
    config = load_sweep(path)
    chosen = choices(config)
    _check(config, chosen[:: len(chosen) // 12 + 1])


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_every_case_of_a_shipped_sweep_is_valid(path):
    config = load_sweep(path)
    _check(config, choices(config))


def _check(config, chosen):
    one_load = config.model_copy(update={"loads": config.loads[:1]})
    made = [c for each in chosen for c in cases_of(one_load, each, find_meshes=False)]
    made += cases_of(config, chosen[0], find_meshes=False)
    assert len(made) == len(chosen) + len(config.loads) >= 4
    assert len({case.names for case in made}) == len(chosen)


def test_the_sweeps_that_plans_are_compared_with_have_sixty_cases():
    for name in ("part", "figurine-wind", "mixed"):
        assert len(choices(load_sweep(CONFIGS / f"{name}.yaml"))) >= 60


def test_a_grid_is_the_product_of_its_axes(tmp_path):
    config = load_sweep(sweep_file(tmp_path))
    found = choices(config)
    assert [choice.labels for choice in found] == [
        (("within", "0.8"),),
        (("within", "1"),),
        (("within", "1.25"),),
    ]
    first, second = cases_of(config, found[0])
    assert (first.load, second.load) == ("+x", "+z")
    assert first.config.bodies[0].structure.weights.within == 0.8
    assert len({c.id for each in found for c in cases_of(config, each)}) == 6
    assert first.shape_key == cases_of(config, found[2])[0].shape_key


@pytest.mark.parametrize("kind", ["random", "sobol"])
def test_points_that_are_drawn_are_the_same_for_a_seed(tmp_path, kind):
    found = drawn(tmp_path, f"{{kind: {kind}, count: 12, seed: 3}}")
    assert found == drawn(tmp_path, f"{{kind: {kind}, count: 12, seed: 3}}")
    assert found != drawn(tmp_path, f"{{kind: {kind}, count: 12, seed: 4}}")
    assert len(found) == 12
    values = [c.set["bodies.0.structure.weights.within"] for c in found]
    assert all(0.5 <= value <= 2 for value in values)
    # Even in the logarithm: about half of them are below 1.
    assert 3 <= sum(value < 1 for value in values) <= 9
    assert {dict(c.labels)["kind"] for c in found} == {"blocks", "octree"}


def test_a_point_of_a_list_may_name_several_labels(tmp_path):
    text = """
  kind: list
  points:
    - {kind: octree, pitch: 8, within: 2.0}
    - {kind: blocks, pitch: [8, 10], within: [0.5, 2.0]}"""
    path = sampled(tmp_path, text)
    path.write_text(path.read_text().replace("log: true", "count: 2"))
    found = choices(load_sweep(path))
    assert len(found) == 5
    assert found[0].labels == (("kind", "octree"), ("pitch", "8"), ("within", "2.0"))


def test_a_study_asks_the_same_when_it_is_told_the_same(tmp_path):
    config = load_sweep(sampled(tmp_path, "{kind: optuna, count: 6, seed: 1}"))
    assert isinstance(config.sampling, OptunaSampling)
    asked = []
    for _ in range(2):
        study, own = Study(config, config.sampling), []
        for _ in range(3):
            for trial, choice in study.ask(2):
                own.append(choice)
                study.tell(trial, float(len(own)) if len(own) % 3 else None, 5.0)
        asked.append(own)
    assert asked[0] == asked[1] and len({c.labels for c in asked[0]}) > 3


def test_the_hash_is_that_of_values_not_of_folders(tmp_path):
    found = []
    for name, text in (("a", SWEEP), ("b", SWEEP), ("c", SWEEP.replace("300", "301"))):
        (tmp_path / name).mkdir()
        found.append(sweep_hash(load_sweep(sweep_file(tmp_path / name, text))))
    assert found[0] == found[1] != found[2]


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
