"""Random scenes keep energy, bounds and stated error; one that does not is seen."""

import pytest

from experiments import catalogue
from experiments.harness.case import FAIL, PASS, check
from experiments.random_scenes.draw import FORMS, draw
from experiments.random_scenes.measure import RunRow, SceneRow
from experiments.random_scenes.run import SCENES, Scene, _numbers, judged
from jaxthermo.errors import InputError


(EXPERIMENT,) = catalogue.find("random-scenes")


def _failed_rows(result) -> list[dict]:
    cases = result["result"]["cases"]
    return [row for case in cases for row in case["rows"] if row["verdict"] == FAIL]


def test_three_scenes_of_one_form_keep_every_limit(tmp_path):
    numbers = (0, len(FORMS), 2 * len(FORMS))
    cases = ",".join(map(str, numbers))
    result = catalogue.run(EXPERIMENT, tmp_path, cases=cases)
    assert not _failed_rows(result)
    assert result["result"]["passed"] == ["R1", "R2", "R3"]


@pytest.mark.slow
def test_all_scenes_keep_every_limit(request):
    # The rows of an interrupted run of the same programs are used again.
    folder = request.config.cache.mkdir("random-scenes")
    assert not _failed_rows(catalogue.run(EXPERIMENT, folder))


def _scene(number=0, *, residual=1e-6, over=0.0, stated=2e-3, true=1e-3, told=()):
    run: RunRow = {
        "solver": "TRBDF2",
        "steps": 1,
        "result": "successful",
        "energy_residual": residual,
        "overshoot": over,
        "warnings": list(told),
    }
    row: SceneRow = {
        "form": "block",
        "dtype": "float32",
        "runs": [run],
        "stated_error": stated,
        "true_error": true,
    }
    return Scene(number, row)


def _verdicts(*scenes: Scene) -> list[str]:
    return [check(case).verdict for case in judged(list(scenes))]


@pytest.mark.parametrize(
    ("changed", "failed"),
    [
        ({}, None),
        ({"residual": 1e-4}, 0),
        ({"residual": float("nan")}, 0),
        ({"residual": 1e-4, "told": ["loses heat"]}, 0),
        ({"over": 2e-3}, 1),
        ({"stated": 0.9e-3}, 2),
        ({"stated": 13e-3}, 2),
        ({"true": float("nan")}, 2),
    ],
)
def test_a_scene_that_misses_a_limit_fails_its_case(changed, failed):
    expected = [FAIL if number == failed else PASS for number in range(3)]
    assert _verdicts(_scene(**changed)) == expected


def test_one_of_a_hundred_may_lose_heat_if_it_says_so():
    good = [_scene(number) for number in range(99)]
    told = _scene(99, residual=1e-4, told=["loses heat"])
    silent = _scene(99, residual=1e-4)
    assert _verdicts(*good, told) == [PASS] * 3
    assert _verdicts(*good, silent)[0] == FAIL
    assert (
        _verdicts(*good[1:], told, _scene(100, residual=1e-4, told=["too"]))[0] == FAIL
    )


def test_a_number_is_one_scene_in_every_process():
    first, again, other = (draw(number) for number in (3, 3, 3 + len(FORMS)))
    assert first.save_at == again.save_at and first.bounds == again.bounds
    assert first.save_at != other.save_at and first.form == other.form


def test_scenes_are_named_by_their_numbers():
    assert _numbers("7,2-4") == [2, 3, 4, 7]
    assert _numbers(None) == list(range(SCENES))
    for names in ("R1", "300", "", "4-3"):
        with pytest.raises(InputError, match="--cases"):
            _numbers(names)
