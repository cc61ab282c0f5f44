"""The thesis' claims on structures: their cases, and thickness by a plain loop."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp

from experiments.harness.case import PASS, check
from experiments.thesis import levels
from experiments.thesis.levels import Sunlit, claims, thickness
from jaxthermo.geometry.shapes import figurine, sphere
from tests.bodies import blocks


def brute_thickness(solid, voxel, axis):
    """Step both ways along the axis until outside."""
    count = 1
    for step in (-1, 1):
        here = np.array(voxel)
        while True:
            here[axis] += step
            outside = not 0 <= here[axis] < solid.shape[axis]
            if outside or not solid[tuple(here)]:
                break
            count += 1
    return count


@settings(deadline=None, max_examples=20)
@given(hnp.arrays(bool, (4, 3, 5)))
def test_thickness_against_a_plain_loop(solid):
    if not solid.any():
        return
    grid = blocks(solid)
    found = thickness(grid)
    for value, voxel, axis in zip(
        found, grid.fragment_voxel, grid.fragment_axis, strict=True
    ):
        assert value == brute_thickness(solid, voxel, axis)


@pytest.mark.parametrize(
    ("errors", "holds"), [((20, 8, 3), True), ((20, 8, 9), False), ((7, 8, 3), False)]
)
def test_errors_must_fall_from_shell_to_irregular(errors, holds, monkeypatch):
    given = iter(errors)
    monkeypatch.setattr(Sunlit, "error", lambda *structure: next(given))
    found = list(levels._detours(Sunlit(sphere(0.1), 8)))
    assert all(each.passes is not False for each in found) is holds


def test_every_claim_is_a_case_that_nothing_runs_yet():
    found = claims(sphere(0.1), sphere(0.1), 8)
    assert [case.id for case in found] == ["C11", "C12", "C13", "C14"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:body 0 represents", "ignore:.*faces cavities")
def test_the_claims_hold_on_the_figurine(monkeypatch):
    monkeypatch.setattr(levels, "_LIMB_HEIGHT", 72)
    monkeypatch.setattr(levels, "_LIMB_LEVELS", (1, 2))
    monkeypatch.setattr(levels, "_LEVELS", (1, 2, 4))
    for case in claims(figurine(0.5), figurine(0.5), 64):
        outcome = check(case)
        assert outcome.verdict == PASS, (case.id, outcome.failure, outcome.worst)
