"""Closed forms against numbers computed apart from this project, ids as V01..V22.

Expected numbers: the project's shared physics reference (verification.json,
semi_infinite.csv, heisler_theta.csv, heisler_roots.csv), evaluated there on its own.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.material.material import Material
from jaxthermo.reference import (
    radiation as lumped,
    semi_infinite,
    semi_infinite as contact,
    slab,
    slab as sine_mode,
)


STEEL = Material(conductivity=45.0, density=7800.0, specific_heat=460.0)
ALPHA = STEEL.diffusivity


# x [m], t [s], T with the surface at 100 degC, T with 3.2e5 W/m^2 [degC].
SEMI_INFINITE = [
    (0.0, 1.0, 100.0, 48.416629),
    (0.0, 60.0, 100.0, 240.11426),
    (0.005, 10.0, 80.178401, 78.746978),
    (0.01, 1.0, 23.668937, 20.61022),
    (0.01, 60.0, 83.726865, 176.27562),
    (0.02, 10.0, 36.532853, 31.09335),
    (0.05, 10.0, 20.12752, 20.048901),
    (0.05, 600.0, 74.68731, 417.53155),
]


def test_v01_surface_step():
    x, t, expected, _ = np.array(SEMI_INFINITE).T
    temperature = semi_infinite.surface_step(
        x, t, initial=20.0, surface=100.0, diffusivity=ALPHA
    )
    np.testing.assert_allclose(temperature, expected, rtol=1e-7)


def test_v02_surface_flux():
    x, t, _, expected = np.array(SEMI_INFINITE).T
    load = {"heat_flux": 3.2e5, "conductivity": 45.0, "diffusivity": ALPHA}
    temperature = semi_infinite.surface_flux(x, t, initial=20.0, **load)
    np.testing.assert_allclose(temperature, expected, rtol=1e-7)


def test_v02_holman_4_2():
    steel = Material(45.0, 8000.0, 401.79)
    temperature = semi_infinite.surface_flux(
        0.025,
        30.0,
        initial=35.0,
        heat_flux=3.2e5,
        conductivity=45.0,
        diffusivity=steel.diffusivity,
    )
    assert float(temperature) == pytest.approx(79.313554, abs=1e-6)


def convected(depth, time, h):
    return semi_infinite.surface_convection(
        depth,
        time,
        initial=0.0,
        ambient=1.0,
        heat_transfer_coefficient=h,
        conductivity=45.0,
        diffusivity=ALPHA,
    )


def test_surface_convection_meets_its_limits_without_overflow():
    x = np.array([0.0, 0.001, 0.01, 0.05])
    held = semi_infinite.surface_step(
        x, 1e3, initial=0.0, surface=1.0, diffusivity=ALPHA
    )
    np.testing.assert_allclose(convected(x, 1e3, 1e12), held, atol=1e-8)
    flux = semi_infinite.surface_flux(
        x, 1e3, initial=0.0, heat_flux=1e-6, conductivity=45.0, diffusivity=ALPHA
    )
    np.testing.assert_allclose(convected(x, 1e3, 1e-6), flux, rtol=1e-6)


def test_surface_convection_fulfils_its_boundary_condition():
    step = 1e-7
    inner, outer = convected(np.array([step, 0.0]), 60.0, 500.0)
    entering = 45.0 * (outer - inner) / step
    assert entering == pytest.approx(500.0 * (1.0 - outer), rel=1e-4)


def test_slab_eigenvalues():
    # heisler_roots.csv, slab.
    expected = [0.8603335890, 3.4256184595, 6.4372981792, 9.5293344054]
    np.testing.assert_allclose(slab._eigenvalues(1.0, 4), expected, atol=1e-10)
    assert slab._eigenvalues(0.01, 20)[0] == pytest.approx(0.0998336386)
    assert slab._eigenvalues(1000.0, 20)[19] == pytest.approx(61.1999330474)


@pytest.mark.parametrize(
    ("biot", "fourier", "centre", "half", "surface", "mean"),
    [
        (0.1, 0.05, 0.99997328, 0.99848171, 0.97526039, 0.99508287),
        (0.1, 2.0, 0.83732611, 0.82721968, 0.79714439, 0.82388885),
        (1.0, 0.05, 0.99975096, 0.98630020, 0.79037676, 0.95730998),
        (1.0, 0.2, 0.95064178, 0.87925481, 0.64339078, 0.85159546),
        (1.0, 2.0, 0.25466804, 0.23146682, 0.16609058, 0.22439400),
    ],
)
def test_v04_slab_convection(biot, fourier, centre, half, surface, mean):
    excess = slab.slab_convection(np.array([0.0, 0.5, 1.0]), fourier, biot)
    np.testing.assert_allclose(excess, [centre, half, surface], atol=2e-8)
    assert float(slab.slab_convection_mean(fourier, biot)) == pytest.approx(
        mean, abs=2e-8
    )


def test_v22a_slab_of_the_fire_dynamics_simulator():
    # L = 0.1 m, alpha = 1e-6, 1000 s, 20 -> 120 degC, h = 100, k = 0.1.
    position = np.linspace(0.0, 1.0, 6)
    excess = slab.slab_convection(position, 1e-6 * 1000.0 / 0.1**2, 100.0 * 0.1 / 0.1)
    expected = [24.791, 27.701, 37.429, 55.969, 83.880, 118.217]
    np.testing.assert_allclose(120.0 - 100.0 * excess, expected, atol=6e-4)


def test_slab_takes_many_times_at_once():
    times = np.array([0.05, 0.2])[:, None]
    excess = slab.slab_convection(np.array([0.0, 1.0]), times, 1.0)
    np.testing.assert_allclose(
        excess, [[0.99975096, 0.79037676], [0.95064178, 0.64339078]], atol=2e-8
    )


def test_v09_sine_mode():
    exact = sine_mode.sine_rate(1e-5, 0.1)
    cells = sine_mode.sine_rate_of_cells(1e-5, 0.1, 20)
    assert cells == pytest.approx(0.009849327523889818, rel=1e-14)
    amplitudes = [
        sine_mode.decay_exact(exact, 50.0),
        sine_mode.decay_exact(cells, 50.0),
        sine_mode.decay_explicit_euler(cells, 0.5, 100),
        sine_mode.decay_implicit_euler(cells, 0.5, 100),
        sine_mode.decay_crank_nicolson(cells, 0.5, 100),
    ]
    expected = [0.61049803, 0.61111729, 0.61037425, 0.61185636, 0.61111668]
    np.testing.assert_allclose(amplitudes, expected, atol=6e-9)


def test_v09_is_the_eigenvector_of_cells_with_half_cell_walls():
    cells = 20
    mode = 3
    matrix = 2.0 * np.eye(cells) - np.eye(cells, k=1) - np.eye(cells, k=-1)
    matrix[0, 0] = matrix[-1, -1] = 3.0
    centre = (np.arange(cells) + 0.5) / cells
    shape = np.sin(mode * np.pi * centre)
    rate = sine_mode.sine_rate_of_cells(1.0, 1.0, cells, mode)
    np.testing.assert_allclose(cells**2 * matrix @ shape, rate * shape, atol=1e-10)


COPPER = Material(401.0, 8933.0, 385.0)
STAINLESS = Material(15.1, 8055.0, 480.0)


def test_v11_perfect_contact():
    temperature = contact.perfect_contact(
        100.0, 0.0, COPPER.effusivity, STAINLESS.effusivity
    )
    assert temperature == pytest.approx(82.93590583, abs=1e-8)


def touching(time, conductance):
    return contact.contact_surfaces(
        time,
        temperature_a=100.0,
        temperature_b=0.0,
        effusivity_a=COPPER.effusivity,
        effusivity_b=STAINLESS.effusivity,
        contact_conductance=conductance,
    )


def test_v12_contact_conductance():
    a, b, flux = touching(np.array([0.1, 1.0, 10.0]), 1000.0)
    np.testing.assert_allclose(a, [99.080103, 97.340851, 93.450708], atol=1e-6)
    np.testing.assert_allclose(b, [4.470938, 12.924149, 31.831253], atol=1e-6)
    np.testing.assert_allclose(flux, [94609.165, 84416.703, 61619.455], rtol=1e-8)


def test_contact_limits():
    a, b, flux = touching(0.0, 1000.0)
    assert (float(a), float(b), float(flux)) == pytest.approx((100.0, 0.0, 1e5))
    a, b, _ = touching(1e4, 1e9)
    assert float(a) == pytest.approx(82.93590583, abs=1e-5)
    assert float(b) == pytest.approx(82.93590583, abs=1e-5)


# V14: a cube of aluminium, 0.1 m, rho 2700, c_p 900, eps 0.9.
CUBE = {
    "initial": 1000.0,
    "surroundings": 300.0,
    "capacity": 2700.0 * 900.0 * 1e-3,
    "area": 0.06,
    "emissivity": 0.9,
}


def test_v14_time_to_a_temperature():
    times = lumped.radiation_time(np.array([900.0, 700.0, 500.0, 400.0]), **CUBE)
    expected = [99.350085, 517.172931, 1979.070819, 4576.287399]
    np.testing.assert_allclose(times, expected, rtol=1e-8)


def test_v14_temperature_at_a_time():
    times = np.array([0.0, 60.0, 300.0, 600.0, 1800.0, 3600.0, 1e9])
    temperatures = lumped.radiation_temperature(times, **CUBE)
    expected = [1000, 934.667745, 778.764437, 677.388833, 513.013603, 425.566551, 300]
    np.testing.assert_allclose(temperatures, expected, atol=1e-6)


def test_v14_also_warms():
    cold = {**CUBE, "initial": 200.0}
    times = np.array([10.0, 1000.0, 5000.0])
    temperatures = lumped.radiation_temperature(times, **cold)
    assert (np.diff(temperatures) > 0).all() and temperatures[-1] < 300.0
    np.testing.assert_allclose(lumped.radiation_time(temperatures, **cold), times)
    still = lumped.radiation_temperature(times, **{**CUBE, "initial": 300.0})
    np.testing.assert_array_equal(still, 300.0)


def test_accepts_float32_jax_arrays_and_gives_float64():
    depth = jnp.asarray([0.01], jnp.float32)
    temperature = semi_infinite.surface_step(
        depth, 60.0, initial=20.0, surface=100.0, diffusivity=jnp.asarray(ALPHA)
    )
    assert temperature.dtype == np.float64
    np.testing.assert_allclose(temperature, [83.726865], rtol=1e-6)
    fourier = jnp.asarray(0.2, jnp.float32)
    assert slab.slab_convection(depth, fourier, 1).dtype == np.float64
