"""Rows do what plain pairs do, for any links; layouts hold every link twice."""

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxthermo import arrays
from jaxthermo.network.link_operator import LinkNetwork, row_layout, row_network
from tests.networks import outputs_of


NODES = 40
LINKS = 90


def _random_links(seed, hub=False):
    """Links between random nodes, some twice, in no order; or most at one node."""
    random = np.random.default_rng(seed)
    src = np.zeros(LINKS, int) if hub else random.integers(0, NODES, LINKS)
    dst = (src + random.integers(1, NODES, LINKS)) % NODES
    order = np.argsort(src, kind="stable")
    return src[order].astype(np.int32), dst[order].astype(np.int32)


def _both(src, dst, seed):
    random = np.random.default_rng(seed)
    conductance = jax.device_put(random.random(len(src)))
    capacity = jax.device_put(1 + random.random(NODES))
    pairs = LinkNetwork(
        src=jax.device_put(src),
        dst=jax.device_put(dst),
        conductance=conductance,
        node_capacity=capacity,
    )
    return pairs, row_network(row_layout(NODES, src, dst), conductance, capacity)


@pytest.fixture(scope="module", params=[0.0, arrays.LIST_COST], autouse=True)
def list_start(request):
    """With a list where it pays by its entries alone, and as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "LIST_COST", request.param)
        yield


def _all_of(network, state):
    return outputs_of(network, state, (jnp.arange(NODES),), jnp.array(0.01))


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hub=st.booleans())
def test_rows_are_the_pairs(seed, hub):
    src, dst = _random_links(seed, hub)
    pairs, rows = _both(src, dst, seed)
    state = jnp.asarray(np.random.default_rng(seed + 1).normal(size=NODES))
    actual = _all_of(rows, state)
    expected = _all_of(pairs, state)
    for name, value in expected.items():
        np.testing.assert_allclose(
            actual[name], value, rtol=1e-12, atol=1e-13, err_msg=name
        )
    assert abs(np.asarray(actual["heat_rate"]).sum()) < 1e-12


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hub=st.booleans())
def test_every_link_stands_in_the_rows_of_both_its_nodes(seed, hub):
    src, dst = _random_links(seed, hub)
    layout = row_layout(NODES, src, dst)
    seen = [
        (n, layout.link[k][n]) for k in range(len(layout.link)) for n in range(NODES)
    ]
    seen = [(n, link) for n, link in seen if link < LINKS]
    seen += list(zip(layout.list_node, layout.list_link, strict=True))
    expected = [(n, link) for link in range(LINKS) for n in (src[link], dst[link])]
    assert sorted((int(a), int(b)) for a, b in seen) == sorted(
        (int(a), int(b)) for a, b in expected
    )
    assert (np.diff(layout.list_node) >= 0).all()


def test_a_hub_keeps_the_rest_of_its_neighbours_in_the_list(monkeypatch):
    """But a small structure has none: starting on a list costs more than padding."""
    src, dst = _random_links(0, hub=True)
    monkeypatch.setattr(arrays, "LIST_COST", 30_000.0)
    assert len(row_layout(NODES, src, dst).list_node) == 0
    monkeypatch.setattr(arrays, "LIST_COST", 0.0)
    layout = row_layout(NODES, src, dst)
    assert len(layout.list_node) > 0
    assert len(layout.neighbour) < 10


def test_nodes_without_any_link():
    none = np.zeros(0, np.int32)
    pairs, rows = _both(none, none, 0)
    state = jnp.arange(NODES, dtype=float)
    actual = _all_of(rows, state)
    expected = _all_of(pairs, state)
    np.testing.assert_array_equal(actual["heat_rate"], 0.0)
    np.testing.assert_array_equal(actual["euler_step"], state)
    assert float(actual["max_rate"]) == float(expected["max_rate"]) == 0.0


def test_the_derivative_reaches_every_conductance():
    src, dst = _random_links(3)
    state = jax.device_put(np.random.default_rng(4).normal(size=NODES))
    layout = row_layout(NODES, src, dst)
    capacity = jax.device_put(np.ones(NODES))

    def energy(conductance):
        rate = row_network(layout, conductance, capacity).heat_rate(state)
        return -(state * rate).sum()

    actual = jax.jit(jax.grad(energy))(np.ones(LINKS))
    exact = (np.asarray(state)[src] - np.asarray(state)[dst]) ** 2
    np.testing.assert_allclose(actual, exact, rtol=1e-12)
    assert float(actual.min()) >= 0.0
    assert exact.max() == pytest.approx(float(actual.max()))
