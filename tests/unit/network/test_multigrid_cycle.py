"""The cycle is a fixed symmetric positive map, exact where few nodes are left."""

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxthermo.network import multigrid
from jaxthermo.network.multigrid import hierarchy, jacobi
from jaxthermo.network.multigrid_cycle import _SMOOTHED_RANGE, dense_solve, level
from jaxthermo.network.stencil import HeterogeneousStencil
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import Octree
from tests.bodies import blocks
from tests.networks import pairs_of, state_of


SHAPE = (7, 6, 9)


def _solid():
    """Odd and even sizes, holes, a gap, a part and a voxel of their own."""
    solid = np.ones(SHAPE, bool)
    solid[3, :, 2:] = False
    solid[:, 4, 3:] = False
    solid[5:, 5, 7:] = False
    solid[6, 5, 8] = True
    return solid


def _network(form):
    grid = blocks(_solid())
    structure = FullVolume(grid, stencil=form in ("stencil", "axes", "mixed"))
    if form == "mixed":
        number = (structure.nodes().centre[:, 2] > 3).astype(np.int32)
        k = jnp.array([1.0, 1e5])
        heat = jnp.ones(2)
        return structure, _assemble_mixed(structure, number, k, heat)
    k = jnp.array([3.0, 1.0, 0.5]) if form == "axes" else 2.0
    network = assemble_uniform(structure, k, 1.0, np.float64)
    if form != "links":
        return structure, network
    return structure, pairs_of(structure, 2.0, node_capacity=1.0)


_cycles = jax.jit(lambda levels, m, states: jax.vmap(levels.cycle(m))(states))
_operators = jax.jit(
    lambda network, m, states: jax.vmap(lambda v: m * v - network.heat_rate(v))(states)
)


def _matrix(call, operand, m, structure):
    """Matrix of a linear map between states, on the nodes alone."""
    address = structure.node_address()
    shape = structure.state_shape
    n = structure.node_count
    unit = np.zeros((n, *shape))
    unit[(np.arange(n), *address)] = 1.0
    images = np.asarray(call(operand, m, unit))
    columns = images[(slice(None), *address)]
    neighbours = np.abs(images).reshape(n, -1).sum(1) - np.abs(columns).sum(1)
    assert np.abs(neighbours).max() < 1e-12 * np.abs(columns).max()
    return columns


@pytest.fixture(
    params=[
        "stencil",
        pytest.param("axes", marks=pytest.mark.slow),
        pytest.param("mixed", marks=pytest.mark.slow),
        "rows",
        # As rows are; its coarse levels are made of the same links.
        pytest.param("links", marks=pytest.mark.slow),
    ]
)
def body(request, monkeypatch):
    """With coarse levels although it is small."""
    monkeypatch.setattr(multigrid, "MAX_DENSE_SIZE", 60)
    return _network(request.param)


def test_the_cycle_is_symmetric_positive_and_near_the_inverse(body):
    structure, network = body
    random = np.random.default_rng(0)
    m = state_of(structure, 10.0 ** random.uniform(-4, 1, structure.node_count))
    levels = hierarchy(structure, network)
    assert len(levels.networks) > 1
    actual = _matrix(_cycles, levels, m, structure)
    scale = np.sqrt(np.outer(np.diag(actual), np.diag(actual)))
    assert (np.abs(actual - actual.T) / scale).max() < 1e-12
    exact = _matrix(_operators, network, m, structure)
    half = np.linalg.cholesky(exact)
    spectrum = np.linalg.eigvalsh(half.T @ actual @ half)
    assert spectrum.min() > 0
    if isinstance(network, HeterogeneousStencil):
        # Parts that conduct well and are connected poorly, joined by larger blocks.
        spectrum = spectrum[3:]
    assert spectrum.min() > 0.1
    assert spectrum.max() < 2.5
    plain = np.linalg.eigvalsh(half.T @ (half / np.diag(exact)[:, None]))
    assert spectrum.max() / spectrum.min() < plain.max() / plain.min() / 10


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_few_nodes_are_solved_exactly(seed):
    structure = Octree(blocks(np.ones((4, 4, 4), bool)))
    network = assemble_uniform(structure, 2.0, 1.0, np.float64)
    random = np.random.default_rng(seed)
    m = jnp.asarray(10.0 ** random.uniform(-4, 4, structure.node_count))
    levels = hierarchy(structure, network)
    assert len(levels.networks) == 1
    inverse = _matrix(_cycles, levels, m, structure)
    product = inverse @ _matrix(_operators, network, m, structure)
    np.testing.assert_allclose(product, np.eye(len(product)), atol=1e-6)


@jax.jit
def _solved_again(network, m, expected):
    return dense_solve(network, m)(-network.heat_rate(expected))


@jax.jit
def _smoothed(network, m, state):
    """The polynomial of the smoother, the smoother, and the same step by step."""
    finest = level(network, m)
    twice = jacobi(network, m)
    d = twice(state)
    by_hand = finest.constant * d - finest.slope * twice(finest.apply(d))
    return finest.constant, finest.slope, finest.smoothed(state), by_hand


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_body_that_nothing_holds_stays_finite_and_solved(dtype):
    """The heat sums to nothing: the solution is one up to a constant."""
    structure = FullVolume(blocks(np.ones((4, 3, 2), bool)))
    network = assemble_uniform(structure, 1.0, 1.0, dtype)
    nothing = np.zeros(structure.state_shape, dtype)
    values = np.random.default_rng(1).normal(size=24)
    expected = np.asarray(state_of(structure, values)).astype(dtype)
    actual = _solved_again(network, nothing, expected)
    gap = np.asarray(actual - expected)[structure.node_address()]
    assert np.ptp(gap) < (2e-3 if dtype == np.float32 else 1e-9)


def test_the_smoother_is_chebyshevs():
    """1 - x q(x) on the smoothed range is no larger than 1 / T_2 of its middle."""
    structure = FullVolume(blocks(np.ones((6, 6, 6), bool)))
    network = assemble_uniform(structure, 1.0, 1.0, np.float64)
    unit = state_of(structure, np.random.default_rng(0).normal(size=216))
    nothing = state_of(structure, np.zeros(216))
    first, second, smoothed, by_hand = _smoothed(network, nothing, unit)
    x = np.linspace(2 / _SMOOTHED_RANGE, 2, 101)
    left = np.abs(1 - x * (float(first) - float(second) * x))
    middle = (_SMOOTHED_RANGE + 1) / (_SMOOTHED_RANGE - 1)
    assert left.max() == pytest.approx(1 / (2 * middle**2 - 1), rel=1e-12)
    np.testing.assert_allclose(smoothed, by_hand, atol=1e-14)


def test_without_links_one_sweep_of_the_smoother_is_exact():
    structure = FullVolume(blocks(np.ones((1, 1, 1), bool)))
    network = assemble_uniform(structure, 1.0, 1.0, np.float64)
    smoothed = _smoothed(network, state_of(structure, 4.0), state_of(structure, 2.0))[2]
    np.testing.assert_allclose(smoothed.sum(), 0.5)
