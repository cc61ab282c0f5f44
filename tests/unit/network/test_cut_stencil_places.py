"""Nodes and capacities that are searched, against arrays of the whole lattice."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.network.cut_stencil import CutStencil
from jaxthermo.network.network import AbstractNetwork
from jaxthermo.physics.conduction import assemble_uniform


@pytest.fixture(scope="module")
def ball():
    grid = jt.voxelize(jt.shapes.sphere(0.1), 0.02)
    structure = jt.FullVolume(grid)
    network = assemble_uniform(structure, 16.0, 4e6, jnp.float64)
    assert isinstance(network, CutStencil)
    return structure, network


@eqx.filter_jit
def _all_of(network, address, state):
    return {
        "capacity": network.capacity(),
        "capacity_at": network.capacity_at(address),
        "max_rate": network.max_rate(),
        "max_rate of whole arrays": AbstractNetwork.max_rate(network),
        "total_capacity": network.total_capacity(),
        "stored": network.stored(state),
    }


def test_addresses_are_those_of_the_solid_voxels(ball):
    structure, _ = ball
    whole = [index + 1 for index in np.nonzero(structure.grid.solid)]
    np.testing.assert_array_equal(structure.node_address(), whole)
    some = np.random.default_rng(0).permutation(structure.node_count)[:50]
    found = structure.address_of(some)
    np.testing.assert_array_equal(found, [index[some] for index in whole])


def test_nodes_of_fragments_are_numbered_in_lattice_order(ball):
    structure, _ = ball
    solid = structure.grid.solid
    voxel = structure.grid.fragment_voxel
    number = np.cumsum(solid).reshape(solid.shape) - 1
    expected = number[tuple(voxel.T)]
    np.testing.assert_array_equal(structure.fragment_node(), expected)


def test_volumes_of_some_voxels_are_those_of_all(ball):
    grid = ball[0].grid
    voxels = np.argwhere(grid.solid)
    expected = grid.cut.spread(grid.solid)
    found = grid.cut.volumes_at(voxels, grid.solid.shape)
    np.testing.assert_array_equal(found, expected)


def test_capacities_and_rates_are_those_of_whole_arrays(ball):
    structure, network = ball
    address = structure.node_address()
    state = np.zeros(structure.state_shape)
    state[address] = np.random.default_rng(1).normal(size=structure.node_count)
    found = _all_of(network, address, state)
    capacity = np.asarray(found["capacity"])
    np.testing.assert_array_equal(found["capacity_at"], capacity[address])
    assert found["max_rate"] == found["max_rate of whole arrays"]
    assert found["total_capacity"] == pytest.approx(float(capacity.sum()), rel=1e-14)
    expected = float((capacity * state).sum())
    assert found["stored"] == pytest.approx(expected, rel=1e-12)
