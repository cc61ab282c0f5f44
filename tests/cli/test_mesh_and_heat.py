"""Scene files whose right result has a closed form, through the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli_runs import succeed

import jaxthermo as jt


SCENES = Path(__file__).parents[1] / "data" / "mesh_and_heat"


@pytest.fixture
def solution_of(out):
    """Return the function that simulates a scene by the name of its file.

    It returns the arrays of the solution; `out` has the other results.
    """

    def solution(name: str) -> dict[str, np.ndarray]:
        succeed("simulate", SCENES / f"{name}.yaml", "--out", out)
        with np.load(out / "solution.npz") as arrays:
            return dict(arrays)

    return solution


def test_thin_sheet_is_heated_as_one_capacity(solution_of):
    # 1250 W/m^2 into two sides of 10 W/(m^2 K), ten time constants.
    surface = solution_of("sheet")["surface_temperature"]
    rise = 1250 / (2 * 10) * (1 - np.exp(-10))
    assert surface[-1] - 298.15 == pytest.approx(rise, rel=2e-4)


def test_horizontal_plate_has_two_sides_in_still_air(solution_of):
    # McAdams with L = A / P: 0.54 Ra^(1/4) above and 0.27 Ra^(1/4) below, Ra 5.4e6.
    h = solution_of("plate")["heat_transfer_coefficient"][-1]
    # Both faces have 100 x 100 fragments each, the narrow sides 800.
    coefficients, counts = np.unique(np.round(h, 1), return_counts=True)
    faces = sorted(coefficients[counts >= 10_000])
    assert faces == pytest.approx([2.9, 5.8], abs=0.15)


def test_held_face_is_shown_at_its_temperature(solution_of):
    solution = solution_of("held")
    face = solution["body0_fragment_normal"][:, 0] > 0.9
    assert solution["surface_temperature"][:, face] == pytest.approx(400.0, abs=1e-3)


def test_source_within_a_region_has_the_volume_of_the_region(solution_of, out):
    # 1e6 W/m^3 in (12 mm)^3 for 100 s, in voxels of 8 mm.
    solution_of("source")
    summary = json.loads((out / "summary.json").read_text())
    assert summary["energy"]["stored_J"][-1] == pytest.approx(172.8, rel=1e-4)
    (term,) = summary["terms"]
    assert term["volume_m3"] == pytest.approx(0.012**3, rel=1e-9)
    assert term["mean_heat_rate_W"] == pytest.approx(1.728, rel=1e-4)
    assert summary["bodies"][0]["mass_kg"] == pytest.approx(2700 * 0.04**3)


def test_flush_parts_cool_by_their_outer_surface(solution_of, out):
    # 1.5 litres of aluminium, as one capacity: Bi = 0.01.
    surface = solution_of("flush")["surface_temperature"]
    summary = json.loads((out / "summary.json").read_text())
    (term,) = summary["terms"]
    assert term["area_m2"] == pytest.approx(0.08, rel=1e-6)
    capacity = summary["bodies"][0]["mass_kg"] * 900
    above = 100 * np.exp(-100 * 0.08 * 100 / capacity)
    assert surface[-1].mean() - 300 == pytest.approx(above, rel=0.01)
    assert "33.3% of the surface lies inside" in summary["receipt"]["notes"][0]


def test_a_body_turns_as_its_angles_say(out):
    # Once about its axis: a square in parallel light shows 4 / pi of its side.
    succeed("simulate", SCENES / "turn.yaml", "--out", out)
    energy = json.loads((out / "summary.json").read_text())["energy"]
    expected = 1000 * 0.01 * 4 / np.pi * 60
    assert energy["sun_J"] == pytest.approx([expected], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("start", [300.0, 350.0, 400.0])
def test_a_rod_whose_conductivity_peaks_is_steady_from_every_start(start):
    # By the integral of k the middle is at 321.63 K; a probe there reads between nodes.
    rod = jt.voxelize(jt.shapes.box((0.1, 0.01, 0.01)), 0.005)
    conductivity = jt.Property([310.0, 320.0, 330.0], [1.0, 20.0, 1.0])
    material = jt.Material(conductivity, density=2000.0, specific_heat=500.0)
    ends = (
        jt.FixedTemperature(300.0, on=jt.Side((-1.0, 0.0, 0.0))),
        jt.FixedTemperature(400.0, on=jt.Side((1.0, 0.0, 0.0))),
    )
    body = jt.Body(jt.FullVolume(rod), material, temperature=start)
    probes = {"low": (-0.0025, 0.0, 0.0), "high": (0.0025, 0.0, 0.0)}
    scene = jt.Scene((body,), ends, dtype="float64", probes=probes)
    temperatures = jt.steady(scene).probe_temperature
    assert temperatures is not None
    assert float(temperatures.mean()) == pytest.approx(321.63, abs=0.01)
