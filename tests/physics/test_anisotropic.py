"""Conductivity that differs by axis: each axis its own law, however a body lies."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.material.material import Material
from jaxthermo.physics.conduction import (
    assemble_uniform,
    conductivity_table,
    materials_network,
    normal_conductivity,
    surface_conductivity,
)
from jaxthermo.reference.slab import decay_explicit_euler, sine_rate, sine_rate_of_cells
from tests.bodies import blocks, single_body_scene


K = (16.0, 4.0, 1.0)
HEAT = 2e6


@eqx.filter_jit
def _heat_rate(network, state):
    return network.heat_rate(state)


def _state(structure, values):
    state = np.zeros(structure.state_shape)
    state[structure.node_address()] = values
    return jax.device_put(state)


def _network(structure, conductivity=K):
    return assemble_uniform(
        structure,
        conductivity=conductivity,
        volumetric_heat_capacity=HEAT,
        dtype=jnp.float64,
    )


def _rates(structure, values, conductivity=K):
    """Heat rate into each node of a body of one material [W]."""
    state = _state(structure, values)
    rate = _heat_rate(_network(structure, conductivity), state)
    return np.asarray(rate)[structure.node_address()]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("make", [jt.FullVolume, jt.Octree])
def test_along_an_axis_heat_flows_by_its_conductivity(axis, make):
    """A linear field along one axis: q = k_i A dT/dx through every plane."""
    cells = 10
    pitch = 0.01
    slope = 300.0
    grid = blocks(np.ones((cells,) * 3, bool), pitch)
    structure = make(grid, levels=1) if make is jt.Octree else make(grid)
    centre = structure.nodes().centre[:, axis]
    rate = _rates(structure, slope * centre)
    flow = K[axis] * (cells * pitch) ** 2 * slope
    low = centre < pitch
    high = centre > (cells - 1) * pitch
    assert rate[low].sum() == pytest.approx(flow, rel=1e-12)
    assert rate[high].sum() == pytest.approx(-flow, rel=1e-12)
    assert np.abs(rate[~(low | high)]).max() < 1e-12 * flow


def _mode_rate(cells):
    """Decay rate of one cosine mode an axis in an insulated box [1/s]."""
    size = (0.08, 0.04, 0.06)
    modes = (1, 2, 1)
    shape = tuple(int(round(cells * length / 0.04)) for length in size)
    pitch = 0.04 / cells
    structure = jt.FullVolume(blocks(np.ones(shape, bool), pitch))
    waves = [
        np.cos(m * np.pi * (np.arange(n) + 0.5) / n)
        for m, n in zip(modes, shape, strict=True)
    ]
    mode = np.einsum("x,y,z->xyz", *waves).reshape(-1)
    rate = _rates(structure, mode)
    capacity = HEAT * pitch**3
    decay_rate = -float(rate @ mode) / (capacity * float(mode @ mode))
    # An eigenvector: nothing but the mode itself comes of it.
    assert_allclose(rate, -decay_rate * capacity * mode, atol=1e-12)
    rows = zip(K, size, shape, modes, strict=True)
    return decay_rate, [(k / HEAT, length, n, m) for k, length, n, m in rows]


def test_a_sine_mode_decays_by_the_sum_over_the_axes_to_second_order():
    """exp(-(a_x q_x^2 + a_y q_y^2 + a_z q_z^2) t), a = k / (rho c)."""
    errors = []
    for cells in (8, 16, 32):
        rate, axes = _mode_rate(cells)
        exact = sum(sine_rate(a, length, m) for a, length, _, m in axes)
        discrete = sum(sine_rate_of_cells(*axis) for axis in axes)
        assert rate == pytest.approx(discrete, rel=1e-12)
        errors.append(abs(rate - exact) / exact)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 5e-3
    assert_allclose(orders, 2.0, atol=0.05)


def test_a_sine_mode_between_cold_faces_runs_to_rounding():
    """All faces prescribed through half a cell, k = n . K n: the same eigenvalues."""
    shape = (6, 5, 4)
    pitch = 0.01
    kelvin = 300.0
    dt = 0.5
    steps = 12
    size = [n * pitch for n in shape]
    structure = jt.FullVolume(blocks(np.ones(shape, bool), pitch))

    def start(centre):
        return kelvin + 10.0 * np.prod(np.sin(np.pi * centre / size), axis=1)

    scene = single_body_scene(
        structure, Material(K, 1e3, HEAT / 1e3), start, jt.FixedTemperature(kelvin)
    )
    solution = jt.simulate(
        scene, steps * dt, [0.0, steps * dt], solver=jt.ForwardEuler(dt)
    )
    rate = sum(
        sine_rate_of_cells(k / HEAT, length, n)
        for k, length, n in zip(K, size, shape, strict=True)
    )
    left = (solution.mean_temperature[1] - kelvin) / (
        solution.mean_temperature[0] - kelvin
    )
    assert float(left[0]) == pytest.approx(
        decay_explicit_euler(rate, dt, steps), rel=1e-11
    )


STRUCTURES = {
    "full": jt.FullVolume,
    "shell": jt.SingleShell,
    "octree": jt.Octree,
    "aggregate": lambda grid: jt.Aggregate(grid, factor=3),
}


@pytest.mark.parametrize("structure_name", STRUCTURES)
def test_a_turned_body_of_a_turned_material_conducts_the_same(structure_name):
    """Axes permuted, and conductivities with them: the dissipation stays."""
    solid = np.ones((9, 7, 8), bool)
    solid[6:, 4:, 5:] = False
    rates = []
    for turn in ((0, 1, 2), (1, 2, 0), (2, 1, 0)):
        grid = blocks(solid.transpose(turn), 0.01)
        structure = STRUCTURES[structure_name](grid)
        k = [K[axis] for axis in turn]
        centre = np.empty_like(structure.nodes().centre)
        centre[:, turn] = structure.nodes().centre
        values = np.sin(40 * centre[:, 0]) + 9 * centre[:, 1] ** 2 - 3 * centre[:, 2]
        rate = _rates(structure, values, k)
        assert abs(rate.sum()) < 1e-12 * np.abs(rate).sum()
        rates.append(-values @ rate)
    assert rates[0] > 0.0
    assert_allclose(rates, rates[0], rtol=1e-10)


@pytest.mark.parametrize("structure_name", STRUCTURES)
def test_three_equal_conductivities_are_one(structure_name):
    grid = blocks(np.ones((9, 7, 8), bool), 0.01)
    structure = STRUCTURES[structure_name](grid)
    values = np.random.default_rng(0).normal(size=structure.node_count)
    isotropic = _rates(structure, values, 5.0)
    three = _rates(structure, values, (5.0, 5.0, 5.0))
    assert_allclose(three, isotropic, rtol=1e-11, atol=1e-11)


def test_a_surface_conducts_by_its_normal():
    slant = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, 0.8]])
    wood = Material(K, 500.0, 1600.0)
    k = surface_conductivity(wood, slant, np.float64)
    assert_allclose(k, [16.0, 4.0, 0.36 * 16 + 0.64 * 1], rtol=1e-14)
    assert isinstance(k, np.ndarray)
    plain = surface_conductivity(Material(3.0, 1.0, 1.0), slant, np.float64)
    assert plain.shape == () and plain == 3.0
    by_row = normal_conductivity(np.tile(K, (3, 1)), slant)
    assert_allclose(by_row, k, rtol=1e-14)
    assert_array_equal(normal_conductivity(np.array([1.0, 2.0, 3.0]), slant), [1, 2, 3])


def test_two_layers_across_an_axis_are_in_series():
    """Half of the one, half of the other: 1 / k = (1 / k_1 + 1 / k_2) / 2, by axis."""
    first = Material((8.0, 2.0, 1.0), 1e3, 1e3)
    second = Material(4.0, 2e3, 1e3)
    table = conductivity_table((first, second), 300.0, jnp.float64)
    assert_array_equal(table, [[8, 2, 1], [4, 4, 4]])
    for axis, k_first in enumerate((8.0, 2.0, 1.0)):
        shape = [1, 1, 1]
        shape[axis] = 2
        structure = jt.FullVolume(blocks(np.ones(shape, bool), 0.1))
        network = materials_network(
            structure,
            number=np.array([0, 1], np.int32),
            materials=(first, second),
            reference=300.0,
            dtype=jnp.float64,
        )
        rate = _heat_rate(network, _state(structure, [0.0, 1.0]))
        conductance = 0.1 * 2 / (1 / k_first + 1 / 4.0)
        assert float(np.max(rate)) == pytest.approx(conductance, rel=1e-14)


def test_heat_spreads_in_an_ellipsoid():
    """From a hot voxel, variances along the axes grow as 2 k t / (rho c)."""
    structure = jt.FullVolume(blocks(np.ones((25, 13, 9), bool), 0.01))
    network = _network(structure)
    start = np.zeros((25, 13, 9))
    start[12, 6, 4] = 1.0
    state = _state(structure, start.reshape(-1))
    dt = jnp.asarray(1.0)
    steps = 8

    @eqx.filter_jit
    def run(state):
        for _ in range(steps):
            state = network.euler_step(state, dt)
        return state

    end_state = np.asarray(run(state))[structure.node_address()]
    assert end_state.sum() == pytest.approx(1.0, rel=1e-14)
    centre = structure.nodes().centre
    away = centre - end_state @ centre
    spread = end_state @ away**2
    expected = [2 * k / HEAT * float(dt) * steps for k in K]
    assert_allclose(spread, expected, rtol=1e-6)
    assert math.isclose(spread[0] / spread[2], K[0] / K[2], rel_tol=1e-6)
