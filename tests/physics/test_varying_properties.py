"""k and c_p that depend on temperature: Kirchhoff's transform and the enthalpy."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.material.material import Property
from jaxthermo.physics.conduction import material_network
from tests.bodies import blocks


DENSITY = 1000.0
PITCH = 0.01


def _bar(cells):
    return jt.FullVolume(blocks(np.ones((cells, 1, 1), bool), PITCH), stencil=False)


def test_a_steady_slab_with_k_linear_in_temperature():
    """From k0 (T + b T^2/2) linear in x: T = (sqrt(1 + 2 b w) - 1) / b above T_1.

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 1.6.
    """
    cells = 12
    low = 300.0
    high = 500.0
    k0 = 4.0
    rise = 0.01
    metal = jt.Material(
        Property([low, high], [k0, k0 * (1 + rise * (high - low))]), DENSITY, 500.0
    )
    structure = _bar(cells)
    network = material_network(
        structure, material=metal, reference=350.0, dtype=jnp.float64
    )
    ends = jnp.array([0, cells - 1])
    held = jnp.array([low, high]) - 350.0

    @eqx.filter_jit
    def relax(theta):
        dt = 1 / network.max_rate()

        def hold(theta):
            return theta.at[ends].set(held)

        def step(_, theta):
            return hold(network.euler_step(theta, dt))

        return jax.lax.fori_loop(0, 2000, step, hold(theta))

    theta = relax(jnp.zeros(cells))
    fraction = np.arange(cells) / (cells - 1)
    gap = high - low
    total_integral = gap + rise * gap**2 / 2
    exact = low + (np.sqrt(1 + 2 * rise * fraction * total_integral) - 1) / rise
    assert_allclose(350.0 + theta, exact, rtol=1e-10)
    rate = network.heat_rate(theta)
    area = PITCH**2
    length = (cells - 1) * PITCH
    flow = k0 * (1 + rise * gap / 2) * area * gap / length
    assert float(rate[0]) == pytest.approx(flow, rel=1e-9)
    assert float(rate[-1]) == pytest.approx(-flow, rel=1e-9)
    assert np.abs(np.asarray(350.0 + theta) - (low + fraction * gap)).max() > 10.0


def test_a_lumped_body_with_c_linear_in_temperature():
    """Under a constant heat rate: T = T_0 + (sqrt(1 + 2 b q t / (rho c_0)) - 1) / b."""
    c0 = 400.0
    rise = 0.004
    start = 300.0
    q = 5e5
    metal = jt.Material(
        20.0, DENSITY, Property([start, 800.0], [c0, c0 * (1 + rise * 500)])
    )
    network = material_network(
        _bar(1), material=metal, reference=start, dtype=jnp.float64
    )
    times = np.array([0.0, 1.0, 30.0, 100.0, 300.0])
    # The state grows by heat over the capacity at the reference: exact in any steps.
    state = jnp.asarray(q * times / (DENSITY * c0))
    exact = start + (np.sqrt(1 + 2 * rise * q * times / (DENSITY * c0)) - 1) / rise
    assert exact[-1] < 800.0
    assert_allclose(start + network.temperature(state), exact, rtol=1e-14)
    capacity = float(network.capacity_at((jnp.array([0]),))[0])
    assert capacity == pytest.approx(DENSITY * c0 * PITCH**3)


REFERENCE = 290.0
LATENT = 2e5
C = 1000.0


def _freezing(width):
    """A latent heat of 200 kJ/kg as a peak of c_p, `width` wide about 300 K."""
    middle = [300 - width / 2, 300.0, 300 + width / 2]
    peak = Property(middle, [C, C + 2 * LATENT / width, C])
    return jt.Material(2.0, DENSITY, peak)


@pytest.mark.parametrize("width", [4.0, 0.5])
def test_a_peak_of_c_takes_up_its_latent_heat(width):
    """Heated at a constant rate it stays in the peak for rho L / q."""
    network = material_network(
        _bar(1), material=_freezing(width), reference=REFERENCE, dtype=jnp.float64
    )
    rate = 1e5 / (DENSITY * C)

    def time_to(kelvin):
        return float(network.state_of(jnp.asarray(kelvin - REFERENCE))) / rate

    solid = 300.0 - width / 2
    liquid = 300.0 + width / 2
    assert time_to(solid) == pytest.approx((solid - REFERENCE) / rate, rel=1e-12)
    heat = DENSITY * (LATENT + C * width)
    assert time_to(liquid) - time_to(solid) == pytest.approx(heat / 1e5, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_a_mushy_front_moves_without_losing_heat(dtype):
    """A warm half melts a cold half: heat is kept, nothing leaves the start's range."""
    structure = _bar(40)
    network = material_network(
        structure, material=_freezing(1.0), reference=REFERENCE, dtype=dtype
    )
    theta = jnp.where(jnp.arange(40) < 20, 60.0, -2.0).astype(dtype)
    state = network.state_of(theta)
    dt = 1 / network.max_rate()
    run = jax.jit(
        lambda s: jax.lax.fori_loop(0, 500, lambda _, x: network.euler_step(x, dt), s)
    )
    end_state = run(state)
    temperature = np.asarray(network.temperature(end_state), float)
    exact = dtype == jnp.float64
    assert temperature.min() > -2.0 - (1e-9 if exact else 1e-3)
    assert temperature.max() < 60.0 + (1e-9 if exact else 1e-3)
    assert (np.diff(temperature) < 1e-9 if exact else np.diff(temperature) < 1e-3).all()
    heat = np.asarray(end_state, float).sum() - np.asarray(state, float).sum()
    moved = np.abs(np.asarray(end_state, float) - np.asarray(state, float)).sum()
    drift = abs(heat) / moved
    assert drift < (1e-12 if exact else 1e-4)
    mushy = np.abs(temperature + REFERENCE - 300.0) < 0.5
    # The front is in the cold half, with part of its latent heat taken up.
    assert mushy[20:].any() and not mushy[:10].any()


@pytest.mark.slow
@pytest.mark.slice
def test_stefan_problem():
    """A front melts into a solid at its melting point: x = 2 l sqrt(a t), with

    l exp(l^2) erf(l) = St / sqrt(pi), St = c (T_wall - T_melt) / L.

    Source: Carslaw and Jaeger, Conduction of Heat in Solids, 11.2 (Neumann).
    """
    cells = 100
    wall = 340.0
    structure = _bar(cells)
    network = material_network(
        structure, material=_freezing(0.1), reference=REFERENCE, dtype=jnp.float64
    )
    stefan = C * (wall - 300.05) / (LATENT + C * 0.05)
    root = 0.1
    for _ in range(60):
        # The left side grows about as l^2, so a square root corrects it.
        value = root * math.exp(root**2) * math.erf(root) * math.sqrt(math.pi)
        root *= math.sqrt(stefan / value)
    start = network.state_of(jnp.full(cells, 299.95 - REFERENCE))
    held = network.state_of(jnp.asarray(wall - REFERENCE))
    dt = 1 / network.max_rate()

    @eqx.filter_jit
    def run(state):
        def step(_, s):
            return network.euler_step(s, dt).at[0].set(held)

        return jax.lax.fori_loop(0, 12_000, step, state.at[0].set(held))

    end_state = run(start)
    # What has molten, in cells, by the heat taken up beyond the warming.
    theta = np.asarray(network.temperature(end_state)) + REFERENCE
    enthalpy = np.asarray(end_state) - (theta - REFERENCE)
    solid = float(start[1]) - (299.95 - REFERENCE)
    molten = (enthalpy[1:] - solid).sum() / (LATENT / C)
    front = (molten + 0.5) * PITCH
    time = 12_000 * float(dt)
    exact = 2 * root * math.sqrt(2.0 / (DENSITY * C) * time)
    assert 20 < front / PITCH < 90
    assert front == pytest.approx(exact, rel=0.01)
