"""The balance of implicit steps: far from the reference no digit of it is lost."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.physics.conduction import material_network
from tests.bodies import blocks


COLDER = -5499.9927
"""Than the reference, of nodes that are all equally warm [K]."""
SHAPE = (3, 4, 2)
_conduction = eqx.filter_jit(lambda network, state: network.face_heat_rate(state))
_heat_rate = eqx.filter_jit(lambda network, state: network.heat_rate(state))


def _network(conductivity, dtype):
    solid = np.ones(SHAPE, bool)
    solid[0, 0, 0] = False
    structure = jt.FullVolume(blocks(solid, 1e-3))
    material = jt.Material(conductivity, 2700.0, 900.0)
    network = material_network(
        structure, material=material, reference=5800.0, dtype=dtype
    )
    nodes = np.zeros(structure.state_shape, bool)
    nodes[structure.node_address()] = True
    return network, nodes


@pytest.mark.parametrize("conductivity", [200.0, (200.0, 50.0, 3.0)])
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_what_is_equally_warm_conducts_nothing_and_the_rest_as_ever(
    conductivity, dtype
):
    network, nodes = _network(conductivity, dtype)
    even = jnp.asarray(np.where(nodes, COLDER, 0), dtype)
    # One rounding of what they differ from the mean by, which is one of them.
    digit = abs(COLDER) * float(jnp.finfo(dtype).eps)
    rounding = 12 * 0.2 * digit * float(jnp.finfo(dtype).eps)
    assert np.abs(_conduction(network, even)).max() <= rounding
    random = np.random.default_rng(0).uniform(-1, 1, nodes.shape)
    uneven = jnp.asarray(np.where(nodes, random, 0), dtype)
    np.testing.assert_allclose(
        _conduction(network, uneven),
        _heat_rate(network, uneven),
        rtol=0,
        atol=20 * 0.2 * float(jnp.finfo(dtype).eps),
    )


@pytest.mark.parametrize(
    "dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
def test_a_long_step_ends_at_the_lumped_balance(dtype):
    """C (T_0 - T) = dt eps sigma A (T^4 - T_s^4), in 14 to 16 steps from above."""
    structure = jt.FullVolume(blocks(np.ones((2, 2, 2), bool), 1e-3))
    metal = jt.Material(200.0, 2700.0, 900.0, emissivity=1.0)
    body = jt.Body(structure, metal, temperature=5800.0)
    scene = jt.Scene((body,), (jt.Surroundings(300.0),), dtype=dtype)
    dt = 1e8
    capacity = 2700.0 * 900.0 * 8e-9
    area = 24e-6
    run = jt.simulate(scene, dt, solver=jt.BackwardEuler(dt=dt), throw=False)
    excess = capacity * 5500.0 / (dt * area * 5.670374419e-8 * 4 * 300.0**3)
    excess_reached = float(run.mean_temperature[-1, 0]) - 300.0
    effort = run.run.statistics
    assert effort is not None
    print(dtype, excess_reached, excess, int(effort.newton_iterations), run.result)
    assert run.result == jt.RESULTS.successful
    assert int(effort.newton_iterations) <= 16
    # One rounding of 5500 K in float32 is 5e-4 K.
    np.testing.assert_allclose(
        excess_reached, excess, atol=1e-6 if dtype == "float64" else 1e-3
    )
