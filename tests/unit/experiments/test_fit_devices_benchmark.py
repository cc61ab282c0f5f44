"""`experiments run fit-devices`: one and two devices in turn, on a small body."""

import json

import pytest

from experiments.benchmarks import fit_devices


@pytest.mark.slow
def test_one_and_two_devices_are_measured(tmp_path):
    result = fit_devices.run(tmp_path, **fit_devices.QUICK)
    json.dumps(result, allow_nan=False)
    assert [row["values"] for row in result["rows"]] == [2, 2]
    for row in result["rows"]:
        for spans in (row["wall_s"], row["processor_s"]):
            assert all(len(spans[n]) == 2 and min(spans[n]) > 0 for n in ("one", "two"))
    assert len(result["measurements"]) == 4
