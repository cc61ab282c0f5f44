"""Scene files whose right result has a closed form, through the command line."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from cli_runs import succeed


SCENES = Path(__file__).parents[1] / "data" / "mesh_and_heat"


class Results(NamedTuple):
    """What a run writes into its folder."""

    solution: dict[str, np.ndarray]
    summary: dict[str, Any]


@pytest.fixture
def results_of(out):
    """Return the function that simulates a scene by the name of its file."""

    def results(name: str) -> Results:
        succeed("simulate", SCENES / f"{name}.yaml", "--out", out)
        with np.load(out / "solution.npz") as arrays:
            solution = dict(arrays)
        summary = json.loads((out / "summary.json").read_text())
        return Results(solution, summary)

    return results


def test_thin_sheet_is_heated_as_one_capacity(results_of):
    # 1250 W/m^2 into two sides of 10 W/(m^2 K), ten time constants.
    surface = results_of("sheet").solution["surface_temperature"]
    rise = 1250 / (2 * 10) * (1 - np.exp(-10))
    assert surface[-1] - 298.15 == pytest.approx(rise, rel=2e-4)
