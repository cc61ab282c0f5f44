"""Columns against dense matrices: the same conduction, and the solves of steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from numpy.testing import assert_allclose

from jaxthermo.network.column_cycle import column_cycle
from jaxthermo.network.column_network import ColumnNetwork
from jaxthermo.network.columns import FILTER_TIME, STABLE_FRACTION, Columns
from jaxthermo.network.link_operator import LinkNetwork, row_layout, row_network
from jaxthermo.network.multigrid import jacobi


CELLS = 3
COLUMNS = 5
OTHERS = 4
HUB = np.array([0, 0, 1, 3, 3])
SPAN = 7.0


def _random(shape, low, high, seed):
    return np.exp(np.random.default_rng(seed).uniform(np.log(low), np.log(high), shape))


class _Body:
    """A body with columns, and all its links as plain pairs."""

    def __init__(self, hub, others, dtype=np.float64, stiffness=1.0):
        count = CELLS * COLUMNS
        cell = np.arange(count)
        ends = np.append(cell[COLUMNS:], count + hub)
        conductance = stiffness * _random((CELLS, COLUMNS), 0.1, 10, seed=1)
        capacity = _random(count + others, 0.5, 20, seed=2)
        src = np.arange(others - 1)
        inside = _random(others - 1, 0.1, 1, seed=3)
        layout = row_layout(others, src=src, dst=src + 1)
        is_sequence = np.array_equal(hub, np.arange(COLUMNS))
        as_type = jnp.dtype(dtype)
        self.network = ColumnNetwork(
            others=row_network(
                layout,
                conductance=jnp.asarray(inside, as_type),
                node_capacity=jnp.asarray(capacity[count:], as_type),
            ),
            conductance=jnp.asarray(conductance, as_type),
            hub=None if is_sequence else jnp.asarray(hub),
            node_capacity=jnp.asarray(capacity, as_type),
            by_link=jnp.asarray(np.append(conductance, inside), as_type),
        )
        self.plain = LinkNetwork(
            src=jnp.asarray(np.append(cell, count + src)),
            dst=jnp.asarray(np.append(ends, count + src + 1)),
            conductance=jnp.asarray(np.append(conductance, inside), as_type),
            node_capacity=jnp.asarray(capacity, as_type),
        )
        self.state = jnp.asarray(
            np.random.default_rng(4).normal(size=count + others), as_type
        )

    def column_matrix(self):
        """A, conduction of the columns over capacity [1/s]."""
        identity = jnp.eye(self.state.shape[0])
        chains = self.network.columns
        return (
            np.asarray(jax.vmap(chains.heat_rate)(identity)).T
            / np.asarray(chains.node_capacity)[:, None]
        )

    def solve(self):
        """R = (I - s A)^-1, dense."""
        matrix = self.column_matrix()
        return np.linalg.inv(np.eye(len(matrix)) - SPAN * matrix)


@pytest.fixture(params=["shared hubs", "one hub each"])
def body(request):
    if request.param == "shared hubs":
        return _Body(HUB, OTHERS)
    return _Body(np.arange(COLUMNS), COLUMNS)


def test_conducts_as_all_links_in_pairs(body):
    for name in ("heat_rate", "face_heat_rate"):
        rate = getattr(body.network, name)(body.state)
        assert_allclose(rate, getattr(body.plain, name)(body.state), atol=1e-13)
    assert_allclose(body.network.diagonal(), body.plain.diagonal(), rtol=1e-14)
    assert_allclose(body.network.capacity(), body.plain.capacity())


def test_only_other_links_limit_the_step(body):
    others = body.network.others
    assert float(body.network.max_rate()) == float(others.max_rate())
    assert_allclose(
        body.network.explicit_diagonal()[-len(others.capacity()) :], others.diagonal()
    )
    assert float(body.network.max_rate()) < float(body.plain.max_rate())


def test_backward_step_is_the_inverse_of_the_dense_matrix(body):
    factors = body.network.columns.factored(jnp.asarray(SPAN))
    expected = body.solve() @ np.asarray(body.state)
    assert_allclose(factors.backward(body.state), expected, rtol=1e-12)


def test_filter_is_second_order(body):
    factors = body.network.columns.factored(jnp.asarray(SPAN))
    solve = body.solve()
    expected = (2 * solve - solve @ solve) @ np.asarray(body.state)
    assert_allclose(factors.filtered(body.state), expected, rtol=1e-11, atol=1e-13)
    errors = []
    for span in (1e-3, 5e-4):
        factors = body.network.columns.factored(jnp.asarray(span))
        errors.append(np.abs(factors.filtered(body.state) - body.state).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def test_rates_of_filtered_conduction_stay_below_the_limit_of_a_step(body):
    # All that does not belong to the columns is as stiff as the stable step allows.
    dt = 3.0
    matrix = body.column_matrix()
    capacity = np.asarray(body.network.capacity())
    root = np.sqrt(capacity)
    for stiffness in (1e-3, 1.0, 1e3, 1e6):
        columns = body.network.columns.scaled(jnp.asarray(stiffness))
        factors = columns.factored(jnp.asarray(FILTER_TIME * dt))
        product = np.asarray(jax.vmap(factors.filtered)(jnp.eye(len(matrix)))).T
        rng = np.random.default_rng(5)
        half = rng.normal(size=matrix.shape)
        symmetric = half @ half.T
        symmetric *= 2 * STABLE_FRACTION / dt / np.linalg.eigvalsh(symmetric).max()
        rates = -stiffness * matrix + symmetric * root / root[:, None]
        eigenvalues = np.linalg.eigvals(product @ rates)
        assert np.abs(eigenvalues.imag).max() < 1e-6
        assert eigenvalues.real.min() > -1e-9
        assert eigenvalues.real.max() <= 2 / dt * (1 + 1e-9)


@pytest.mark.parametrize("load", [0.0, 0.1, 10.0, 1e3])
def test_columns_spread_loads_on_their_cells(body, load):
    """The step is stable, and a third or more of the longest stable one."""
    columns = body.network.columns.scaled(jnp.asarray(100.0))
    matrix = 100.0 * body.column_matrix()
    capacity = np.asarray(body.network.capacity())
    root = np.sqrt(capacity)
    stiffness = load * _random(len(root), 0.1, 1, seed=6)
    stiffness[CELLS * COLUMNS :] = 0
    rng = np.random.default_rng(5)
    half = rng.normal(size=matrix.shape)
    others = half @ half.T
    rate = 0.05
    others *= 2 * rate / np.linalg.eigvalsh(others).max()
    loads = np.diag(stiffness / capacity)
    rates = loads - matrix + others * root / root[:, None]

    def largest_rate(dt, solve, span):
        factors = columns.factored(jnp.asarray(span * dt))
        product = np.asarray(jax.vmap(getattr(factors, solve))(jnp.eye(len(root)))).T
        return np.linalg.eigvals(product @ rates).real.max()

    dt = 1 / float(columns.stable_rate(jnp.asarray(rate), jnp.asarray(stiffness)))
    for solve, span in (("filtered", FILTER_TIME), ("backward", 1.0)):
        assert largest_rate(dt, solve, span) <= 2 / dt * (1 + 1e-9)
    assert largest_rate(3 * dt, "filtered", FILTER_TIME) > 2 / (3 * dt)
    in_columns = 0.2 * matrix * root[:, None] / root
    largest = np.linalg.eigvalsh(in_columns + loads).max()
    assert 1.68 / dt - 2 * rate == pytest.approx(largest, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("dtype", "limit"), [("float32", 3e-7), ("float64", 1e-15)])
@pytest.mark.parametrize("stiffness", [1e-6, 1.0, 1e6, 1e12])
def test_no_step_changes_the_heat_of_a_rise(dtype, limit, stiffness):
    body = _Body(HUB, OTHERS, dtype=dtype, stiffness=stiffness)
    factors = body.network.columns.factored(jnp.asarray(SPAN, dtype))
    capacity = np.asarray(body.network.capacity(), float)
    heat = capacity @ np.asarray(body.state, float)
    moved = capacity @ np.abs(np.asarray(body.state, float))
    for solve in (factors.backward, factors.filtered):
        after = capacity @ np.asarray(solve(body.state), float)
        assert abs(after - heat) < limit * moved


@pytest.mark.parametrize("stiffness", [1.0, 1e6])
def test_solves_of_the_columns_make_a_cycle_good_however_stiff_they_are(stiffness):
    """Symmetric and positive, with rates of M A within a factor of 4."""
    body = _Body(HUB, OTHERS, stiffness=stiffness)
    network = body.network
    m = jnp.asarray(_random(body.state.shape, 0.01, 1, seed=7))
    plain = jacobi(network, m)
    cycle = column_cycle(network, columns=network.columns, m=m, cycle=plain)
    identity = jnp.eye(len(m))
    matrix = np.diag(m) - np.asarray(jax.vmap(network.heat_rate)(identity))
    conditions = []
    for inverse in (cycle, plain):
        approximate = np.asarray(jax.vmap(inverse)(identity))
        assert_allclose(approximate, approximate.T, rtol=1e-7, atol=1e-12)
        rates = np.linalg.eigvals(approximate @ matrix).real
        assert rates.min() > 0
        conditions.append(rates.max() / rates.min())
    assert conditions[0] < 4
    assert conditions[1] > 10 * conditions[0]


def test_nothing_changes_where_no_heat_flows(body):
    uniform = jnp.full_like(body.state, 3.0)
    rate = body.network.heat_rate(uniform)
    assert_allclose(rate, 0, atol=1e-13)
    factors = body.network.columns.factored(jnp.asarray(SPAN))
    assert np.abs(factors.filtered(rate)).max() < 1e-12


def test_derivatives_by_conductances_and_capacities_are_those_of_the_solve():
    body = _Body(HUB, OTHERS)
    chains = body.network.columns

    @jax.jit
    def result(scale):
        columns = Columns(
            conductance=chains.conductance * scale[0],
            hub=chains.hub,
            node_capacity=chains.node_capacity * scale[1],
        )
        return (columns.factored(jnp.asarray(SPAN)).filtered(body.state) ** 2).sum()

    check_grads(result, (jnp.array([1.1, 0.8]),), order=1, rtol=1e-6)
