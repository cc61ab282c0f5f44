"""Radiation between bodies: V24, conservation, gradients, stiffness."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.radiation.radiosity import (
    exchange_of,
    net_exchange,
    patch_exchange,
)
from jaxthermo.physics.radiation.view_factors import ViewFactors, view_factors
from jaxthermo.reference.radiation import between_plates, between_spheres
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import in_patches, moved, shell, surface_of


def test_v24_endless_plates():
    factor, area = np.array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2)
    kelvin, grey = np.array([400.0, 300.0]), np.array([0.8, 0.5])
    found = net_exchange(factor, area, grey, kelvin)
    exact = between_plates(400.0, 300.0, 0.8, 0.5)
    assert exact == pytest.approx(441.0291215, rel=1e-9)
    np.testing.assert_allclose(found, [exact, -exact], rtol=1e-12)


def test_v24_concentric_spheres():
    share = (0.05 / 0.1) ** 2
    factor = np.array([[0.0, 1.0], [share, 1 - share]])
    area = 4 * np.pi * np.array([0.05, 0.1]) ** 2
    kelvin, grey = np.array([400.0, 300.0]), np.array([0.8, 0.5])
    found = net_exchange(factor, area, grey, kelvin)
    exact = between_spheres(0.05, 0.1, 400.0, 300.0, 0.8, 0.5)
    assert exact == pytest.approx(20.78300772, rel=1e-9)
    np.testing.assert_allclose(found, [exact, -exact], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.slice
def test_v24_concentric_spheres_of_voxels():
    inner, outer = voxelize(sphere(0.05, 3), 0.005), voxelize(shell(0.1, 0.12), 0.006)
    surfaces = (
        surface_of(inner, emissivity=0.8),
        surface_of(outer, emissivity=0.5, body=1),
    )
    exchange = patch_exchange(surfaces, max_patches=60, directions=32, lines=64)
    theta = np.repeat([100.0, 0.0], exchange.fragments)
    zero, base = jnp.asarray(0.0), jnp.asarray(300.0)
    flux = np.asarray(exchange.heat_flux(jnp.asarray(theta), zero, base))
    n = exchange.fragments[0]
    lost = -flux[:n] @ inner.fragment_area
    exact = between_spheres(0.05, 0.1, 400.0, 300.0, 0.8, 0.5)
    print("V24 spheres of voxels, error", lost / exact - 1)
    assert lost == pytest.approx(exact, rel=0.01)
    gained = flux[n:] @ outer.fragment_area
    assert gained == pytest.approx(lost, rel=1e-12)


def test_mirrors_and_wrong_enclosures():
    factor, area = np.array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2)
    kelvin = np.array([400.0, 300.0])
    mirrors = net_exchange(factor, area, np.zeros(2), kelvin)
    np.testing.assert_array_equal(mirrors, 0.0)
    with pytest.raises(InputError, match="surroundings"):
        net_exchange(factor * 0.9, area, np.ones(2), kelvin)
    with pytest.raises(InputError, match="0 to 1"):
        net_exchange(factor, area, np.array([0.5, 1.5]), kelvin)


@pytest.fixture(scope="module")
def scene():
    """Two blocks near each other, and their view factors."""
    block = voxelize(box((0.4, 0.2, 0.2)), 0.04)
    first, second = in_patches(block, 40), in_patches(block, 40, moved(0.0, 0.3, 0.05))
    views = view_factors((first, second), directions=32, lines=32)
    patch = np.concatenate(
        [first.patches.patch, second.patches.patch + first.patches.count]
    )
    return views, patch, np.tile(block.fragment_area, 2)


def made(scene, emissivity, dtype="float64"):
    views, patch, area = scene
    grey = np.broadcast_to(np.asarray(emissivity, dtype), area.shape)
    return exchange_of(views, patch, area, grey, (len(area) // 2,) * 2)


def theta_of(scene, seed=0):
    random = np.random.default_rng(seed)
    return random.uniform(-40.0, 90.0, len(scene[2]))


@pytest.mark.parametrize(("dtype", "close"), [("float64", 1e-13), ("float32", 2e-6)])
def test_what_one_loses_another_gains(scene, dtype, close):
    random = np.random.default_rng(1)
    exchange = made(scene, random.uniform(0.05, 1.0, len(scene[2])), dtype)
    theta = jnp.asarray(theta_of(scene), dtype)
    sky, base = jnp.asarray(-25.0, dtype), jnp.asarray(300.0, dtype)
    flux = exchange.heat_flux(theta, sky, base)
    assert flux.dtype == dtype
    rates = np.asarray(flux, float) * scene[2]
    lost = float(exchange.to_surroundings(theta, sky, base))
    assert rates.sum() + lost == pytest.approx(0.0, abs=close * np.abs(rates).sum())
    assert abs(lost) > 1e-3 * np.abs(rates).sum()


def test_equal_temperatures_exchange_nothing(scene):
    exchange = made(scene, 0.6, "float32")
    for kelvin in (0.0, 35.0):
        theta = jnp.full(len(scene[2]), kelvin, jnp.float32)
        sky, base = jnp.asarray(kelvin, jnp.float32), jnp.asarray(300.0, jnp.float32)
        flux = np.asarray(exchange.heat_flux(theta, sky, base))
        scale = 0.6 * STEFAN_BOLTZMANN * ((300.0 + kelvin) ** 4 - 300.0**4)
        np.testing.assert_allclose(flux, 0.0, atol=2e-6 * scale)


def test_a_convex_body_alone_emits_to_the_surroundings():
    ball = voxelize(sphere(0.1, 2), 0.02)
    exchange = patch_exchange(
        (surface_of(ball, emissivity=0.7),), directions=16, lines=32
    )
    theta = np.random.default_rng(0).uniform(0.0, 50.0, len(ball.fragment_area))
    sky, base = jnp.asarray(-20.0), jnp.asarray(300.0)
    flux = exchange.heat_flux(jnp.asarray(theta), sky, base)
    exact = 0.7 * STEFAN_BOLTZMANN * (280.0**4 - (300.0 + theta) ** 4)
    np.testing.assert_allclose(flux, exact, rtol=1e-9)


def test_a_millikelvin_in_float32(scene):
    exchange = made(scene, 1.0, "float32")
    theta = jnp.zeros(len(scene[2]), jnp.float32).at[: exchange.fragments[0]].set(1e-3)
    zero, base = jnp.asarray(0.0, jnp.float32), jnp.asarray(300.0, jnp.float32)
    flux = np.asarray(exchange.heat_flux(theta, zero, base), float)
    wide = made(scene, 1.0).heat_flux(
        jnp.asarray(theta, float), jnp.asarray(0.0), jnp.asarray(300.0)
    )
    np.testing.assert_allclose(flux, np.asarray(wide), rtol=1e-5, atol=1e-9)


def test_agrees_with_the_plain_radiosity_equations(scene):
    views, patch, area = scene
    grey = np.where(np.arange(len(views.area)) % 2 == 0, 0.3, 0.9)
    exchange = made(scene, grey[patch])
    kelvin = 300.0 + 40.0 * np.sin(np.arange(len(views.area)))
    flux = exchange.heat_flux(
        jnp.asarray(kelvin[patch] - 300.0), jnp.asarray(0.0), jnp.asarray(300.0)
    )
    count = len(views.area)
    factor = np.zeros((count + 1, count + 1))
    factor[:count, :count], factor[:count, count] = views.factor, views.to_surroundings
    factor[count, count] = 1.0
    lost = net_exchange(
        factor,
        np.append(views.area, 1.0),
        np.append(grey, 1.0),
        np.append(kelvin, 300.0),
    )
    rates = np.bincount(patch, np.asarray(flux) * area)
    np.testing.assert_allclose(rates, -lost[:count], rtol=1e-9, atol=1e-12)


def test_gradients(scene):
    views, patch, area = scene
    start = theta_of(scene)
    way = np.random.default_rng(3).normal(size=len(area))

    @jax.jit
    def heat(theta, grey):
        exchange = exchange_of(
            views, patch, area, grey * jnp.ones(len(area)), (len(area) // 2,) * 2
        )
        flux = exchange.heat_flux(theta, jnp.asarray(-20.0), jnp.asarray(300.0))
        return flux @ jnp.asarray(way * area)

    slope = jax.jit(jax.grad(heat, argnums=(0, 1)))
    by_theta, by_grey = slope(jnp.asarray(start), jnp.asarray(0.6))
    step = 1e-3 * way
    ahead, behind = (heat(jnp.asarray(start + s * step), 0.6) for s in (1, -1))
    assert float(by_theta @ step) == pytest.approx(float(ahead - behind) / 2, rel=1e-6)
    ahead, behind = (heat(jnp.asarray(start), 0.6 + s * 1e-4) for s in (1, -1))
    assert float(by_grey) == pytest.approx(float(ahead - behind) / 2e-4, rel=1e-6)
    # At zero kelvin, where T^4 has no slope.
    cold = slope(jnp.full(len(area), -300.0), jnp.asarray(0.6))
    assert all(np.isfinite(np.asarray(part)).all() for part in cold)


def test_no_slope_is_steeper_than_own_emission(scene):
    exchange = made(scene, 0.6)
    theta = jnp.asarray(theta_of(scene))
    flux = lambda t: exchange.heat_flux(t, jnp.asarray(-20.0), jnp.asarray(300.0))
    matrix = np.asarray(jax.jit(jax.jacobian(flux))(theta))
    steepest = np.asarray(exchange.max_slope(jnp.asarray(300.0 + theta.max())))
    assert (-np.diag(matrix) <= steepest).all()
    off = matrix - np.diag(np.diag(matrix))
    assert off.min() >= -1e-12 and (np.diag(matrix) < 0).all()


def test_it_is_a_module_that_jit_takes(scene):
    exchange = made(scene, 0.6)
    arguments = jnp.asarray(theta_of(scene)), jnp.asarray(0.0), jnp.asarray(300.0)
    jitted = eqx.filter_jit(lambda e, *given: e.heat_flux(*given))(exchange, *arguments)
    np.testing.assert_allclose(jitted, exchange.heat_flux(*arguments), rtol=1e-10)


def test_emissivity_zero_leaves_nothing_singular():
    closed = ViewFactors(np.ones(2), np.array([[0.0, 1.0], [1.0, 0.0]]), np.zeros(2))
    exchange = exchange_of(closed, np.arange(2), np.ones(2), np.zeros(2), (1, 1))
    theta, sky, base = jnp.asarray([50.0, 0.0]), jnp.asarray(0.0), jnp.asarray(300.0)
    flux = np.asarray(exchange.heat_flux(theta, sky, base))
    assert np.isfinite(flux).all() and np.abs(flux).max() < 1e-3
