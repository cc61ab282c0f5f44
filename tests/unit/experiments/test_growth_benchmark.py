"""`experiments run growth`: times of small balls, and the power they grow with."""

import json
from typing import Any

import pytest

from experiments.benchmarks import growth


@pytest.mark.slow
def test_small_balls_have_times_and_a_page(tmp_path):
    result = growth.run(tmp_path, height=40, repeats=2)
    json.dumps(result, allow_nan=False)
    forms = [(row["form"], row["across"]) for row in result["rows"]]
    assert forms == [(f, n) for n in (28, 40) for f in ("stencil", "links")]
    assert all((tmp_path / file).is_file() for file in result["files"])
    # Too few nodes to say how the time grows beyond the caches.
    assert result["growth"] == {"stencil": None, "links": None}


def test_the_growth_is_the_power_of_the_nodes_from_a_million_on():
    def row(nodes, power) -> Any:
        return {"form": "links", "nodes": nodes, "node_ns": nodes ** (power - 1)}

    small = [row(10_000, 3.0)]
    large = [row(nodes, 1.1) for nodes in (1_000_000, 4_000_000, 30_000_000)]
    power = growth._growth([*small, *large], "links")
    assert power == pytest.approx(1.1)
    assert growth._growth(small, "links") is None
