"""V23, V24, V25 and A14: numbers of radiation that were computed elsewhere."""

import numpy as np
import pytest

from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.reference import radiation, view_factor as forms
from jaxthermo.reference.view_factor import (
    _Rule,
    disc_rule,
    rectangle_rule,
    view_factor,
    view_factor_to_polygon,
)


X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
FLOOR = rectangle_rule(ORIGIN, first=X, second=Y, count=24)
CEILING = np.array([Z, Z + Y, Z + X + Y, Z + X])
WALL = np.array([ORIGIN, Y, Y + Z, Z])


def test_v23_parallel_squares():
    exact = forms.parallel_rectangles(1.0, 1.0, 1.0)
    assert exact == pytest.approx(0.1998248957, abs=1e-10)
    assert view_factor_to_polygon(FLOOR, CEILING) == pytest.approx(exact, abs=1e-12)
    by_two_integrals = view_factor(
        FLOOR, rectangle_rule(Z, first=Y, second=X, count=24)
    )
    assert by_two_integrals == pytest.approx(exact, abs=1e-12)


def test_v23_squares_that_share_an_edge():
    exact = forms.perpendicular_rectangles(1.0, 1.0, 1.0)
    assert exact == pytest.approx(0.2000437761, abs=1e-10)
    assert view_factor_to_polygon(FLOOR, WALL) == pytest.approx(exact, abs=1e-10)


def test_v23_the_sides_of_a_cube_see_each_other_and_nothing_else():
    across = forms.parallel_rectangles(1.0, 1.0, 1.0)
    to_a_neighbour = forms.perpendicular_rectangles(1.0, 1.0, 1.0)
    assert across + 4 * to_a_neighbour == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize(("height", "width"), [(0.5, 2.0), (3.0, 0.2)])
def test_unequal_rectangles(height, width):
    """The floor is normal to the wall, 1 m along their common edge."""
    floor = rectangle_rule(ORIGIN, first=width * X, second=Y, count=24)
    wall = WALL * np.array([1.0, 1.0, height])
    exact = forms.perpendicular_rectangles(1.0, height, width)
    assert view_factor_to_polygon(floor, wall) == pytest.approx(exact, abs=1e-8)
    ceiling = CEILING * np.array([width, 1.0, height])
    exact = forms.parallel_rectangles(width, 1.0, height)
    assert view_factor_to_polygon(floor, ceiling) == pytest.approx(exact, abs=1e-8)


def test_v23_discs():
    exact = forms.coaxial_discs(1.0, 1.0, 1.0)
    assert exact == pytest.approx(0.3819660113, abs=1e-10)
    lower = disc_rule(ORIGIN, normal=Z, radius=1.0, count=16)
    upper = disc_rule(Z, normal=-Z, radius=1.0, count=16)
    assert view_factor(lower, upper) == pytest.approx(exact, abs=1e-12)
    wide = disc_rule(0.7 * Z, normal=-Z, radius=1.5, count=24)
    exact = forms.coaxial_discs(1.0, 1.5, 0.7)
    assert view_factor(lower, wide) == pytest.approx(exact, abs=1e-6)


def test_v23_element_under_a_disc():
    element = _Rule(ORIGIN[None], Z[None], np.ones(1))
    factor = view_factor(element, disc_rule(Z, normal=-Z, radius=1.0, count=16))
    assert factor == pytest.approx(0.5, abs=1e-12)
    assert forms.element_to_disc(1.0, 1.0) == 0.5


def test_v24():
    plates = radiation.between_plates(400.0, 300.0, 0.8, 0.5)
    spheres = radiation.between_spheres(0.05, 0.1, 400.0, 300.0, 0.8, 0.5)
    assert plates == pytest.approx(441.0291215, rel=1e-9)
    assert spheres == pytest.approx(20.78300772, rel=1e-9)


def test_v25():
    assert radiation.solar_irradiance(5772.0) == pytest.approx(1361.1632, rel=1e-7)
    assert radiation.solar_irradiance(5800.0) == pytest.approx(1387.768, rel=1e-6)
    wall = radiation.sol_air_temperature(35.0, 0.9 * 1000.0, 17.0)
    roof = radiation.sol_air_temperature(35.0, 0.9 * 1000.0, 17.0, to_sky=0.9 * 63.0)
    assert (wall, roof) == pytest.approx((87.941176, 84.605882), abs=1e-6)


def test_a14_black_plates_over_an_element():
    black = STEFAN_BOLTZMANN * 1273.15**4
    square = 4 * forms.element_to_rectangle(1.0, 1.0, 1.0)
    assert square == pytest.approx(0.554126, abs=1e-6)
    heat_fluxes = [
        black * factor / 1e3
        for factor in (
            square,
            forms.element_to_strip(2.0, 1.0),
            forms.element_to_disc(1.0, 1.0),
        )
    ]
    assert heat_fluxes == pytest.approx([82.554, 105.345, 74.490], abs=1e-3)


def test_c02_a_black_square_metre_at_ten_metres():
    """The thesis has 31.15 W/m^2: pi^2 times too much, to its rounding."""
    excess = 5.67e-8 * (400.0**4 - 300.0**4)  # with the thesis' constant
    right = excess * forms.parallel_rectangles(1.0, 1.0, 10.0)
    assert right == pytest.approx(3.1376, abs=1e-4)
    small = excess / (np.pi * 10.0**2)
    assert small == pytest.approx(3.158, abs=1e-3)
    assert 31.15 / small == pytest.approx(np.pi**2, rel=1e-3)
