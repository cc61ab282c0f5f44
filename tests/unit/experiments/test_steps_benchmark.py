"""`experiments run steps`: a row of times for each structure."""

import json

import pytest

from experiments.benchmarks import steps


@pytest.mark.slow
def test_each_structure_has_its_times(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    result = steps.run(tmp_path, height=24, repeats=2)
    json.dumps(result, allow_nan=False)
    assert result["mesh"] == "figurine" and len(result["rows"]) == 6
    for row in result["rows"]:
        assert row["nodes"] > 10 and min(row["spans_s"]["conduction"]) > 0
    # The coarser the blocks, the fewer the nodes.
    nodes = [row["nodes"] for row in result["rows"]]
    assert nodes[0] < nodes[1] < nodes[2] < nodes[-1]
