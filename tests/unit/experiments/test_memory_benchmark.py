"""`experiments run memory`: runs in processes of their own, and what they took."""

import json
from pathlib import Path

import pytest

from experiments.benchmarks import memory


pytestmark = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="only Linux tells the peak"
)


@pytest.mark.slow
def test_a_small_ball_has_a_row_for_every_run(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "_STRUCTURES", {"octree": memory._STRUCTURES["octree"]})
    result = memory.run(tmp_path, height=40, solvers=["RKL2"])
    json.dumps(result, allow_nan=False)
    (row,) = result["rows"]
    assert (row["structure"], row["solver"]) == ("octree", "RKL2")
    assert row["nodes"] > 0 and row["measured_bytes"] > 0
    # Of so small a body the interpreter's own memory is a part.
    assert 0.3 < row["ratio"] < 2.0
    (measured,) = result["measurements"]
    assert measured["ours"] == [pytest.approx(100 * abs(row["ratio"] - 1))]
