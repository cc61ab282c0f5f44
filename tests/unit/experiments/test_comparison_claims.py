"""The verdicts on the thesis' claims, by rows made up for them."""

import copy

import pytest

from experiments.structures.claims import (
    _capacity_claim,
    _equilibrium_claim,
    _levels_claim,
    _limb_claim,
    _path_claim,
    _speed_claims,
)
from experiments.structures.config import LimbConfig


def even(label: str, ratio: float, mean: float) -> dict:
    return {
        "label": label,
        "capacity_ratio": ratio,
        "mean_K": mean,
        "rise_K": mean - 300,
        "surface_range_K": 1e-9,
    }


def test_the_mean_at_the_end_is_judged_where_the_capacity_is_kept():
    rows = [
        even("full volume", 1.0, 302.0),
        even("octree", 1.0, 302.0),
        even("hollow", 0.5, 304.0),
    ]
    (claim,) = _equilibrium_claim(rows)
    assert claim["holds"] and "hollow +1e+02 %" in claim["found"][1]
    rows[1] = even("octree", 1.0, 302.00001)
    assert not _equilibrium_claim(rows)[0]["holds"]
    assert _equilibrium_claim([{"refused": "no"}]) == []


def level(count: int | str, error: float) -> dict:
    return {
        "hollow": "empty",
        "asked_for": count,
        "levels": 9 if count == "all" else count,
        "nodes": 10,
        "capacity_ratio": 1.0,
        "error": {"worst_rms_percent": error + 0.01},
        "from_full_volume_at_the_same_step": {"worst_rms_percent": error},
    }


@pytest.mark.parametrize(
    ("errors", "holds"),
    [((8.0, 2.0, 1e-5), True), ((2.0, 8.0, 1e-5), False), ((8.0, 2.0, 0.1), False)],
)
def test_levels_must_fall_and_end_at_the_full_volume(errors, holds):
    # In any order: the rows come as they are asked for.
    rows = [level("all", errors[2]), level(1, errors[0]), level(3, errors[1])]
    (claim,) = _levels_claim(rows)
    assert claim["holds"] is holds
    assert claim["found"][0].startswith("hollow empty, error by levels: ")


def test_the_hollow_part_must_be_worse_than_the_filled():
    limb = LimbConfig.model_validate(
        {
            "shape": {"kind": "figurine", "height": 0.5},
            "voxels_high": 50,
            "structures": [{"label": "a", "structure": "octree"}],
        }
    )
    part = lambda filled, hollow: {
        "label": "3 levels",
        "parts": [],
        "rms_kelvin": {"filled": filled, "hollow": hollow},
    }
    assert _limb_claim([part(0.1, 0.9)], limb)[0]["holds"]
    assert not _limb_claim([part(0.9, 0.1)], limb)[0]["holds"]
    assert _limb_claim([part(None, None), part(0.1, None)], limb) == []


def line(label: str, kind: str, time: float, steps: int, error: float) -> dict:
    return {
        "body": "ball",
        "label": label,
        "kind": kind,
        "run_time_s": {"median": time, "fastest": time, "slowest": time},
        "steps": steps,
        "times_faster": {"median": 8 / time, "least": 8 / time, "most": 8 / time},
        "worst_rms_percent": error,
    }


LINES = [
    line("full volume", "full volume", 8.0, 100, 0.1),
    line("full volume as links", "full volume as links", 16.0, 100, 0.1),
    line("shell", "single_shell", 1.0, 50, 20.0),
    line("levels", "multi_level", 4.0, 100, 8.0),
    line("irregular", "irregular_multi_level", 2.0, 100, 3.0),
    {"body": "ball", "label": "octree", "refused": "too large"},
]


def test_speed_is_told_a_run_and_a_step():
    (claim,) = _speed_claims(LINES)
    shell = claim["numbers"][0]
    assert claim["holds"] is None and shell["thesis"] == 4.23
    assert shell["a_run"]["median"] == 8
    assert shell["a_step"] == pytest.approx((8 / 100) / (1 / 50))
    assert shell["a_step_of_links"] == pytest.approx((16 / 100) / (1 / 50))
    assert len(claim["numbers"]) == len(claim["found"]) == 3
    without_links = _speed_claims([LINES[0], LINES[2]])[0]
    assert without_links["numbers"][0]["a_step_of_links"] is None


def test_errors_must_fall_from_shell_to_irregular():
    assert _path_claim(LINES)[0]["holds"]
    worse = copy.deepcopy(LINES)
    worse[4]["worst_rms_percent"] = 9.0
    assert not _path_claim(worse)[0]["holds"]
    assert _path_claim(LINES[:3]) == []


def irregular(keep: bool, ratio: float) -> dict:
    return {
        "body": "ball",
        "label": f"irregular {keep}",
        "kind": "irregular_multi_level",
        "capacity_ratio": ratio,
        "structure": {
            "options": {"keep_capacity": keep},
            "share_of_body_volume": {"overlap": 0.1, "crack": 0.05, "outside": 0.0},
        },
    }


def test_capacity_is_off_unless_it_is_kept():
    assert _capacity_claim([irregular(False, 1.05), irregular(True, 1.0)])[0]["holds"]
    assert not _capacity_claim([irregular(False, 1.05), irregular(True, 1.1)])[0][
        "holds"
    ]
    assert _capacity_claim([{"refused": "no", "kind": "octree"}]) == []
