"""All conduction operators agree, are symmetric and lose no heat."""

import math

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxthermo.network.link_operator import LinkNetwork
from jaxthermo.network.network import precise_sum
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform, series
from jaxthermo.structures.kinds.full import FullVolume
from tests.bodies import blocks


K = 16.0
HEAT = 4e6
PITCH = 0.01
SHAPE = (4, 3, 5)
"""One shape for every random body: nothing is compiled twice."""


def _solid(seed, count=36):
    """`count` of the 60 cells, so that arrays of nodes have one shape, too."""
    order = np.random.default_rng(seed).permutation(int(np.prod(SHAPE)))
    return (order < count).reshape(SHAPE)


@eqx.filter_jit
def _all_of(network, state, address, dt):
    """Everything a network can say, from one program."""
    return {
        "heat_rate": network.heat_rate(state),
        "euler_step": network.euler_step(state, dt),
        "diagonal": network.diagonal()[address],
        "capacity": network.capacity_at(address),
        "max_rate": network.max_rate(),
        "total_capacity": network.total_capacity(),
        "stored": network.stored(state),
    }


def _operator(solid, which):
    """A stencil, rows, both of two materials that are the same, or plain pairs."""
    structure = FullVolume(blocks(solid, PITCH), stencil=which in (0, 2))
    if which < 2:
        return structure, assemble_uniform(structure, K, HEAT, jnp.float64)
    if which == 4:
        return structure, _pairs(structure)
    painted = np.arange(structure.node_count, dtype=np.int32) % 2
    conductivities = jnp.array([K, K])
    heat = jnp.array([HEAT, HEAT])
    return structure, _assemble_mixed(structure, painted, conductivities, heat)


def _pairs(structure):
    links = structure.links()
    count = structure.node_count
    return LinkNetwork(
        src=jax.device_put(links.src),
        dst=jax.device_put(links.dst),
        conductance=jax.device_put(np.full(len(links.src), K * PITCH)),
        node_capacity=jax.device_put(np.full(count, HEAT * PITCH**3)),
    )


def _address(structure):
    return tuple(jax.device_put(a) for a in structure.node_address())


def _state(structure, values):
    state = np.zeros(structure.state_shape)
    state[structure.node_address()] = values
    return jax.device_put(state)


def _values(structure, state):
    return np.asarray(state)[structure.node_address()]


def _by_hand(solid, values):
    """Conduction into every node [W], and the conductances of each, one by one."""
    cells = [tuple(c) for c in np.argwhere(solid)]
    number = {cell: n for n, cell in enumerate(cells)}
    rate = np.zeros(len(cells))
    diagonal = np.zeros(len(cells))
    for cell, n in number.items():
        for axis in range(3):
            for sign in (-1, 1):
                neighbour = number.get(
                    tuple(np.add(cell, sign * np.eye(3, dtype=int)[axis]))
                )
                if neighbour is not None:
                    rate[n] += K * PITCH * (values[neighbour] - values[n])
                    diagonal[n] += K * PITCH
    return rate, diagonal


@pytest.mark.parametrize("which", range(5))
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.sampled_from([6, 36, 60]))
def test_every_operator_is_the_one_by_hand_symmetric_and_conserving(which, seed, count):
    solid = _solid(seed, count)
    structure, network = _operator(solid, which)
    values, neighbours = np.random.default_rng(seed + 1).normal(size=(2, count))
    rate, diagonal = _by_hand(solid, values)
    node = HEAT * PITCH**3
    dt = 0.1
    expected = {
        "heat_rate": rate,
        "euler_step": values + dt * rate / node,
        "diagonal": diagonal,
        "capacity": node,
        "max_rate": diagonal.max() / node,
        "total_capacity": node * count,
        "stored": node * values.sum(),
    }
    state = _state(structure, values)
    address = _address(structure)
    actual = _all_of(network, state, address, jnp.array(dt))
    for name, exact in expected.items():
        of_nodes = name in ("heat_rate", "euler_step")
        number = _values(structure, actual[name]) if of_nodes else actual[name]
        np.testing.assert_allclose(number, exact, rtol=1e-12, atol=1e-12, err_msg=name)
    rates = _values(structure, actual["heat_rate"])
    again = _all_of(network, _state(structure, neighbours), address, jnp.array(dt))
    back = _values(structure, again["heat_rate"])
    scale = np.abs(rates).sum()
    assert abs(neighbours @ rates - values @ back) <= 1e-13 * scale
    assert abs(rates.sum()) <= 1e-14 * scale
    assert values @ rates < 0.0 or not scale


@pytest.mark.parametrize("which", range(5))
def test_empty_cells_stay_at_zero(which):
    structure, network = _operator(_solid(3), which)
    state = _state(structure, np.arange(structure.node_count) + 1.0)
    actual = _all_of(network, state, _address(structure), jnp.array(0.1))
    stepped = actual["euler_step"]
    only_nodes = _state(structure, _values(structure, stepped))
    np.testing.assert_array_equal(stepped, only_nodes)


@pytest.mark.parametrize("mixed", [False, True])
def test_two_materials_take_the_harmonic_mean(mixed):
    solid = np.ones((2, 1, 1), bool)
    structure = FullVolume(blocks(solid, PITCH), stencil=not mixed)
    material = np.array([0, 1], np.int32)
    network = _assemble_mixed(
        structure, material, jnp.array([401.0, 0.2]), jnp.array([1e6, 2e6])
    )
    state = _state(structure, [1.0, 0.0])
    address = _address(structure)
    actual = _all_of(network, state, address, jnp.array(0.1))
    rate = _values(structure, actual["heat_rate"])
    conductance = 2 * 401.0 * 0.2 / 401.2 * PITCH
    np.testing.assert_allclose(rate, [-conductance, conductance], rtol=1e-14)
    np.testing.assert_allclose(actual["capacity"], [1e6 * PITCH**3, 2e6 * PITCH**3])


@pytest.mark.parametrize(("first", "second"), [(0.0, 0.0), (0.0, 2.0), (3.0, 0.0)])
def test_series_with_an_insulator_has_value_and_gradient(first, second):
    single = np.array(1.0)
    half = np.array(0.5)

    def link(conductivity):
        return series(single, half, conductivity, half, jnp.array(second))

    value, slope = jax.value_and_grad(link)(jnp.array(first))
    assert float(value) == 0.0
    # 1 / (1 / 2 k1 + 1 / 2 k2) -> 2 k1 for k1 << k2.
    assert float(slope) == (2.0 if second else 0.0)


def test_series_of_unequal_lengths_is_a_sum_of_resistances():
    area, first, second = (np.array(v) for v in (3.0, 0.2, 0.7))
    actual = series(area, first, jnp.array(5.0), second, jnp.array(2.0))
    assert float(actual) == pytest.approx(3.0 / (0.2 / 5.0 + 0.7 / 2.0), rel=1e-14)


@pytest.mark.parametrize("stencil", [True, False])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 6, 1), (1, 1, 2)])
def test_thin_bodies(stencil, shape):
    solid = np.ones(shape, bool)
    structure = FullVolume(blocks(solid, PITCH), stencil=stencil)
    network = assemble_uniform(structure, K, HEAT, jnp.float64)
    values = np.arange(structure.node_count) * 1.0
    rate, _ = _by_hand(solid, values)
    actual = _values(structure, network.heat_rate(_state(structure, values)))
    np.testing.assert_allclose(actual, rate, rtol=1e-14)
    assert structure.link_count == solid.size - 1


@pytest.mark.parametrize("signs", ["positive", "signed"])
def test_precise_sum_of_a_million_float32(signs):
    values = np.random.default_rng(0).random(10**6).astype(np.float32)
    if signs == "signed":
        values = values - np.float32(0.5)
    exact = math.fsum(values.tolist())
    scale = math.fsum(np.abs(values).tolist())
    actual = float(jax.jit(precise_sum)(jnp.asarray(values)))
    in_turn = float(np.cumsum(values)[-1])
    print("precise_sum", (actual - exact) / scale, "in turn", (in_turn - exact) / scale)
    assert abs(actual - exact) < 2.4e-7 * scale
    assert precise_sum(jnp.zeros((0,), jnp.float32)) == 0.0


@pytest.mark.parametrize(
    "shape", [(12, 12, 12), (16, 16, 16), (64, 64, 64), (40, 40, 41)]
)
def test_sums_over_a_box_are_not_one_sequence(shape):
    # XLA joins sums of sums over whole blocks to one sum: forty times the error.
    random = np.random.default_rng(0).random(shape) < 0.5
    values = np.where(random, 0.8125917, 1.1234567).astype(np.float32)
    exact = values.astype(float).sum()
    assert float(precise_sum(jnp.asarray(values))) == pytest.approx(exact, rel=4e-7)


@settings(max_examples=20, deadline=None)
@given(count=st.sampled_from([1, 63, 64, 65, 4097]), seed=st.integers(0, 99))
def test_precise_sum_of_any_length(count, seed):
    values = np.random.default_rng(seed).normal(size=count)
    actual = float(precise_sum(jnp.asarray(values)))
    assert actual == pytest.approx(math.fsum(values), abs=1e-14 * np.abs(values).sum())
