"""`experiments run devices`: devices and processes in turn, on a small box."""

import json

import pytest

from experiments.benchmarks import devices


@pytest.mark.slow
def test_every_arrangement_has_its_row(tmp_path):
    scenes = "conduction", "conduction, stages of RKL2"
    result = devices.run(tmp_path, (6, 14, 6), repeats=2, steps=4, scenes=scenes)
    json.dumps(result, allow_nan=False)
    rows_by_scene = [
        [row for row in result["rows"] if row["scene"] == name] for name in scenes
    ]
    assert list(map(len, rows_by_scene)) == [4, 4]
    rows = rows_by_scene[0]
    assert [(row["devices"], row["processes"]) for row in rows] == [
        (1, 1),
        (2, 1),
        (2, 2),
        (4, 1),
    ]
    for row in result["rows"]:
        assert len(row["step_s"]) == 2 and min(row["step_s"]) > 0
    one_device, halves, one_half, quarters = (row["lattice_bytes"] for row in rows)
    # Each section has a plane of rim at both ends.
    assert one_device == 16 * 8 * 8 * 4 and halves == 2 * 9 * 8 * 8 * 4 == 2 * one_half
    # Of four sections, four planes thick, the last has two without a voxel.
    assert quarters == 4 * 6 * 8 * 8 * 4
