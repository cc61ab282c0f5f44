"""Flows in loops that numba compiles are those in arrays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.flow.body import RoundBody
from jaxthermo.flow.channel import Channel
from jaxthermo.flow.flow import advance, flow_program, initial_state
from jaxthermo.flow.run import simulate_flow


SHAPE = (24, 40)
OPTIONS = {
    "body, open": {"body": RoundBody((12.0, 12.3), 7.0)},
    "heat": {"body": RoundBody((12.0, 12.3), 7.0), "diffusivity": 0.07},
    "force": {"ends": "periodic", "walls": "periodic", "force": (2e-4, -1e-4)},
    "heat and force": {
        "ends": "periodic",
        "walls": "no_slip",
        "force": (2e-4, 0.0),
        "diffusivity": 0.03,
    },
}


def channel(speed=0.05, viscosity=0.05, **options):
    return Channel(SHAPE, speed, viscosity, **options)


def state_after(program, steps=10):
    """From a disturbed state."""
    random = np.random.default_rng(5)
    u = random.uniform(-0.02, 0.02, (2, *SHAPE))
    state = initial_state(program, (u[0], u[1]), random.uniform(-0.01, 0.01, SHAPE))
    if state.heat is not None:
        warm = jnp.asarray(random.uniform(0, 0.1, state.heat[0].shape))
        warm = warm.astype(state.flow[0].dtype)
        state = state._replace(heat=tuple(g + warm for g in state.heat))
    weight = jnp.ones((), state.flow[0].dtype)
    return advance(program, state, None, weight, samples=1, stride=steps)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "dtype", "tolerance"),
    [
        pytest.param(
            channel_options,
            dtype,
            tolerance,
            id=f"{dtype}-{name}",
            marks=[pytest.mark.slice] * (name == "force" and dtype == "float64"),
        )
        for dtype, tolerance in (("float64", 1e-15), ("float32", 4e-7))
        for name, channel_options in OPTIONS.items()
    ],
)
def test_states_are_those_of_the_arrays(options, dtype, tolerance):
    pytest.importorskip("numba")
    in_loops, plain = (
        state_after(flow_program(channel(**options), dtype, kernels))
        for kernels in ("numba", None)
    )

    def compare(a, b):
        return np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)

    jax.tree.map(compare, in_loops, plain)
    assert max(float(abs(f).max()) for f in in_loops.flow) > 1e-3


@pytest.mark.slow
def test_derivatives_are_those_of_the_arrays_and_of_differences():
    pytest.importorskip("numba")

    def total(numbers, kernels="numba"):
        speed, viscosity, diffusivity = numbers
        options = OPTIONS["heat"] | {"diffusivity": diffusivity}
        program = flow_program(channel(speed, viscosity, **options), "float64", kernels)
        state = state_after(program, 4)
        assert state.heat is not None
        return (state.flow[1] ** 2).sum() + (state.heat[2] ** 2).sum()

    at = jnp.array([0.05, 0.06, 0.07])
    gradient = jax.jit(jax.grad(total))(at)
    np.testing.assert_allclose(gradient, jax.grad(total)(at, None), rtol=1e-10)
    for n in range(3):
        step = jnp.zeros(3).at[n].set(1e-6)
        difference = (total(at + step) - total(at - step)) / 2e-6
        np.testing.assert_allclose(gradient[n], difference, rtol=1e-5)


@pytest.mark.slow
def test_a_run():
    pytest.importorskip("numba")
    in_loops, plain = (
        simulate_flow(channel(**OPTIONS["heat"]), 80, dtype="float64", kernels=kernels)
        for kernels in ("numba", None)
    )
    np.testing.assert_allclose(in_loops.drag, plain.drag, rtol=1e-9)
    np.testing.assert_allclose(in_loops.heat, plain.heat, rtol=1e-9)
    np.testing.assert_allclose(in_loops.mean.speed, plain.mean.speed, atol=1e-13)


def test_other_kernels_are_one_line():
    with pytest.raises(InputError, match="'fast'.*leave it out"):
        simulate_flow(channel(), 20, kernels="fast")  # type: ignore
