"""k(T) of several materials in one body, and along each axis: layers in closed form."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.material.material import Property
from jaxthermo.physics.conduction import (
    conductivity_parts,
    material_network,
    materials_network,
)
from tests.bodies import bar, blocks


LOW, HIGH, PITCH, CELLS = 300.0, 500.0, 0.01, 12
RISING = jt.Material(Property([LOW, HIGH], [4.0, 20.0]), 1000.0, 500.0)
FALLING = jt.Material(Property([LOW, HIGH], [30.0, 10.0]), 2000.0, 400.0)
LATENT = jt.Material(
    Property([LOW, HIGH], [30.0, 10.0]),
    2000.0,
    Property([340, 360, 380], [400, 2e3, 600]),
)


def integral(material, kelvin):
    """F = integral of k(T) from 300 K [W/m]."""
    first, last = material.conductivity.values
    above = kelvin - LOW
    return first * above + (last - first) / (HIGH - LOW) * above**2 / 2


def temperature(material, value):
    """T at which F has a value [K]."""
    first, last = material.conductivity.values
    slope = (last - first) / (HIGH - LOW)
    return LOW + (np.sqrt(first**2 + 2 * slope * value) - first) / slope


def bisected(function, low, high):
    """Root of an increasing function."""
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return (low + high) / 2


def wall(x, length):
    """Two layers, both of a length, between 300 and 500 K: T at x, and the flux."""
    fluxes = lambda face: (
        (integral(RISING, face) - 0.0) / length,
        (integral(FALLING, HIGH) - integral(FALLING, face)) / length,
    )
    face = bisected(lambda t: fluxes(t)[0] - fluxes(t)[1], LOW, HIGH)
    flux = fluxes(face)[0]
    here = np.minimum(flux * x, integral(RISING, face))
    there = integral(FALLING, face) + flux * np.maximum(x - length, 0)
    left, right = temperature(RISING, here), temperature(FALLING, there)
    return np.where(x < length, left, right), flux


def layered(structure, materials=(RISING, FALLING), reference=350.0):
    number = (
        structure.nodes().centre[:, 0] > structure.nodes().centre[:, 0].mean()
    ) * 1
    number = number.astype(np.int32)
    return materials_network(structure, number, materials, reference, jnp.float64)


@pytest.fixture(scope="module")
def structure():
    solid = np.ones((CELLS, 1, 1), bool)
    return jt.FullVolume(blocks(solid, PITCH), stencil=False)


def relaxed(network, ends, held, steps):
    @eqx.filter_jit
    def run(theta):
        dt = 1 / network.max_rate()
        hold = lambda theta: theta.at[ends].set(held)
        step = lambda _, theta: hold(network.euler_step(theta, dt))
        return jax.lax.fori_loop(0, steps, step, hold(theta))

    return run(jnp.zeros(CELLS) + held.mean())


def test_two_layers_with_k_of_t_are_exact_at_every_node(structure):
    """F_a linear on the left, F_b on the right, one flux: steady to rounding."""
    network = layered(structure)
    ends, held = jnp.array([0, CELLS - 1]), jnp.array([LOW, HIGH]) - 350.0
    theta = np.asarray(relaxed(network, ends, held, 6000))
    length = (CELLS - 1) / 2 * PITCH
    exact, flux = wall(np.arange(CELLS) * PITCH, length)
    np.testing.assert_allclose(350.0 + theta, exact, rtol=1e-9)
    rate = np.asarray(network.heat_rate(jnp.asarray(theta)))
    assert rate[0] == pytest.approx(flux * PITCH**2, rel=1e-7)
    assert rate[-1] == pytest.approx(-flux * PITCH**2, rel=1e-7)
    # Conductivities at the reference would miss it by far.
    linear = np.asarray(relaxed(network.base, ends, held, 6000))
    assert np.abs(350.0 + linear - exact).max() > 5.0


def test_what_one_node_loses_the_others_gain(structure):
    """With c(T) in one layer: stored heat stays, and all end at one temperature."""
    network = layered(structure, (RISING, LATENT))
    theta = jnp.asarray(np.linspace(-60.0, 140.0, CELLS))
    start = network.state_of(theta)
    np.testing.assert_allclose(network.temperature(start), theta, rtol=1e-12)

    @eqx.filter_jit
    def run(state):
        dt = 1 / network.max_rate()
        step = lambda _, state: network.euler_step(state, dt)
        return jax.lax.fori_loop(0, 15_000, step, state)

    end = run(start)
    stored = float(network.stored(start))
    assert float(network.stored(end)) == pytest.approx(stored, rel=1e-11)
    found = np.asarray(network.temperature(end))
    # Heat above 350 K of both halves at the common temperature [J].
    kelvin = np.linspace(340.0, 440.0, 400_001)
    c = np.interp(kelvin, [340, 360, 380], [400, 2e3, 600])
    heat = np.concatenate([[0], np.cumsum((c[1:] + c[:-1]) / 2 * np.diff(kelvin))])
    volume = CELLS / 2 * PITCH**3
    total = 2000.0 * (heat - np.interp(350.0, kelvin, heat)) + 5e5 * (kelvin - 350.0)
    common = np.interp(stored / volume, total, kelvin) - 350.0
    np.testing.assert_allclose(found, common, atol=1e-3)


def test_one_stable_step_keeps_all_temperatures_between_the_extremes(structure):
    network = layered(structure)
    rng = np.random.default_rng(1)
    states = jnp.asarray(rng.uniform(-100.0, 200.0, (200, CELLS)))
    dt = 1 / network.max_rate()
    after = jax.jit(jax.vmap(lambda state: network.euler_step(state, dt)))(states)
    low, high = states.min(axis=1, keepdims=True), states.max(axis=1, keepdims=True)
    assert ((after >= low - 1e-9) & (after <= high + 1e-9)).all()
    # The bound is no excuse: a step of three times that leaves them.
    beyond = jax.vmap(lambda state: network.euler_step(state, 3 * dt))(states)
    assert (beyond > high + 1.0).any() or (beyond < low - 1.0).any()


def test_the_stencil_has_the_same_rates_as_the_links(structure):
    lattice = jt.FullVolume(structure.grid)
    dense, links = layered(lattice), layered(structure)
    theta = np.linspace(-50.0, 150.0, CELLS) ** 2 / 150.0
    state = np.zeros(lattice.state_shape)
    state[lattice.node_address()] = theta
    rates = np.asarray(dense.heat_rate(jnp.asarray(state)))
    own = links.heat_rate(jnp.asarray(theta))
    np.testing.assert_allclose(rates[lattice.node_address()], own, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.slice
def test_derivatives_by_all_conductivities(structure):
    theta = jnp.asarray(np.linspace(-50.0, 150.0, CELLS))

    def warmth(values):
        one = jt.Material(Property([LOW, HIGH], values[:2]), 1000.0, 500.0)
        other = jt.Material(Property([LOW, HIGH], values[2:]), 2000.0, 400.0)
        network = layered(structure, (one, other))
        step = lambda _, state: network.euler_step(state, jnp.asarray(0.2))
        return (jax.lax.fori_loop(0, 20, step, theta) ** 2).mean()

    at = np.array([4.0, 20.0, 30.0, 10.0])
    slopes = jax.jit(jax.grad(warmth))(jnp.asarray(at))
    steps = np.diag(1e-4 * at)
    ends = jax.jit(jax.vmap(warmth))(jnp.asarray(np.r_[at + steps, at - steps]))
    np.testing.assert_allclose(slopes, (ends[:4] - ends[4:]) / (2e-4 * at), rtol=1e-5)


@pytest.mark.parametrize("axis", range(3))
def test_along_every_axis_its_own_law_holds(axis):
    """q = A / L (F_i(T_2) - F_i(T_1)) between two voxels along the axis i."""
    k = (RISING.conductivity, 7.0, FALLING.conductivity)
    wood = jt.Material(k, 500.0, 1600.0)
    shape = [1, 1, 1]
    shape[axis] = 2
    structure = jt.FullVolume(blocks(np.ones(shape, bool), 0.1))
    network = material_network(structure, wood, 350.0, jnp.float64)
    state = np.zeros(structure.state_shape)
    state[structure.node_address()] = [310.0 - 350.0, 480.0 - 350.0]
    rate = float(jnp.max(network.heat_rate(jnp.asarray(state))))
    laws = (
        integral(RISING, 480.0) - integral(RISING, 310.0),
        7.0 * (480.0 - 310.0),
        integral(FALLING, 480.0) - integral(FALLING, 310.0),
    )
    assert rate == pytest.approx(0.1 * laws[axis], rel=1e-12)


def test_a_slanted_surface_has_the_conductivity_of_its_normal():
    """k(T) / k(300 K) of n . K n, for two materials of which one differs by axis."""
    wood = jt.Material((RISING.conductivity, 7.0, 2.0), 500.0, 1600.0)
    normal = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]])
    number = np.array([0, 0, 1], np.int32)
    given = (wood, FALLING)
    parts = conductivity_parts(given, number, normal, LOW, jnp.float64)
    assert parts is not None
    np.testing.assert_allclose(np.asarray(parts).sum(axis=0), 1.0, rtol=1e-12)
    structure = jt.FullVolume(blocks(np.ones((3, 1, 1), bool), 0.1), stencil=False)
    network = materials_network(structure, number, given, LOW, jnp.float64)
    theta = jnp.asarray([50.0, 80.0, 100.0])
    first = (0.36 * (4.0 + 0.08 * 50.0) + 0.64 * 2.0) / (0.36 * 4.0 + 0.64 * 2.0)
    expected = [first, 1.0, 20.0 / 30.0]
    found = network.relative_conductivity(theta, parts)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert conductivity_parts((RISING,), number * 0, normal, LOW, jnp.float64) is None
    plain = (jt.Material(1.0, 1.0, 1.0), jt.Material(2.0, 1.0, 1.0))
    assert conductivity_parts(plain, number, normal, LOW, jnp.float64) is None


RIGHT = jt.Region(lower=(0.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))


def scene_of(structure, temperature=400.0):
    material = jt.MaterialMap(RISING, ((RIGHT, FALLING),))
    body = jt.Body(structure, material, temperature=temperature)
    terms = (
        jt.FixedTemperature(LOW, on=jt.Side((-1.0, 0.0, 0.0))),
        jt.FixedTemperature(HIGH, on=jt.Side((1.0, 0.0, 0.0))),
    )
    probes = [(x, 0.0, 0.0) for x in (-0.03, 0.0175, 0.0425)]
    return jt.Scene((body,), terms, dtype="float64", probes=probes)


def test_implicit_solvers_say_that_conduction_is_not_symmetric():
    scene = scene_of(jt.FullVolume(bar(4, PITCH)))
    for run in (
        lambda: jt.steady(scene),
        lambda: jt.simulate(scene, 1.0, solver=jt.BackwardEuler(0.5)),
    ):
        with pytest.raises(InputError) as caught:
            run()
        assert "body 0 has several materials or axes" in str(caught.value)
        assert "SuperTimeStepping(), or give it numbers" in str(caught.value)


@pytest.mark.slow
@pytest.mark.slice
def test_a_wall_simulated_to_its_steady_state():
    """Through half cells with the conductivity of their nodes: of second order."""
    exact, _ = wall(np.array([0.03, 0.0775, 0.1025]), CELLS / 2 * PITCH)
    worst = []
    for parts in (1, 2):
        grid = bar(CELLS * parts, PITCH / parts)
        solution = jt.simulate(scene_of(jt.FullVolume(grid)), 4000.0)
        assert solution.run.solver == "SuperTimeStepping"
        assert abs(float(solution.energy.residual_relative[-1])) < 1e-11
        worst.append(np.abs(np.asarray(jt.probe(solution))[0] - exact).max())
    assert worst[1] < 0.35 * worst[0] < 1.0
