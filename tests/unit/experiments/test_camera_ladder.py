"""The ladder of a thermal camera, in a small size."""

import warnings

import numpy as np
import pytest

from experiments.camera import camera_ladder


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    patch = pytest.MonkeyPatch()
    patch.setattr(camera_ladder, "_SIZE", (160, 120))
    patch.setattr(camera_ladder, "_RUNS", 1)
    with warnings.catch_warnings():
        # So coarse, walls are thinner than a voxel.
        warnings.simplefilter("ignore", UserWarning)
        ladder = camera_ladder.run(tmp_path_factory.mktemp("ladder"), height=30)
    patch.undo()
    return ladder


@pytest.mark.slow
@pytest.mark.slice
def test_each_rung_changes_what_it_should(result):
    rows = {row["name"]: row for row in result["rungs"]}
    assert len(rows) == 12
    # The sun heats, and a long-wave camera hardly sees it.
    assert rows["all wavelengths"]["change_mean_K"] > 10
    assert rows["long wave"]["change_mean_K"] < -10
    # Towards the edges a sky is reflected that is colder than the body.
    assert rows["angle"]["change_mean_K"] < 0
    assert 0 < rows["air"]["change_rms_K"] < 0.2
    assert rows["lag"]["change_max_K"] < 1e-2
    assert rows["noise"]["change_rms_K"] == pytest.approx(0.05, rel=0.1)
    # Of 255 steps over 100 K, each error up to a half.
    assert rows["counts"]["change_rms_K"] == pytest.approx(0.39 / np.sqrt(12), rel=0.2)


@pytest.mark.slow
@pytest.mark.slice
def test_no_rung_is_the_one_before(result):
    assert all(row["change_max_K"] > 0 for row in result["rungs"][1:])
    assert all(row["frame_ms"] > 0 for row in result["rungs"])
