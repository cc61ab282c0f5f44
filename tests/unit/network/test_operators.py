"""All conduction operators agree, are symmetric and lose no heat."""

import math
from typing import Any

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxthermo.network.link_operator import RowNetwork
from jaxthermo.network.network import precise_sum
from jaxthermo.network.stencil import HeterogeneousStencil, Stencil, solid_degree
from jaxthermo.physics.conduction import _assemble_mixed, series
from jaxthermo.structures.kinds.full import FullVolume
from tests.bodies import blocks
from tests.networks import (
    one_material,
    outputs_at_nodes,
    pairs_of,
    rates_by_hand,
    state_of,
    two_materials,
)


K = 16.0
K_BY_AXIS = (16.0, 2.0, 0.5)
HEAT = 4e6
PITCH = 0.01
SHAPE = (4, 3, 5)
"""One shape for every random body: nothing is compiled twice."""
COUNT = 36


def _solid(seed, count=COUNT):
    """`count` of the 60 cells, so that arrays of nodes have one shape, too."""
    order = np.random.default_rng(seed).permutation(int(np.prod(SHAPE)))
    return (order < count).reshape(SHAPE)


def _operator(solid, which, k: Any = K):
    """A stencil, rows, both of two materials that are the same, or plain pairs."""
    structure = FullVolume(blocks(solid, PITCH), stencil=which in (0, 2))
    if which < 2:
        return structure, one_material(structure, k, HEAT)
    if which == 4:
        return structure, pairs_of(structure, K * PITCH, HEAT * PITCH**3)
    return structure, two_materials(structure, [k, k], HEAT)


def _check_by_hand(which, k, seed, count):
    solid = _solid(seed, count)
    structure, network = _operator(solid, which, k)
    values, neighbours = np.random.default_rng(seed + 1).normal(size=(2, count))
    conductances = PITCH * np.broadcast_to(k, 3)
    rate, diagonal = rates_by_hand(solid, values, conductances)
    node = HEAT * PITCH**3
    expected = {
        "heat_rate": rate,
        "euler_step": values + 0.1 * rate / node,
        "diagonal": diagonal,
        "capacity": node,
        "max_rate": diagonal.max() / node,
        "total_capacity": node * count,
        "stored": node * values.sum(),
    }
    actual = outputs_at_nodes(structure, network, values)
    for name, exact in expected.items():
        np.testing.assert_allclose(
            actual[name], exact, rtol=1e-12, atol=1e-12, err_msg=name
        )
    rates = np.asarray(actual["heat_rate"])
    back = np.asarray(outputs_at_nodes(structure, network, neighbours)["heat_rate"])
    scale = np.abs(rates).sum()
    assert abs(neighbours @ rates - values @ back) <= 1e-13 * scale
    assert abs(rates.sum()) <= 1e-14 * scale
    assert values @ rates < 0.0 or not scale


@pytest.mark.parametrize("which", range(5))
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.sampled_from([6, 36, 60]))
def test_every_operator_is_the_one_by_hand_symmetric_and_conserving(which, seed, count):
    _check_by_hand(which, K, seed=seed, count=count)


@pytest.mark.parametrize("which", range(4))
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_operators_of_three_conductivities_are_those_by_hand(which, seed):
    _check_by_hand(which, K_BY_AXIS, seed=seed, count=COUNT)


@pytest.mark.parametrize(
    ("which", "k"), [*((which, K) for which in range(5)), (0, K_BY_AXIS)]
)
def test_empty_cells_stay_at_zero(which, k):
    structure, network = _operator(_solid(3), which, k)
    state = state_of(structure, np.arange(structure.node_count) + 1.0)
    stepped = eqx.filter_jit(network.euler_step)(state, jnp.array(0.1))
    at_nodes = np.asarray(stepped)[structure.node_address()]
    np.testing.assert_array_equal(stepped, state_of(structure, at_nodes))


def test_which_operator_has_three_conductivities():
    operators = [type(_operator(_solid(0), n, K_BY_AXIS)[1]) for n in range(4)]
    assert operators == [Stencil, RowNetwork, HeterogeneousStencil, RowNetwork]


def test_degrees_by_axis_add_up():
    solid = _solid(7)
    packed = solid_degree(solid, bits=2)
    split = sum((packed >> (2 * axis)) & 3 for axis in range(3))
    np.testing.assert_array_equal(split, solid_degree(solid))


def test_the_derivative_reaches_each_axis():
    """d(- u . rate)/d k_i = pitch * sum of the squared differences along axis i."""
    structure = FullVolume(blocks(np.ones(SHAPE, bool), PITCH))
    values = np.random.default_rng(2).normal(size=SHAPE)
    state = state_of(structure, values.reshape(-1))

    def dissipated(k):
        network = one_material(structure, k, HEAT)
        return -(state * network.heat_rate(state)).sum()

    actual = jax.jit(jax.grad(dissipated))(np.array(K_BY_AXIS))
    exact = [PITCH * (np.diff(values, axis=a) ** 2).sum() for a in range(3)]
    np.testing.assert_allclose(actual, exact, rtol=1e-12)


@pytest.mark.parametrize("mixed", [False, True])
def test_two_materials_take_the_harmonic_mean(mixed):
    solid = np.ones((2, 1, 1), bool)
    structure = FullVolume(blocks(solid, PITCH), stencil=not mixed)
    material = np.array([0, 1], np.int32)
    network = _assemble_mixed(
        structure, material, jnp.array([401.0, 0.2]), jnp.array([1e6, 2e6])
    )
    actual = outputs_at_nodes(structure, network, [1.0, 0.0])
    conductance = 2 * 401.0 * 0.2 / 401.2 * PITCH
    expected = [-conductance, conductance]
    np.testing.assert_allclose(actual["heat_rate"], expected, rtol=1e-14)
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
    network = one_material(structure, K, HEAT)
    values = np.arange(structure.node_count) * 1.0
    rate, _ = rates_by_hand(solid, values, [K * PITCH] * 3)
    actual = network.heat_rate(state_of(structure, values))[structure.node_address()]
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
