"""The thesis' claims on structures: their cases, and thickness by a plain loop."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp

from experiments.thesis.exhibit import Verdict
from experiments.thesis.exhibits import levels
from experiments.thesis.exhibits.levels import thickness
from tests.bodies import blocks
from tests.exhibits import measured


def brute_thickness(solid, voxel, axis):
    """Step both ways along the axis until outside."""
    count = 1
    for step in (-1, 1):
        index = np.array(voxel)
        while True:
            index[axis] += step
            outside = not 0 <= index[axis] < solid.shape[axis]
            if outside or not solid[tuple(index)]:
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


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:body 0 represents", "ignore:.*faces cavities")
def test_the_claims_hold_on_the_figurine(monkeypatch):
    monkeypatch.setattr(levels, "_LIMB_HEIGHT", 72)
    monkeypatch.setattr(levels, "_LIMB_LEVELS", (1, 2))
    for name in ("section-5.2-equilibrium", "section-6.1-holes"):
        found = measured(name)
        assert found.verdict is Verdict.REPRODUCED, found.numbers


@pytest.mark.slow
def test_a_sheet_is_right_where_a_hollow_shell_is_not():
    finding = measured("section-5.2-walls")
    assert finding.verdict is Verdict.REPRODUCED, finding.numbers
    assert finding.numbers["sheet_percent"] < 1 < finding.numbers["shell_percent"]
