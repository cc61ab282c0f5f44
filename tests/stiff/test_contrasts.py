"""Materials far apart, side by side (S01, S02): bounds hold and heat is kept."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.physics.conduction import materials_network
from tests.bodies import blocks


AEROGEL = jt.Material(0.013, density=100.0, specific_heat=1000.0)
DIAMOND = jt.Material(2000.0, density=3510.0, specific_heat=508.0)
PAIRS = {
    "conductivity 1.5e5": (AEROGEL, DIAMOND),
    "capacity 3e3": (
        jt.Material(0.026, density=1.18, specific_heat=1006.0),
        jt.Material(401.0, density=8960.0, specific_heat=385.0),
    ),
    "capacity 1e6": (jt.Material(1.0, 1.0, 1.0), jt.Material(1.0, 1e3, 1e3)),
}
SHAPE = (8, 8, 8)


def _number(pattern):
    x, y, z = np.indices(SHAPE)
    return {"laminate": x % 2, "checkerboard": (x + y + z) % 2}[pattern]


@eqx.filter_jit
def _run(network, state):
    dt = 1 / network.max_rate()

    def step(_, state):
        return network.euler_step(state, dt)

    end_state = jax.lax.fori_loop(0, 400, step, state)
    return end_state, network.stored(end_state - state)


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
@pytest.mark.parametrize("pattern", ["laminate", "checkerboard"])
@pytest.mark.parametrize("pair", PAIRS)
def test_bounds_hold_and_heat_is_kept(pair, pattern, dtype):
    structure = jt.FullVolume(blocks(np.ones(SHAPE, bool), 1e-3))
    number = _number(pattern).reshape(-1).astype(np.int32)
    network = materials_network(
        structure, number=number, materials=PAIRS[pair], reference=300.0, dtype=dtype
    )
    # The half of the body from 0 to 4 along y is 100 K warmer.
    theta = np.zeros(structure.state_shape, dtype)
    theta[1:-1, 1:5, 1:-1] = 100.0
    end_state, drift = _run(network, jnp.asarray(theta))
    heat = network.stored(jnp.asarray(theta))
    temperature = np.asarray(end_state[structure.node_address()], float)
    exact = dtype == jnp.float64
    assert np.abs(temperature - theta[structure.node_address()]).max() > 0.1
    assert abs(float(drift)) < (1e-12 if exact else 1e-4) * float(heat)
    over = max(temperature.max() - 100.0, -temperature.min())
    print(f"{pair}, {pattern}: over {over:.2g} K, drift {float(drift / heat):.2g}")
    assert over < (1e-9 if exact else 5e-3)
