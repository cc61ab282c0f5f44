"""Radiation between bodies: V24, conservation, gradients, stiffness."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array

from jaxthermo.arrays import is_traced
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.radiation.radiative_exchange import (
    RadiativeExchange,
    _enclosure,
    _Irradiated,
)
from jaxthermo.physics.radiation.view_factors import ViewFactors, view_factors
from jaxthermo.reference.radiation import between_plates, between_spheres
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import in_patches, moved, shell, surface_of, whole


def flux_of(exchange, emissivity, theta):
    """Net heat flux into surfaces at T_0 + theta [W/m^2]."""
    return emissivity * exchange.net(jnp.zeros((), theta.dtype), theta)


def of_patches(factor, area, emissivity, surroundings=300.0):
    """Surfaces of one fragment each, with temperatures counted from 300 K."""
    outside = area * (1 - factor.sum(1))
    views = ViewFactors(area, csr_array(area[:, None] * factor), outside)
    return _enclosure(
        views,
        patch=np.arange(len(area)),
        area=area,
        emissivity=emissivity,
        base=jnp.asarray(300.0),
        temperature=jnp.asarray(surroundings),
        above=jnp.asarray(0.0),
    )


def lost_by(factor, area, emissivity, kelvin):
    exchange = of_patches(factor, area, emissivity)
    return -area * flux_of(exchange, emissivity, jnp.asarray(kelvin - 300.0))


SPHERES = between_spheres(
    0.05, outer=0.1, hot=400.0, cold=300.0, emissivity_inner=0.8, emissivity_outer=0.5
)
PLATES = between_plates(400.0, cold=300.0, emissivity_hot=0.8, emissivity_cold=0.5)
FACING = np.array([[0.0, 1.0], [1.0, 0.0]])
SHARE = (0.05 / 0.1) ** 2


@pytest.mark.parametrize(
    ("factor", "area", "exact", "listed"),
    [
        (FACING, np.ones(2), PLATES, 441.0291215),
        (
            np.array([[0.0, 1.0], [SHARE, 1 - SHARE]]),
            4 * np.pi * np.array([0.05, 0.1]) ** 2,
            SPHERES,
            20.78300772,
        ),
    ],
    ids=["endless plates", "concentric spheres"],
)
def test_v24(factor, area, exact, listed):
    lost = lost_by(
        factor,
        area=area,
        emissivity=np.array([0.8, 0.5]),
        kelvin=np.array([400.0, 300.0]),
    )
    assert exact == pytest.approx(listed, rel=1e-9)
    assert_allclose(lost, [exact, -exact], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.slice
def test_v24_concentric_spheres_of_voxels():
    inner = voxelize(sphere(0.05, 3), 0.005)
    outer = voxelize(shell(0.1, 0.12), 0.006)
    surface = whole(
        surface_of(inner, emissivity=0.8),
        surface_of(outer, emissivity=0.5, body=1),
    )
    term = RadiativeExchange(300.0, max_patches=60, directions=32)
    exchange, _ = term.enclosure(surface)
    n = len(inner.fragment_area)
    outer_count = len(outer.fragment_area)
    theta, grey = (np.repeat(v, (n, outer_count)) for v in ([100.0, 0.0], [0.8, 0.5]))
    flux = np.asarray(flux_of(exchange, grey, jnp.asarray(theta)))
    lost = -flux[:n] @ inner.fragment_area
    assert lost == pytest.approx(SPHERES, rel=0.01)
    gained = flux[n:] @ outer.fragment_area
    assert gained == pytest.approx(lost, rel=1e-12)


def test_mirrors_exchange_nothing():
    mirrors = lost_by(
        FACING, area=np.ones(2), emissivity=np.zeros(2), kelvin=np.array([400.0, 300.0])
    )
    assert_array_equal(mirrors, 0.0)


@pytest.fixture(scope="module")
def scene():
    """Two blocks near each other, and their view factors."""
    block = voxelize(box((0.4, 0.2, 0.2)), 0.04)
    first = in_patches(block, 40)
    second = in_patches(block, 40, moved(0.0, 0.3, 0.05))
    views = view_factors((first, second), directions=32, lines=32)
    patch = np.concatenate(
        [first.patches.patch, second.patches.patch + first.patches.count]
    )
    return views, patch, np.tile(block.fragment_area, 2)


def made(scene, emissivity, dtype="float64", sky=0.0):
    """Exchange with surroundings at 300 K + sky, temperatures counted from 300 K."""
    views, patch, area = scene
    return _enclosure(
        views,
        patch=patch,
        area=area,
        emissivity=emissivity * jnp.ones(len(area), dtype)
        if is_traced(emissivity)
        else np.broadcast_to(np.asarray(emissivity, dtype), area.shape),
        base=jnp.asarray(300.0, dtype),
        temperature=jnp.asarray(300.0 + sky, dtype),
        above=jnp.zeros((), dtype),
    )


def given_away(exchange, grey_area, theta):
    """Net heat rate to the surroundings [W]."""
    kelvin = np.asarray(theta, float) + 300.0
    weight = np.asarray(exchange.weight, float)
    patch = np.asarray(exchange.patch)
    emitted = STEFAN_BOLTZMANN * np.bincount(patch, weight * kelvin**4)
    around = STEFAN_BOLTZMANN * float(exchange.temperature) ** 4
    reached = np.bincount(patch, grey_area) * np.asarray(exchange.from_surroundings)
    return reached @ (emitted - around)


def theta_of(scene, seed=0):
    random = np.random.default_rng(seed)
    return random.uniform(-40.0, 90.0, len(scene[2]))


@pytest.mark.parametrize(("dtype", "close"), [("float64", 1e-13), ("float32", 2e-6)])
def test_what_one_loses_another_gains(scene, dtype, close):
    random = np.random.default_rng(1)
    grey = random.uniform(0.05, 1.0, len(scene[2])).astype(dtype)
    exchange = made(scene, grey, dtype, sky=-25.0)
    theta = jnp.asarray(theta_of(scene), dtype)
    flux = flux_of(exchange, grey, theta)
    assert flux.dtype == dtype
    rates = np.asarray(flux, float) * scene[2]
    lost = given_away(exchange, scene[2] * grey, theta)
    assert rates.sum() + lost == pytest.approx(0.0, abs=close * np.abs(rates).sum())
    assert abs(lost) > 1e-3 * np.abs(rates).sum()


def test_equal_temperatures_exchange_nothing(scene):
    for kelvin in (0.0, 35.0):
        exchange = made(scene, 0.6, "float32", sky=kelvin)
        theta = jnp.full(len(scene[2]), kelvin, jnp.float32)
        flux = np.asarray(flux_of(exchange, np.float32(0.6), theta))
        scale = 0.6 * STEFAN_BOLTZMANN * ((300.0 + kelvin) ** 4 - 300.0**4)
        assert_allclose(flux, 0.0, atol=2e-6 * scale)


def test_a_convex_body_alone_emits_to_the_surroundings():
    ball = voxelize(sphere(0.1, 2), 0.02)
    surface = whole(surface_of(ball, emissivity=0.7))
    exchange, _ = RadiativeExchange(280.0).enclosure(surface)
    theta = np.random.default_rng(0).uniform(0.0, 50.0, len(ball.fragment_area))
    flux = flux_of(exchange, 0.7, jnp.asarray(theta))
    exact = 0.7 * STEFAN_BOLTZMANN * (280.0**4 - (300.0 + theta) ** 4)
    assert_allclose(flux, exact, rtol=1e-9)


def test_a_millikelvin_in_float32(scene):
    count = len(scene[2])
    theta = jnp.zeros(count, jnp.float32).at[: count // 2].set(1e-3)
    flux = np.asarray(flux_of(made(scene, 1.0, "float32"), np.float32(1), theta), float)
    wide = flux_of(made(scene, 1.0), 1.0, jnp.asarray(theta, float))
    assert_allclose(flux, np.asarray(wide), rtol=1e-5, atol=1e-9)


def test_agrees_with_the_plain_radiosity_equations(scene):
    views, patch, area = scene
    grey = np.where(np.arange(len(views.area)) % 2 == 0, 0.3, 0.9)
    exchange = made(scene, grey[patch])
    kelvin = 300.0 + 40.0 * np.sin(np.arange(len(views.area)))
    flux = flux_of(exchange, grey[patch], jnp.asarray(kelvin[patch] - 300.0))
    # J = eps sigma T^4 + (1 - eps) H,    H = F J + F_s sigma T_s^4
    emitted = grey * STEFAN_BOLTZMANN * kelvin**4
    sky = views.to_surroundings * STEFAN_BOLTZMANN * 300.0**4
    reflecting = np.eye(len(grey)) - (1 - grey)[:, None] * views.factor
    radiosity = np.linalg.solve(reflecting, emitted + (1 - grey) * sky)
    lost = views.area * (emitted - grey * (views.factor @ radiosity + sky))
    rates = np.bincount(patch, np.asarray(flux) * area)
    assert_allclose(rates, -lost, rtol=1e-9, atol=1e-12)


def test_gradients(scene):
    area = scene[2]
    start = theta_of(scene)
    way = np.random.default_rng(3).normal(size=len(area))

    def heat(theta, grey):
        flux = flux_of(made(scene, grey, sky=-20.0), grey, theta)
        return flux @ jnp.asarray(way * area)

    value_and_slopes = jax.jit(jax.value_and_grad(heat, argnums=(0, 1)))
    by_theta, by_grey = value_and_slopes(start, 0.6)[1]
    step = 1e-3 * way
    ahead, behind = (value_and_slopes(start + s * step, 0.6)[0] for s in (1, -1))
    assert float(by_theta @ step) == pytest.approx(float(ahead - behind) / 2, rel=1e-6)
    ahead, behind = (value_and_slopes(start, 0.6 + s * 1e-4)[0] for s in (1, -1))
    assert float(by_grey) == pytest.approx(float(ahead - behind) / 2e-4, rel=1e-6)
    # At zero kelvin, where T^4 has no slope.
    cold = value_and_slopes(np.full(len(area), -300.0), 0.6)[1]
    assert all(np.isfinite(np.asarray(slope)).all() for slope in cold)


def test_no_slope_is_steeper_than_own_emission(scene):
    exchange = made(scene, 0.6, sky=-20.0)
    theta = jnp.asarray(theta_of(scene))

    def flux(t):
        return flux_of(exchange, 0.6, t)

    matrix = np.asarray(jax.jit(jax.jacobian(flux))(theta))
    law = _Irradiated(jnp.asarray(0.0), jnp.asarray(300.0))
    steepest = 0.6 * float(law.max_slope(jnp.asarray(300.0 + theta.max()), 1.0))
    assert (-np.diag(matrix) <= steepest).all()
    off = matrix - np.diag(np.diag(matrix))
    assert off.min() >= -1e-12 and (np.diag(matrix) < 0).all()


def test_it_is_a_module_that_jit_takes(scene):
    exchange = made(scene, 0.6)
    theta = jnp.asarray(theta_of(scene))
    jitted = eqx.filter_jit(flux_of)(exchange, 0.6, theta)
    assert_allclose(jitted, flux_of(exchange, 0.6, theta), rtol=1e-10)


def test_emissivity_zero_leaves_nothing_singular():
    exchange = of_patches(FACING, np.ones(2), np.zeros(2))
    # Not multiplied by the emissivity: irradiation less emission itself is finite.
    net = np.asarray(flux_of(exchange, 1.0, jnp.asarray([50.0, 0.0])))
    flux = 1e-6 * net
    assert np.isfinite(flux).all() and np.abs(flux).max() < 1e-3
