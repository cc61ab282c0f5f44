"""Networks whose material varies with temperature, on every kind of linear one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.material.material import Property
from jaxthermo.network.nonlinear import NonlinearNetwork
from jaxthermo.physics.conduction import (
    assemble_uniform,
    material_network,
    materials_network,
)
from tests.bodies import blocks


PITCH = 0.01
REFERENCE = 310.0
DENSITY = 8000.0
K = Property([280.0, 320.0, 400.0], [10.0, 16.0, 13.0])
HEAT = Property([290.0, 300.0, 302.0, 304.0, 380.0], [400.0, 450.0, 4e4, 470.0, 600.0])
STEEL = jt.Material(K, DENSITY, HEAT)


@pytest.fixture(scope="module")
def grid():
    solid = np.ones((6, 5, 4), bool)
    solid[4:, 3:, 2:] = False
    return blocks(solid, PITCH)


STRUCTURES = {
    "stencil": jt.FullVolume,
    "links": lambda grid: jt.FullVolume(grid, stencil=False),
    "aggregate": lambda grid: jt.Aggregate(grid, factor=2),
}


def _start(structure, low=285.0, high=395.0):
    """Temperatures of the nodes above the reference, as a state's."""
    kelvin = np.random.default_rng(5).uniform(low, high, structure.node_count)
    theta = np.zeros(structure.state_shape)
    theta[structure.node_address()] = kelvin - REFERENCE
    return jax.device_put(theta)


def _varying(structure, material):
    network = material_network(structure, material, REFERENCE, jnp.float64)
    assert isinstance(network, NonlinearNetwork)
    return network


@eqx.filter_jit
def _run(network, state, dt, steps):
    return jax.lax.fori_loop(0, steps, lambda _, s: network.euler_step(s, dt), state)


@eqx.filter_jit
def _heat_rate(network, theta):
    return network.heat_rate(network.state_of(theta))


@eqx.filter_jit
def _evened(network, theta):
    """Temperatures after 300 stable steps, heat that has moved, and heat made."""
    state = network.state_of(theta)
    after = _run(network, state, 1 / network.max_rate(), 300)
    moved = network.stored(jnp.abs(after - state))
    drift = network.stored(after) - network.stored(state)
    return network.temperature(after), moved, drift


@pytest.mark.parametrize("structure_name", STRUCTURES)
def test_the_rate_is_that_of_the_integrals(grid, structure_name):
    """On the linear network: k_0 A / L (phi_j - phi_i), by temperatures one by one."""
    structure = STRUCTURES[structure_name](grid)
    network = material_network(structure, STEEL, REFERENCE, jnp.float64)
    theta = np.asarray(_start(structure))
    phi = np.zeros(theta.shape)
    for address in zip(*structure.node_address(), strict=True):
        ends = np.linspace(REFERENCE, REFERENCE + float(theta[address]), 4001)
        phi[address] = np.trapezoid(K(ends), ends) / K(REFERENCE)
    linear = assemble_uniform(
        structure, K(REFERENCE), DENSITY * HEAT(REFERENCE), jnp.float64
    )
    actual, exact = (
        np.asarray(_heat_rate(rates, values))
        for rates, values in ((network, theta), (linear, phi))
    )
    np.testing.assert_allclose(actual, exact, atol=2e-8 * np.abs(exact).max())
    assert abs(actual.sum()) < 1e-13 * np.abs(actual).sum()


@pytest.mark.parametrize("structure_name", STRUCTURES)
def test_heat_is_kept_to_rounding_and_temperatures_stay_within_bounds(
    grid, structure_name
):
    structure = STRUCTURES[structure_name](grid)
    network = material_network(structure, STEEL, REFERENCE, jnp.float64)
    theta = np.asarray(_start(structure))
    now, moved, drift = _evened(network, theta)
    assert moved > 0.0
    assert abs(drift) < 1e-12 * moved
    now = np.asarray(now)[structure.node_address()]
    start = theta[structure.node_address()]
    assert start.min() - 1e-9 < now.min() and now.max() < start.max() + 1e-9
    assert float(now.max() - now.min()) < 0.6 * float(start.max() - start.min())


def test_empty_cells_stay_at_zero(grid):
    structure = jt.FullVolume(grid)
    network = material_network(structure, STEEL, REFERENCE, jnp.float64)
    end = np.array(
        _run(network, network.state_of(_start(structure)), jnp.array(1e-3), 3)
    )
    end[structure.node_address()] = 0.0
    assert not end.any()


@pytest.mark.parametrize("structure_name", STRUCTURES)
def test_constant_properties_give_the_linear_network(grid, structure_name):
    structure = STRUCTURES[structure_name](grid)
    flat = jt.Material(
        Property([250, 300, 500], [16] * 3), 8e3, Property([300, 350], [500] * 2)
    )
    network = material_network(structure, flat, REFERENCE, jnp.float64)
    linear = assemble_uniform(structure, 16.0, 4e6, jnp.float64)
    assert isinstance(network, NonlinearNetwork)
    theta = _start(structure)
    dt = 1 / linear.max_rate()
    assert float(network.max_rate()) == pytest.approx(float(1 / dt), rel=1e-14)
    actual = network.temperature(_run(network, network.state_of(theta), dt, 30))
    np.testing.assert_allclose(actual, _run(linear, theta, dt, 30), atol=1e-11)


def test_numbers_give_a_linear_network_and_halves_are_dropped(grid):
    structure = jt.FullVolume(grid)
    plain = jt.Material(16.0, 8e3, 500.0)
    linear = material_network(structure, plain, REFERENCE, jnp.float64)
    assert not isinstance(linear, NonlinearNetwork)
    only_k = _varying(structure, jt.Material(K, 8e3, 500.0))
    only_heat = _varying(structure, jt.Material(16.0, 8e3, HEAT))
    assert only_k.heat is None and only_heat.conduction is None
    theta = _start(structure)
    assert only_k.temperature(theta) is theta and only_k.state_of(theta) is theta
    assert only_heat.relative_conductivity(theta) == 1.0
    assert only_k.min_relative_capacity() == 1.0


def test_what_the_surface_needs_to_know(grid):
    network = _varying(jt.FullVolume(grid), STEEL)
    kelvin = np.array([200.0, 300.0, 310.0, 350.0, 500.0])
    actual = network.relative_conductivity(jnp.asarray(kelvin - REFERENCE))
    np.testing.assert_allclose(actual, K(kelvin) / K(REFERENCE), rtol=1e-13)
    largest = network.max_relative_conductivity()
    smallest = HEAT.values.min()
    assert float(largest) == pytest.approx(16.0 / K(REFERENCE))
    assert float(network.min_relative_capacity()) == pytest.approx(
        smallest / HEAT(REFERENCE)
    )
    wide = np.linspace(250.0, 450.0, 200_001)
    fastest = (K(wide) / HEAT(wide)).max() / (K(REFERENCE) / HEAT(REFERENCE))
    diffusivity = float(network.max_relative_diffusivity())
    assert diffusivity == pytest.approx(fastest, rel=1e-6)
    linear = network.base.max_rate()
    assert float(network.max_rate()) == pytest.approx(diffusivity * float(linear))


def test_the_stable_step_is_needed():
    """At k / c_p of the table's most, two nodes: a longer step overshoots."""
    structure = jt.FullVolume(blocks(np.ones((2, 1, 1), bool), PITCH), stencil=False)
    network = material_network(structure, STEEL, REFERENCE, jnp.float64)

    # Both where k / c_p is largest, at 320 K, and almost even.
    @eqx.filter_jit
    def after(network, stable_steps):
        state = network.state_of(jnp.array([9.999, 10.001]))
        return network.euler_step(state, stable_steps / network.max_rate())

    def gap(stable_steps):
        return float(np.diff(after(network, jnp.asarray(stable_steps)))[0])

    # Of two nodes the gap falls by 1 - 2 dt rate.
    assert gap(1.0) == pytest.approx(-gap(0.0), rel=2e-4)
    assert abs(gap(1.05)) > abs(gap(0.0))


@pytest.mark.slow
@pytest.mark.slice
def test_gradients_of_a_run_are_finite_differences():
    structure = jt.FullVolume(blocks(np.ones((3, 2, 1), bool), PITCH), stencil=False)
    start = _start(structure)

    def warmth(values):
        """By conductivities at three temperatures and specific heats at two."""
        steel = jt.Material(
            Property([280.0, 320.0, 400.0], values[:3]),
            8e3,
            Property([290.0, 350.0], values[3:]),
        )
        network = _varying(structure, steel)

        def step(_, state):
            return network.euler_step(state, jnp.asarray(2.0))

        end = jax.lax.fori_loop(0, 8, step, network.state_of(start))
        return (network.temperature(end) ** 2).mean()

    at = np.array([10.0, 16.0, 13.0, 400.0, 600.0])
    slopes = jax.jit(jax.grad(warmth))(jnp.asarray(at))
    steps = np.diag(1e-4 * at)
    ends = jax.jit(jax.vmap(warmth))(jnp.asarray(np.r_[at + steps, at - steps]))
    differences = (ends[:5] - ends[5:]) / (2e-4 * at)
    np.testing.assert_allclose(slopes, differences, rtol=1e-5)
    assert (np.abs(slopes) > 1e-4).all()


def test_several_materials_of_numbers_are_linear(grid):
    structure = jt.FullVolume(grid)
    number = np.zeros(structure.node_count, np.int32)
    plain = jt.Material(16.0, 8e3, 500.0)
    materials = (plain, STEEL.at(300))
    network = materials_network(structure, number, materials, 300.0, jnp.float64)
    assert float(network.total_capacity()) == pytest.approx(
        4e6 * structure.node_count * PITCH**3
    )
