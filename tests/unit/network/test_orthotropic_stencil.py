"""The stencil of three conductances, and what else conducts by axis."""

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxthermo.network.link_operator import RowNetwork
from jaxthermo.network.stencil import (
    HeterogeneousStencil,
    Stencil,
    solid_degree,
)
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform
from jaxthermo.structures.kinds.full import FullVolume
from tests.bodies import blocks


K = (16.0, 2.0, 0.5)
HEAT = 4e6
PITCH = 0.01
SHAPE = (4, 3, 5)
COUNT = 36


def _solid(seed):
    order = np.random.default_rng(seed).permutation(int(np.prod(SHAPE)))
    return (order < COUNT).reshape(SHAPE)


def _operator(solid, stencil, mixed):
    """Network of one material, or of two identical ones."""
    structure = FullVolume(blocks(solid, PITCH), stencil=stencil)
    if not mixed:
        return structure, assemble_uniform(structure, K, HEAT, jnp.float64)
    painted = np.arange(COUNT, dtype=np.int32) % 2
    conductivities = jnp.array([K, K])
    heat = jnp.array([HEAT, HEAT])
    return structure, _assemble_mixed(structure, painted, conductivities, heat)


KINDS = [(True, False), (False, False), (True, True), (False, True)]


def _by_hand(solid, values):
    """Conduction into every node [W], and the conductances of each, one by one."""
    cells = [tuple(c) for c in np.argwhere(solid)]
    number = {cell: n for n, cell in enumerate(cells)}
    rate = np.zeros(len(cells))
    diagonal = np.zeros(len(cells))
    for cell, n in number.items():
        for axis, step in enumerate(np.eye(3, dtype=int)):
            for sign in (-1, 1):
                neighbour = number.get(tuple(np.add(cell, sign * step)))
                if neighbour is not None:
                    rate[n] += K[axis] * PITCH * (values[neighbour] - values[n])
                    diagonal[n] += K[axis] * PITCH
    return rate, diagonal


@eqx.filter_jit
def _all_of(network, state, address, dt):
    return {
        "heat_rate": network.heat_rate(state)[address],
        "euler_step": network.euler_step(state, dt)[address],
        "diagonal": network.diagonal()[address],
        "max_rate": network.max_rate(),
        "total_capacity": network.total_capacity(),
        "stored": network.stored(state),
    }


def _state(structure, values):
    state = np.zeros(structure.state_shape)
    state[structure.node_address()] = values
    return jax.device_put(state)


@pytest.mark.parametrize("options", KINDS)
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_operator_is_the_one_by_hand(options, seed):
    solid = _solid(seed)
    structure, network = _operator(solid, *options)
    values = np.random.default_rng(seed + 1).normal(size=COUNT)
    rate, diagonal = _by_hand(solid, values)
    node = HEAT * PITCH**3
    address = jax.device_put(structure.node_address())
    actual = _all_of(network, _state(structure, values), address, jnp.array(0.1))
    expected = {
        "heat_rate": rate,
        "euler_step": values + 0.1 * rate / node,
        "diagonal": diagonal,
        "max_rate": diagonal.max() / node,
        "total_capacity": node * COUNT,
        "stored": node * values.sum(),
    }
    for name, exact in expected.items():
        np.testing.assert_allclose(
            actual[name], exact, rtol=1e-12, atol=1e-12, err_msg=name
        )
    assert abs(float(actual["heat_rate"].sum())) < 1e-13 * np.abs(rate).sum()


def test_which_operator_runs():
    operators = [type(_operator(_solid(0), *options)[1]) for options in KINDS]
    assert operators == [Stencil, RowNetwork, HeterogeneousStencil, RowNetwork]


def test_degrees_by_axis_add_up():
    solid = _solid(7)
    packed = solid_degree(solid, bits=2)
    split = sum((packed >> (2 * axis)) & 3 for axis in range(3))
    np.testing.assert_array_equal(split, solid_degree(solid))


def test_empty_cells_stay_at_zero():
    solid = _solid(3)
    structure, network = _operator(solid, True, False)
    state = _state(structure, np.arange(COUNT) + 1.0)
    stepped = np.array(jax.jit(network.euler_step)(state, 0.1))
    stepped[structure.node_address()] = 0.0
    assert not stepped.any()


def test_the_derivative_reaches_each_axis():
    """d(- u . rate)/d k_i = pitch * sum of the squared differences along axis i."""
    structure = FullVolume(blocks(np.ones((4, 3, 5), bool), PITCH))
    values = np.random.default_rng(2).normal(size=SHAPE)
    state = _state(structure, values.reshape(-1))

    def dissipated(k):
        network = assemble_uniform(structure, k, HEAT, jnp.float64)
        return -(state * network.heat_rate(state)).sum()

    actual = jax.jit(jax.grad(dissipated))(np.array(K))
    exact = [PITCH * (np.diff(values, axis=a) ** 2).sum() for a in range(3)]
    np.testing.assert_allclose(actual, exact, rtol=1e-12)
