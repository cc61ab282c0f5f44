"""Conduction as a primitive: every derivative is that of the plain operator."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo import arrays
from jaxthermo.network.link_operator import _ROWS, row_layout, row_network
from jaxthermo.network.self_adjoint_primitive import conduct, conduct_step
from jaxthermo.network.stencil import _STENCIL, solid_degree


class Case(NamedTuple):
    operator: Any
    state: Any
    conductance: Any
    """Conductances, of all links or of each."""
    factors: Any
    """The factors that they make: a link stands in the rows of both its nodes."""
    layout: Any
    nodes: Any
    """Positions of the nodes in a state."""


def _uniform():
    random = np.random.default_rng(3)
    solid = random.random((4, 5, 6)) < 0.7
    # A voxel without neighbours, at a corner.
    solid[:2, :2, :2] = False
    solid[0, 0, 0] = True
    degree = solid_degree(solid)
    assert degree[0, 0, 0] == 0
    nodes = np.pad(solid, 1)
    state = jnp.asarray(np.where(nodes, random.normal(size=nodes.shape), 0.0))
    return Case(
        _STENCIL, state, jnp.asarray(0.11), lambda g: g, jnp.asarray(degree), nodes
    )


def _rows():
    random = np.random.default_rng(4)
    nodes = 14
    # Half of the links are those of one node.
    src = np.sort(random.integers(0, nodes, 24) * (np.arange(24) % 2)).astype(np.int32)
    dst = ((src + random.integers(1, nodes, 24)) % nodes).astype(np.int32)
    with pytest.MonkeyPatch.context() as patch:
        # So that some links stand in the list.
        patch.setattr(arrays, "LIST_COST", 0.0)
        layout = row_layout(nodes, src, dst)
    conductance = jnp.asarray(random.random(24) / 8)
    rows = row_network(layout, conductance, jnp.ones(nodes))

    def factors(conductance):
        network = row_network(layout, conductance, jnp.ones(nodes))
        return network.conductance, network.list_conductance

    assert len(rows.list_node)
    return Case(
        _ROWS,
        jnp.asarray(random.normal(size=nodes)),
        conductance,
        factors,
        (rows.neighbour, rows.list_node, rows.list_neighbour),
        np.ones(nodes, bool),
    )


CASES = {"uniform": _uniform, "rows": _rows}


@pytest.fixture(scope="module", params=list(CASES))
def case(request):
    return CASES[request.param]()


def _weights(case):
    """Values for every entry of a state, including those without a node."""
    return jnp.asarray(np.random.default_rng(5).normal(size=case.state.shape))


def _chain(case, plain):
    """A number that depends on all of a few changes, in a loop."""
    operator = case.operator

    def change(state, factors):
        if plain:
            return operator.change(state, factors, case.layout)
        return conduct(operator, state, factors, case.layout)

    def step(state, factors):
        if plain:
            return operator.step(state, factors, case.layout)
        return conduct_step(operator, state, factors, case.layout)

    def run(scale, state, arguments):
        factors = case.factors(scale * arguments)
        state = jnp.where(jnp.asarray(case.nodes), state, 0)

        def advance(_, state):
            return step(state, factors) + change(state * state, factors) / 10

        end = jax.lax.fori_loop(0, 3, advance, state)
        return (_weights(case) * (end + end**2)).sum()

    return run


def _same(actual, expected):
    def compare(a, b):
        size = float(jnp.abs(b).max())
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12 * size)

    jax.tree.map(compare, actual, expected)


ONE = jnp.asarray(1.0)


@pytest.mark.parametrize(
    "derive",
    [
        lambda run: jax.value_and_grad(run, argnums=(0, 1, 2)),
        lambda run: jax.jacfwd(run, argnums=(0, 1)),
        # Covered by the next, but for the order of the two transformations.
        pytest.param(
            lambda run: jax.grad(jax.grad(run), argnums=(0, 1, 2)),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["reverse", "forward", "twice reverse"],
)
def test_derivatives_are_those_of_the_plain_operator(case, derive):
    _has_derivatives_of_the_plain_operator(case, derive)


# What is transformed twice is the rule of both operators, whose derivatives are above.
@pytest.mark.parametrize(
    "case", ["uniform", pytest.param("rows", marks=pytest.mark.slow)], indirect=True
)
@pytest.mark.parametrize(
    "derive",
    [
        lambda run: jax.jacfwd(jax.grad(run, argnums=(0, 1, 2))),
        lambda run: jax.grad(jax.checkpoint(run), argnums=(0, 1, 2)),
    ],
    ids=["forward of reverse", "checkpoint"],
)
def test_transformed_derivatives_are_those_of_the_plain_operator(case, derive):
    _has_derivatives_of_the_plain_operator(case, derive)


def _has_derivatives_of_the_plain_operator(case, derive):
    actual, expected = (
        jax.jit(derive(_chain(case, plain=plain)))(ONE, case.state, case.conductance)
        for plain in (False, True)
    )
    _same(actual, expected)


@pytest.mark.parametrize(
    "case", ["uniform", pytest.param("rows", marks=pytest.mark.slow)], indirect=True
)
def test_derivatives_map_over_a_batch(case):
    scales = jnp.array([0.5, 1.0, 1.5])

    def derivatives(plain):
        run = _chain(case, plain)
        over_scales = jax.vmap(run, (0, None, None))

        @jax.jit
        def evaluate(scales, state, factors):
            return [
                jax.vmap(jax.value_and_grad(run), (0, None, None))(
                    scales, state, factors
                ),
                jax.vmap(jax.jacfwd(run), (0, None, None))(scales, state, factors),
                jax.grad(lambda s: over_scales(s, state, factors).sum())(scales),
            ]

        return evaluate(scales, case.state, case.conductance)

    _same(derivatives(plain=False), derivatives(plain=True))


def test_the_gradient_is_the_central_difference(case):
    results = jax.jit(jax.value_and_grad(_chain(case, plain=False)))

    def run(scale):
        return results(scale, case.state, case.conductance)

    step = 1e-5
    difference = (run(1 + step)[0] - run(1 - step)[0]) / (2 * step)
    np.testing.assert_allclose(run(1.0)[1], difference, rtol=1e-7)


def test_the_operator_is_its_own_transpose(case):
    inside = jnp.where(jnp.asarray(case.nodes), _weights(case), 0)
    factors = case.factors(case.conductance)

    def change(state):
        return conduct(case.operator, state, factors, case.layout)

    first = (inside * change(case.state)).sum()
    second = (case.state * change(inside)).sum()
    assert float(jnp.abs(first)) > 0.1
    np.testing.assert_allclose(first, second, rtol=1e-12)


def test_a_node_without_neighbours_passes_its_cotangent_on():
    case = _uniform()
    factors = case.factors(case.conductance)

    def step(state):
        return conduct_step(case.operator, state, factors, case.layout)

    _, pull = jax.vjp(step, case.state)
    assert pull(_weights(case))[0][1, 1, 1] == _weights(case)[1, 1, 1]
