"""The pieces of the convection experiment, on small cases."""

import numpy as np
import pytest

from experiments.thesis.exhibits import convection, cooling, cylinders
from experiments.thesis.nusselt import measure_knots
from jaxthermo.geometry.shapes import cylinder
from jaxthermo.voxels.cylinders import cylinder_parts
from jaxthermo.voxels.voxelize import voxelize


def test_every_knot_keeps_its_average_and_stays_near_its_points():
    rows = measure_knots()
    assert len(rows) == 18
    assert max(abs(row["average_mismatch"]) for row in rows) < 1e-12
    counts = {row["Re"]: len(row["minima_deg"]) for row in rows}
    assert [counts[re] for re in (20.0, 40.0, 1.013e5, 1.4e5)] == [0, 1, 1, 2]
    off = {row["Re"]: row["off_data_of_average"] for row in rows}
    computed = off[40.0]
    recalled = off[2.19e5]
    assert computed is not None and recalled is not None
    # The computed curves, then the recalled ones with their sharp peaks.
    assert computed < 2e-4 and 0.02 < recalled < 0.06
    assert off[1e4] is None
    assert [row["Re"] for row in rows if row["recalled"]][0] == 7.08e4


def test_averages_out_of_their_range_are_named():
    rows = {row["Re"]: row for row in convection.measure_averages()}
    name = list(rows[1e3])[2]
    assert f"{rows[1e3][name]:.4g}" == "15.64" and name in rows[1e3]["outside"]
    assert f"{rows[4e3][name]:.4g}" == "31.53" and name not in rows[4e3]["outside"]
    assert f"{rows[2.19e5]['largest_over_smallest']:.3f}" == "1.286"


def test_a_picture_shows_the_body_and_the_outline_of_its_cylinder():
    grid = voxelize(cylinder(0.02, 0.1), 0.005)
    parts = cylinder_parts(grid)
    image = cylinders.picture_of_parts(grid, parts, "looking along +y")
    blue = image[..., 2].astype(int) - image[..., 0] > 40
    rows, columns = np.nonzero(blue)
    # Upright: 100 mm by 40 mm.
    assert 2.3 < np.ptp(rows) / np.ptp(columns) < 2.6
    # The margin is around the body alone: 0.4 of the picture's width.
    assert 0.3 < blue.mean() < 0.4


def test_sides_are_compared_with_the_local_number_by_their_angle_to_the_wind():
    case = cooling.cylinder_in_wind(across=16)
    assert case.reynolds == pytest.approx(3.2e4, rel=0.05)
    degrees = np.degrees(np.arctan2(*case.grid.fragment_normal[:, 1::-1].T))
    # From the upstream line on either side, where the normal is -x.
    angle = 180 - np.abs(degrees)
    # Colder where more heat is taken, and the ends as they like.
    cold = -np.interp(angle, np.arange(5.0, 180.0, 10.0), case.local_numbers())
    (sectors,) = case.by_sector(300 + cold[None])
    assert len(sectors) == 18
    np.testing.assert_allclose(sectors, 300 - case.local_numbers(), atol=3.0)
    assert sectors.argmin() == 0 and sectors.argmax() == case.local_numbers().argmin()
