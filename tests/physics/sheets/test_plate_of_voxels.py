"""A plate as a sheet is the plate of voxels, five of them through its thickness.

Sun at an angle, the shadow of a block and wind, on both large sides; the voxels' rim,
which a sheet does not have, takes part in nothing.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

import jaxthermo as jt
from tests.bodies import body_at
from tests.sheet_bodies import at_nodes, plate


SIZE = 0.12
THICKNESS = 0.01
START = 290.0
CONCRETE = jt.Material(
    1.2, density=2200.0, specific_heat=900.0, emissivity=0.9, absorptivity=0.7
)
UP = jt.Side((0.0, 0.0, 1.0), body=0)
DOWN = jt.Side((0.0, 0.0, -1.0), body=0)
TIMES = (120.0, 600.0, 1800.0, 3600.0)


def terms_on(surface):
    """Sun, wind and surroundings on a part of body 0."""
    return {
        "sun": (
            jt.Sun((0.5, 0.2, -0.8), 800.0, on=surface),
            jt.Convection(12.0, START, on=surface),
        ),
        "wind": (
            jt.Sun((0.5, 0.2, -0.8), 800.0, on=surface),
            jt.Wind((4.0, 0.0, 0.0), START, on=surface),
            jt.Surroundings(START - 10, on=surface),
        ),
    }


def shading_block():
    """A block that hides a part of the sun."""
    grid = jt.voxelize(jt.shapes.box((0.04, 0.06, 0.02)), 0.01)
    return body_at(grid, CONCRETE, START, at=(-0.03, 0.0, 0.05))


class Sides(NamedTuple):
    """Surface temperatures of the voxels' large sides."""

    upper: np.ndarray
    """[times, x, y, K]"""
    lower: np.ndarray
    axis: np.ndarray
    """Middles of the voxels along x and y [m]."""


def voxel_sides(terms, obstacles, layers):
    """Run the plate of voxels."""
    pitch = THICKNESS / layers
    grid = jt.voxelize(jt.shapes.box((SIZE, SIZE, THICKNESS)), pitch)
    # Its upper side is where the front of the sheet is.
    body = body_at(grid, CONCRETE, START, at=(0.0, 0.0, -THICKNESS / 2))
    scene = jt.Scene((body, *obstacles), terms, dtype="float64")
    solution = jt.simulate(scene, TIMES[-1], save_at=list(TIMES))
    values = np.asarray(solution.of_body(0))
    sides = []
    for sign in (1, -1):
        side = np.flatnonzero(sign * grid.fragment_normal[:, 2] > 0.9)
        order = np.lexsort(grid.fragment_position[side, 1::-1].T)
        count = round(SIZE / pitch)
        sides.append(values[:, side[order]].reshape(len(TIMES), count, count))
    axis = (np.arange(count) + 0.5) * pitch - SIZE / 2
    return Sides(sides[0], sides[1], axis)


def sheet_deviation(terms, obstacles, voxels, pitch, **options):
    """Rms deviation of the sheet from the voxels over their range, [faces, times]."""
    sheet = jt.Sheet(
        plate(SIZE, SIZE), (jt.Layer(CONCRETE, THICKNESS),), pitch=pitch, **options
    )
    body = jt.Body(sheet, temperature=START)
    scene = jt.Scene((body, *obstacles), terms, dtype="float64")
    solution = jt.simulate(scene, TIMES[-1], save_at=list(TIMES))
    values = np.asarray(solution.of_body(0))
    deviations = np.zeros((2, len(TIMES)))
    scale = np.ptp([voxels.upper, voxels.lower])
    for face, side in enumerate((voxels.upper, voxels.lower)):
        for number in range(len(TIMES)):
            reading = at_nodes(sheet, values[number], face)
            cell = (reading.position[:, :2] - voxels.axis[0]) / np.diff(voxels.axis[:2])
            exact = map_coordinates(side[number], cell.T, order=1, mode="nearest")
            deviations[face, number] = reading.rms(exact) / scale
    return deviations


@pytest.mark.parametrize(
    ("weather", "is_shaded"),
    [
        ("sun", True),
        pytest.param("sun", False, marks=pytest.mark.slow),
        pytest.param("wind", False, marks=pytest.mark.slow),
        pytest.param("wind", True, marks=pytest.mark.slow),
    ],
)
def test_sheet_is_the_plate_of_voxels(weather, is_shaded):
    obstacles = (shading_block(),) if is_shaded else ()
    voxels = voxel_sides(terms_on(UP | DOWN)[weather], obstacles, layers=5)
    whole = jt.Face("front", body=0) | jt.Face("back", body=0)
    deviations = sheet_deviation(
        terms_on(whole)[weather], obstacles, voxels, pitch=0.0025
    )
    assert deviations.max() < 0.01
