"""k(T) of several materials in one body, and along each axis: layers in closed form."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.material.material import Property
from jaxthermo.physics.conduction import (
    conductivity_parts,
    material_network,
    materials_network,
)
from tests.bodies import bar, blocks, single_body_scene
from tests.slopes import check_gradient


LOW = 300.0
HIGH = 500.0
PITCH = 0.01
CELLS = 12
RISES, FALLS = (Property([LOW, HIGH], k) for k in ([4.0, 20.0], [30.0, 10.0]))
RISING = jt.Material(RISES, 1000.0, 500.0)
FALLING = jt.Material(FALLS, 2000.0, 400.0)
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

    def fluxes(face):
        return (
            (integral(RISING, face) - 0.0) / length,
            (integral(FALLING, HIGH) - integral(FALLING, face)) / length,
        )

    face = bisected(lambda t: fluxes(t)[0] - fluxes(t)[1], LOW, HIGH)
    flux = fluxes(face)[0]
    rising_integral = np.minimum(flux * x, integral(RISING, face))
    falling_integral = integral(FALLING, face) + flux * np.maximum(x - length, 0)
    left = temperature(RISING, rising_integral)
    right = temperature(FALLING, falling_integral)
    return np.where(x < length, left, right), flux


def layered(structure, materials=(RISING, FALLING), reference=350.0):
    number = (
        structure.nodes().centre[:, 0] > structure.nodes().centre[:, 0].mean()
    ) * 1
    number = number.astype(np.int32)
    return materials_network(
        structure,
        number=number,
        materials=materials,
        reference=reference,
        dtype=jnp.float64,
    )


@pytest.fixture(scope="module")
def structure():
    solid = np.ones((CELLS, 1, 1), bool)
    return jt.FullVolume(blocks(solid, PITCH), stencil=False)


@pytest.fixture(scope="module")
def network(structure):
    return layered(structure)


# One program for all networks of one make.
rates = eqx.filter_jit(lambda network, states: jax.vmap(network.heat_rate)(states))
heat_rate = eqx.filter_jit(lambda network, state: network.heat_rate(state))
ROWS = 200


def rates_of(network, states):
    """Heat rates [W] of states, one a row, repeated up to as many as others have."""
    return np.asarray(rates(network, np.resize(states, (ROWS, CELLS))))[: len(states)]


def states_of(rng):
    return rng.uniform(-100.0, 200.0, (ROWS, CELLS))


def test_two_layers_with_k_of_t_are_exact_at_every_node(network):
    """F_a linear on the left, F_b on the right, one flux: no rate but at the ends."""
    exact, flux = wall(np.arange(CELLS) * PITCH, (CELLS - 1) / 2 * PITCH)
    states = np.stack([exact, exact + np.sin(np.arange(CELLS))]) - 350.0
    exact_rate, disturbed_rate = rates_of(network, states)
    scale = flux * PITCH**2
    assert_allclose(exact_rate[[0, -1]], [scale, -scale], rtol=1e-9)
    assert_allclose(exact_rate[1:-1], 0, atol=1e-9 * scale)
    assert np.abs(disturbed_rate[1:-1]).max() > 0.01 * scale
    # Conductivities at the reference would miss it by far.
    linear = np.asarray(heat_rate(network.linear, states[0]))
    assert np.abs(linear[1:-1]).max() > 0.1 * scale


def test_what_one_node_loses_the_others_gain(structure):
    """With c(T) in one layer: rates add up to 0, and end at one temperature."""
    network = layered(structure, (RISING, LATENT))
    theta = states_of(np.random.default_rng(0))
    states_at = jax.jit(jax.vmap(network.state_of))
    states = np.asarray(states_at(theta))
    back = np.asarray(jax.jit(jax.vmap(network.temperature))(states))
    assert_allclose(back, theta, rtol=1e-12, atol=1e-10)
    rates = rates_of(network, states)
    lost = np.abs(rates).sum(axis=1)
    assert_allclose(rates.sum(axis=1) / lost, 0, atol=1e-14)
    uniform = np.asarray(states_at(np.full((ROWS, CELLS), 31.0)))[0]
    assert np.abs(rates_of(network, np.tile(uniform, (ROWS, 1)))).max() < 1e-12
    # The state of the layer with c(T) is its heat over the capacity at 350 K.
    kelvin = np.linspace(350.0, 381.0, 100_001)
    c = np.interp(kelvin, [340, 360, 380], [400, 2e3, 600])
    heat = ((c[1:] + c[:-1]) / 2 * np.diff(kelvin)).sum() / 1200.0
    assert_allclose(uniform, [31.0] * 6 + [heat] * 6, rtol=1e-8)


def test_one_stable_step_keeps_all_temperatures_between_the_extremes(network):
    states = states_of(np.random.default_rng(1))
    max_rate, capacity = eqx.filter_jit(lambda n: (n.max_rate(), n.capacity()))(network)
    dt = 1 / float(max_rate)
    per_step = dt * rates_of(network, states) / np.asarray(capacity)
    low = states.min(axis=1, keepdims=True)
    high = states.max(axis=1, keepdims=True)
    stepped = states + per_step
    assert ((stepped >= low - 1e-9) & (stepped <= high + 1e-9)).all()
    # The bound is no excuse: a step of three times that leaves them.
    beyond = states + 3 * per_step
    assert (beyond > high + 1.0).any() or (beyond < low - 1.0).any()


@pytest.mark.slow
@pytest.mark.parametrize("by_axis", [False, True])
def test_the_jacobian_is_the_derivative_of_the_rates(structure, by_axis):
    """A u d = -d(rates)/d(state) for all nodes, with c(T), materials and axes."""
    materials = (RISING, LATENT)
    if by_axis:
        tilted = (RISES, 7.0, FALLS)
        materials = (jt.Material(tilted, 1e3, 500.0), LATENT)
        structure = jt.FullVolume(blocks(np.ones((3, 2, 2), bool), PITCH))
    network = layered(structure, materials)
    state = np.zeros(structure.state_shape)
    theta = states_of(np.random.default_rng(2))[0]
    state[structure.node_address()] = theta
    state = network.state_of(jnp.asarray(state))

    @jax.jit
    def both(state):
        jacobian, slope = network.linearized(state)
        assert slope is not None

        def flat(operator):
            return jax.vmap(operator)(jnp.eye(state.size).reshape(-1, *state.shape))

        by_hand = flat(lambda change: jacobian.heat_rate(slope * change))
        exact = jax.jacfwd(network.heat_rate)(state)
        return by_hand, exact, jacobian.diagonal() * slope

    by_hand, exact, diagonal = map(np.asarray, both(state))
    by_hand = by_hand.reshape(state.size, -1).T
    exact = exact.reshape(state.size, -1)
    assert_allclose(by_hand, exact, atol=1e-9 * np.abs(exact).max())
    assert_allclose(diagonal.reshape(-1), -np.diag(exact), rtol=1e-9)
    assert np.abs(exact - exact.T).max() > 0.1 * np.abs(exact).max()


def test_the_stencil_has_the_same_rates_as_the_links(structure, network):
    lattice = jt.FullVolume(structure.grid)
    dense = layered(lattice)
    theta = np.linspace(-50.0, 150.0, CELLS) ** 2 / 150.0
    state = np.zeros(lattice.state_shape)
    state[lattice.node_address()] = theta
    dense_rate = np.asarray(heat_rate(dense, state))
    row_rate = rates_of(network, theta[None])[0]
    assert_allclose(dense_rate[lattice.node_address()], row_rate, rtol=1e-12)


@pytest.mark.slow
def test_derivatives_by_all_conductivities(structure):
    theta = jnp.asarray(np.linspace(-50.0, 150.0, CELLS))

    def warmth(values):
        first = jt.Material(Property([LOW, HIGH], values[:2]), 1000.0, 500.0)
        second = jt.Material(Property([LOW, HIGH], values[2:]), 2000.0, 400.0)
        network = layered(structure, (first, second))

        def step(_, state):
            return network.euler_step(state, jnp.asarray(0.2))

        return (jax.lax.fori_loop(0, 20, step, theta) ** 2).mean()

    at = np.array([4.0, 20.0, 30.0, 10.0])
    check_gradient(warmth, at, step=1e-4 * at, rtol=1e-5)


@pytest.mark.parametrize("axis", range(3))
def test_along_every_axis_its_own_law_holds(axis):
    """q = A / L (F_i(T_2) - F_i(T_1)) between two voxels along the axis i."""
    k = (RISES, 7.0, FALLS)
    wood = jt.Material(k, 500.0, 1600.0)
    shape = [1, 1, 1]
    shape[axis] = 2
    structure = jt.FullVolume(blocks(np.ones(shape, bool), 0.1))
    network = material_network(
        structure, material=wood, reference=350.0, dtype=jnp.float64
    )
    state = np.zeros(structure.state_shape)
    state[structure.node_address()] = [310.0 - 350.0, 480.0 - 350.0]
    rate = float(np.max(heat_rate(network, state)))
    laws = (
        integral(RISING, 480.0) - integral(RISING, 310.0),
        7.0 * (480.0 - 310.0),
        integral(FALLING, 480.0) - integral(FALLING, 310.0),
    )
    assert rate == pytest.approx(0.1 * laws[axis], rel=1e-12)


def test_a_slanted_surface_has_the_conductivity_of_its_normal():
    """k(T) / k(300 K) of n . K n, for two materials of which one differs by axis."""
    wood = jt.Material((RISES, 7.0, 2.0), 500.0, 1600.0)
    normal = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]])
    number = np.array([0, 0, 1], np.int32)
    materials = (wood, FALLING)
    fractions = conductivity_parts(
        materials, number=number, normal=normal, reference=LOW, dtype=jnp.float64
    )
    assert fractions is not None
    assert_allclose(np.asarray(fractions).sum(axis=0), 1.0, rtol=1e-12)
    structure = jt.FullVolume(blocks(np.ones((3, 1, 1), bool), 0.1), stencil=False)
    network = materials_network(
        structure, number=number, materials=materials, reference=LOW, dtype=jnp.float64
    )
    theta = jnp.asarray([50.0, 80.0, 100.0])
    first = (0.36 * (4.0 + 0.08 * 50.0) + 0.64 * 2.0) / (0.36 * 4.0 + 0.64 * 2.0)
    expected = [first, 1.0, 20.0 / 30.0]
    relative = eqx.filter_jit(network.relative_conductivity)(theta, fractions)
    assert_allclose(relative, expected, rtol=1e-12)
    assert (
        conductivity_parts(
            (RISING,),
            number=number * 0,
            normal=normal,
            reference=LOW,
            dtype=jnp.float64,
        )
        is None
    )
    plain = (jt.Material(1.0, 1.0, 1.0), jt.Material(2.0, 1.0, 1.0))
    assert (
        conductivity_parts(
            plain, number=number, normal=normal, reference=LOW, dtype=jnp.float64
        )
        is None
    )


RIGHT = jt.Region(lower=(0.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))


def scene_of(structure, temperature=400.0):
    material = jt.MaterialMap(RISING, ((RIGHT, FALLING),))
    probes = [(x, 0.0, 0.0) for x in (-0.03, 0.0175, 0.0425)]
    return single_body_scene(
        structure,
        material,
        temperature,
        jt.FixedTemperature(LOW, on=jt.Side((-1.0, 0.0, 0.0))),
        jt.FixedTemperature(HIGH, on=jt.Side((1.0, 0.0, 0.0))),
        probes=probes,
    )


@pytest.mark.slow
def test_steady_and_implicit_steps_agree_with_explicit_ones():
    """One wall by `steady`, TR-BDF2, backward Euler and RKL2; energy to rounding."""
    scene = scene_of(jt.FullVolume(bar(CELLS, PITCH)))
    steady = jt.steady(scene)
    assert steady.run.statistics is not None
    assert steady.run.statistics.newton_iterations <= 12
    entering = [np.asarray(q).sum() for q in steady.heat_rates.mechanisms.values()]
    assert abs(sum(entering)) < 1e-9
    ends = {}
    for name, solver in {
        "TR-BDF2": jt.TRBDF2(),
        "backward Euler": jt.BackwardEuler(100.0),
        "RKL2": jt.SuperTimeStepping(),
    }.items():
        solution = jt.simulate(scene, 4000.0, [100.0, 4000.0], solver=solver)
        assert abs(float(solution.energy.residual_relative[-1])) < 1e-11
        ends[name] = np.asarray(jt.probe(solution))
    exact = ends["RKL2"]
    assert_allclose(ends["TR-BDF2"][0], exact[0], atol=0.3)
    for name, flux in ends.items():
        assert_allclose(flux[1], jt.probe(steady)[0], atol=2e-3, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["steady", "implicit"])
def test_gradients_of_solves_that_are_not_symmetric(name):
    """d T(probe) / d k in reverse mode against finite differences."""
    structure = jt.FullVolume(bar(4, PITCH))

    def core(values):
        first = jt.Material(Property([LOW, HIGH], values[:2]), 1000.0, 500.0)
        second = jt.Material(
            (Property([LOW, HIGH], values[2:]), 9.0, 9.0), 2000.0, 400.0
        )
        materials = jt.MaterialMap(first, ((RIGHT, second),))
        probes = [(-0.004, 0.0, 0.0), (0.012, 0.0, 0.0)]
        scene = single_body_scene(
            structure,
            materials,
            400.0,
            jt.FixedTemperature(LOW, on=jt.Side((-1.0, 0.0, 0.0))),
            jt.Convection(300.0, HIGH, on=jt.Side((1.0, 0.0, 0.0))),
            probes=probes,
        )
        if name == "steady":
            return jt.probe(jt.steady(scene, tolerance=1e-11))[0].sum()
        solver = jt.TRBDF2(dt=20.0, tolerance=1e-11)
        return jt.probe(jt.simulate(scene, 60.0, [60.0], solver=solver))[0].sum()

    at = np.array([4.0, 20.0, 30.0, 10.0])
    value_and_slopes = check_gradient(core, at, step=1e-4 * at, rtol=1e-5, atol=1e-9)
    assert np.abs(value_and_slopes(at)[1]).min() > 1e-3


@pytest.mark.slow
def test_a_wall_simulated_to_its_steady_state():
    """Through half cells with the conductivity of their nodes: of second order."""
    exact, _ = wall(np.array([0.03, 0.0775, 0.1025]), CELLS / 2 * PITCH)
    worst = []
    for refinement in (1, 2):
        grid = bar(CELLS * refinement, PITCH / refinement)
        solution = jt.simulate(scene_of(jt.FullVolume(grid)), 4000.0)
        assert abs(float(solution.energy.residual_relative[-1])) < 1e-11
        worst.append(np.abs(np.asarray(jt.probe(solution))[0] - exact).max())
    assert worst[1] < 0.35 * worst[0] < 1.0
