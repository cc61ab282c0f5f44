"""Closed forms of thin walls against fine differences, limits and conservation."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import solveh_banded

from jaxthermo.reference.sheets import sunlit_sphere
from tests import fin_forms


K = 8e-3
"""Sheet conductance [W/K]."""
H = 15.0
RADIUS = 0.05
FLUX = 800.0


def solve_rings(edges, width, load):
    """Excess on a row of cells: K (w theta')' - h w theta + q w = 0.

    `edges` are the borders of the cells; `width` is that of the wall at a position. No
    heat passes the two ends.
    """
    centre = (edges[1:] + edges[:-1]) / 2
    area = width(centre) * np.diff(edges)
    link = K * width(edges[1:-1]) / np.diff(centre)
    diagonal = H * area
    diagonal[1:] += link
    diagonal[:-1] += link
    bands = np.array([np.append(0.0, -link), diagonal])
    return centre, solveh_banded(bands, load(centre) * area)


def test_fin_obeys_its_equation_and_passes_its_heat_through_the_base():
    length = 0.1
    x = np.linspace(0, length, 2001)
    load = {"sheet_conductance": K, "heat_transfer_coefficient": H}
    theta = fin_forms.fin(x, length=length, **load)
    assert theta[0] == 1
    step = x[1]
    curvature = (theta[2:] - 2 * theta[1:-1] + theta[:-2]) / step**2
    assert_allclose(K * curvature, H * theta[1:-1], rtol=1e-5)
    # No heat passes the tip.
    assert abs(theta[-1] - theta[-2]) < 2e-5 * theta[-1] + H / K * step**2
    lost = H * 0.3 * np.trapezoid(theta, x)
    assert fin_forms.fin_heat_rate(length=length, width=0.3, **load) == pytest.approx(
        lost, rel=1e-6
    )


def test_cylinder_agrees_with_differences_around_it():
    half_way = np.linspace(0, np.pi * RADIUS, 1501)
    centre, theta = solve_rings(
        half_way,
        np.ones_like,
        lambda s: FLUX * np.maximum(np.cos(s / RADIUS), 0),
    )
    exact = fin_forms.sunlit_cylinder(
        centre / RADIUS,
        radius=RADIUS,
        sheet_conductance=K,
        heat_transfer_coefficient=H,
        heat_flux=FLUX,
    )
    assert np.ptp(exact) == pytest.approx(44, abs=0.5)
    assert_allclose(theta, exact, atol=2e-4)


def test_sphere_agrees_with_differences_from_pole_to_pole():
    way = np.linspace(0, np.pi * RADIUS, 1501)
    centre, theta = solve_rings(
        way,
        lambda s: 2 * np.pi * RADIUS * np.sin(s / RADIUS),
        lambda s: FLUX * np.maximum(np.cos(s / RADIUS), 0),
    )
    exact = sunlit_sphere(
        centre / RADIUS,
        radius=RADIUS,
        sheet_conductance=K,
        heat_transfer_coefficient=H,
        heat_flux=FLUX,
    )
    assert_allclose(theta, exact, atol=5e-4)


@pytest.mark.parametrize(
    ("form", "share"),
    [(fin_forms.sunlit_cylinder, 1 / np.pi), (sunlit_sphere, 1 / 4)],
)
def test_walls_in_the_sun_lose_what_they_absorb(form, share):
    load = {"radius": RADIUS, "heat_transfer_coefficient": H, "heat_flux": FLUX}
    angle = (np.arange(20000) + 0.5) * np.pi / 20000
    weight = np.ones_like(angle) if share > 0.3 else np.sin(angle)
    theta = form(angle, sheet_conductance=K, **load)
    assert np.average(theta, weights=weight) == pytest.approx(
        share * FLUX / H, rel=1e-6
    )
    # Without conduction each part of the wall is on its own, with much none is.
    alone = form(angle, sheet_conductance=1e-12, **load)
    assert_allclose(alone, FLUX / H * np.maximum(np.cos(angle), 0), atol=0.02)
    assert np.ptp(form(angle, sheet_conductance=1e6, **load)) < 1e-4


@pytest.mark.parametrize("form", [fin_forms.sunlit_cylinder, sunlit_sphere])
def test_walls_warm_as_their_equation_says(form):
    def at(time):
        return form(
            np.linspace(0, np.pi, 5),
            radius=RADIUS,
            sheet_conductance=K,
            heat_transfer_coefficient=H,
            heat_flux=FLUX,
            time=time,
            area_capacity=2000.0,
        )

    assert_allclose(at(0.0), 0.0, atol=1e-12)
    assert_allclose(at(1e5), at(np.inf), rtol=1e-12)
    # At first each point warms by what it absorbs, but at the border of the shadow.
    sunlit = FLUX * np.maximum(np.cos(np.linspace(0, np.pi, 5)), 0)
    rate = at(0.1) / 0.1
    assert_allclose(rate[[0, 1, 3, 4]], sunlit[[0, 1, 3, 4]] / 2000.0, atol=1e-3)


def test_disc_agrees_with_differences_along_its_radius():
    heated = 0.02
    edges = np.linspace(0, RADIUS, 2001)
    centre, theta = solve_rings(
        edges, lambda r: 2 * np.pi * r, lambda r: FLUX * (r < heated)
    )
    exact = fin_forms.heated_disc(
        centre,
        radius=RADIUS,
        heated_radius=heated,
        sheet_conductance=K,
        heat_transfer_coefficient=H,
        heat_flux=FLUX,
    )
    assert_allclose(theta, exact, atol=1e-4)
    lost = H * np.sum(exact * 2 * np.pi * centre) * edges[1]
    assert lost == pytest.approx(FLUX * np.pi * heated**2, rel=1e-5)


def test_disc_that_is_heated_everywhere_is_uniform():
    theta = fin_forms.heated_disc(
        np.linspace(0, RADIUS, 7),
        radius=RADIUS,
        heated_radius=RADIUS,
        sheet_conductance=K,
        heat_transfer_coefficient=H,
        heat_flux=FLUX,
    )
    assert_allclose(theta, FLUX / H, rtol=1e-12)


def test_three_equal_strips_share_the_temperature_of_their_ends():
    strips = {"length": (0.1,) * 3, "sheet_conductance": (K,) * 3}
    ends = (1.0, 0.0, 0.0)
    excess = fin_forms.junction(ends, heat_transfer_coefficient=(0.0,) * 3, **strips)
    assert excess == pytest.approx(1 / 3, rel=1e-14)
    nearly = fin_forms.junction(ends, heat_transfer_coefficient=(1e-9,) * 3, **strips)
    assert nearly == pytest.approx(1 / 3, rel=1e-6)


def test_two_strips_with_a_loss_are_one_fin_with_two_given_ends():
    m = np.sqrt(H / K)
    excess = fin_forms.junction(
        (3.0, 1.0),
        length=(0.03, 0.05),
        sheet_conductance=(K, K),
        heat_transfer_coefficient=(H, H),
    )
    exact = (3 * np.sinh(m * 0.05) + np.sinh(m * 0.03)) / np.sinh(m * 0.08)
    assert excess == pytest.approx(exact, rel=1e-12)
