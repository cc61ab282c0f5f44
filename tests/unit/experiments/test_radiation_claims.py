"""C02, C03 and C04 as the experiment measures and draws them."""

import numpy as np
import pytest

from experiments.thesis.exhibit import Verdict
from experiments.thesis.exhibits import radiation
from jaxthermo.report.chart import write_chart
from tests.exhibits import measured


def test_c02_is_pi_squared_too_much():
    found = measured("section-5.1-flux").numbers
    assert found["two_squares_of_1_m_W_m2"] == pytest.approx(3.138, abs=1e-3)
    assert found["thesis_over_right"] == pytest.approx(9.87, abs=0.01)
    assert found["E_pi_over_R2_W_m2"] == pytest.approx(31.15, rel=1e-3)
    assert found["edge_of_squares_that_give_it_m"] == pytest.approx(3.25, abs=0.02)


@pytest.fixture(scope="module")
def rows():
    return radiation.measure_neighbours((0.1, 1.0, 10.0), directions=16)


def test_c03_near_bodies_matter(rows):
    share = np.array([row["share_of_100_K_excess"] for row in rows])
    assert share[0] > 0.8 and share[1] > 0.1 and share[2] < 0.01
    assert max(abs(row["error_of_voxels"]) for row in rows) < 0.03
    assert 1.0 < radiation.ten_percent_gap() < 2.0
    # What is left out is a wall as warm as its neighbour, in the limit.
    missed = [row["insulated_wall_missed_K"] for row in rows]
    assert 80 < missed[0] < 100 and missed[2] < 1


def test_the_chart_of_neighbours(rows, tmp_path):
    svg = write_chart(radiation.neighbour_chart(rows), tmp_path / "chart")
    assert svg.startswith("<svg") and "31.15" in svg
    assert (tmp_path / "chart.png").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.slice
def test_c04_within_a_hundredth():
    finding = measured("equation-3")
    found = finding.numbers
    assert finding.verdict is Verdict.DIFFERENT
    assert all(check["passes"] for check in found["checks"]), found["checks"]
    night = found["terminator"]
    assert night["last_lit_degrees"] == pytest.approx(90.0, abs=1.0)
    assert night["first_shaded_degrees"] > 85.0
    assert night["last_lit_degrees"] <= 90.0
    assert len(found["checks"]) == found["count"]
