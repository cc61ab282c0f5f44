"""Weights by class of link, capacity by level under a fixed total, and gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.physics.conduction import _link_weights, assemble_uniform
from tests.bodies import blocks


K = 16.0
HEAT = 4e6
PITCH = 0.01
METAL = jt.Material(K, density=8000.0, specific_heat=500.0)


@pytest.fixture(scope="module")
def grid():
    return blocks(np.ones((10, 9, 11), bool), PITCH)


def _classes(structure):
    links = structure.links()
    level = structure.nodes().level
    outside = np.zeros(structure.node_count, bool)
    outside[structure.fragment_node()] = True
    low = np.minimum(level[links.src], level[links.dst])
    crosses = level[links.src] != level[links.dst]
    return low, crosses, outside[links.src] | outside[links.dst]


@pytest.mark.parametrize("structure_name", ["octree", "core", "levels"])
def test_every_link_takes_the_weights_of_its_classes(grid, structure_name):
    within = {"octree": [2.0, 3.0], "core": [2.0, 3.0], "levels": [2.0, 3.0, 5.0]}[
        structure_name
    ]
    between = np.arange(7.0, 7.0 + len(within) - 1)
    weights = jt.ConductionWeights(within=within, between=between, surface=0.5)
    structure = {
        "octree": lambda: jt.Octree(grid, levels=2, weights=weights),
        "core": lambda: jt.ShellOverCore(grid, weights=weights),
        "levels": lambda: jt.MultiLevel(grid, levels=3, weights=weights),
    }[structure_name]()
    low, crosses, touches = _classes(structure)
    assert crosses.any()
    assert (~crosses).any()
    exact = np.array(
        [
            (between[n] if c else within[n]) * (0.5 if t else 1.0)
            for n, c, t in zip(low, crosses, touches, strict=True)
        ]
    )
    np.testing.assert_allclose(_link_weights(structure, jnp.float64), exact)


def test_weights_of_one_change_nothing(grid):
    """Lists of ones run the weighted path, and give the plain two-point flux."""
    plain = jt.Octree(grid, levels=2)
    listed = jt.Octree(
        grid, levels=2, weights=jt.ConductionWeights(within=[1.0, 1.0 + 1e-15])
    )
    assert plain.weights.are_one
    assert not listed.weights.are_one
    first, second = (assemble_uniform(s, K, HEAT, jnp.float64) for s in (plain, listed))
    state = jnp.asarray(np.random.default_rng(0).normal(size=plain.node_count))
    np.testing.assert_allclose(
        first.heat_rate(state), second.heat_rate(state), rtol=1e-10, atol=1e-10
    )


def test_capacity_moves_between_levels_and_its_total_stays(grid):
    structure = jt.ShellOverCore(
        grid, weights=jt.ConductionWeights(capacity=[2.0, 1.0])
    )
    plain = assemble_uniform(jt.ShellOverCore(grid), K, HEAT, jnp.float64).capacity()
    moved = assemble_uniform(structure, K, HEAT, jnp.float64).capacity()
    assert float(moved.sum()) == pytest.approx(float(plain.sum()), rel=1e-13)
    fine = structure.nodes().level == 0
    ratio = np.asarray(moved / plain)
    assert ratio[fine][0] == pytest.approx(2.0 * ratio[~fine][0], rel=1e-12)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"within": -1.0}, "at least 0"),
        ({"within": [1.0, np.nan]}, "finite"),
        ({"capacity": 0.0}, "above 0"),
        ({"non_orthogonal": 3.0}, "from -1 to 2"),
        ({"surface": [1.0, 2.0]}, "one number"),
        ({"between": "much"}, "finite numbers"),
        ({"within": [[1.0]]}, "one a level"),
    ],
)
def test_mistakes_are_told(weights, message):
    with pytest.raises(jt.InputError, match=message):
        jt.ConductionWeights(**weights)


@pytest.mark.parametrize("field", ["within", "between", "capacity"])
def test_the_wrong_number_of_levels_is_told(grid, field):
    weights = jt.ConductionWeights(**{field: [1.0, 2.0, 3.0, 4.0]})
    structure = jt.ShellOverCore(grid, weights=weights)
    with pytest.raises(jt.InputError, match=f"{field} has 4 values"):
        assemble_uniform(structure, K, HEAT, jnp.float64)


def _surface_mean(structure):
    sun = jt.HeatFlux(1e4, on=jt.Side((1.0, 0.0, 0.0)))
    body = jt.Body(structure, METAL, temperature=300.0)
    scene = jt.Scene((body,), (sun, jt.Convection(20.0, 290.0)), dtype="float64")
    solution = jt.simulate(scene, 4.0, solver=jt.ForwardEuler(dt=0.5))
    return (solution.surface_temperature[0] ** 2).mean()


@pytest.mark.parametrize(
    "mode", [pytest.param("forward", marks=pytest.mark.slow), "reverse"]
)
def test_gradients_reach_every_weight(grid, mode):
    def loss(values):
        weights = jt.ConductionWeights(
            within=values[:2],
            between=values[2:3],
            surface=values[3],
            capacity=values[4:6],
            surface_distance=values[6],
        )
        return _surface_mean(jt.ShellOverCore(grid, weights=weights))

    at = np.array([1.0, 1.1, 0.9, 1.2, 1.3, 0.8, 1.0])
    step = 1e-5

    def forward(values):
        return loss(values), jax.jacfwd(loss)(values)

    value_and_gradient = jax.jit(
        forward if mode == "forward" else jax.value_and_grad(loss)
    )
    gradient = np.asarray(value_and_gradient(at)[1])
    for i, by in enumerate(step * np.eye(len(at))):
        exact = float(
            value_and_gradient(at + by)[0] - value_and_gradient(at - by)[0]
        ) / (2 * step)
        assert gradient[i] == pytest.approx(exact, rel=1e-5, abs=1e-5), i
    assert (np.abs(gradient) > 1e-4).all()
