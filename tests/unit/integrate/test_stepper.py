"""Loops over steps: two a turn, and reverse mode whatever of the steps it keeps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate import stepper as module
from jaxthermo.integrate.run.plan import initial_state, plan_run
from jaxthermo.integrate.run.step_loop import Span, advance
from jaxthermo.physics.windows import Window
from tests.bodies import blocks


STEPS = 5
DT = 0.5


@pytest.fixture(scope="module")
def value():
    """The weighted end of a run by k and the emissivity; how it is advanced, given."""
    structure = jt.FullVolume(blocks(np.ones((3, 2, 2), bool), 0.01))

    def run(values, loop):
        k, emissivity = values
        material = jt.Material(
            k, density=8000.0, specific_heat=500.0, emissivity=emissivity
        )
        body = jt.Body(structure, material, temperature=350.0)
        terms = jt.Convection(25.0, 280.0), jt.Surroundings(290.0)
        scene = jt.Scene((body,), terms, dtype="float64")
        todo = plan_run(
            scene, t1=STEPS * DT, save_at=None, solver=jt.ForwardEuler(dt=DT)
        )
        end = loop(
            todo.stepper, todo.compiled.program, initial_state(todo), jnp.array(DT)
        )
        theta = end.theta[0]
        return (jnp.arange(float(theta.size)).reshape(theta.shape) * theta**2).sum()

    return run


def _plain(stepper, program, state, dt):
    """Step after step, without a loop or a choice of what is kept."""
    for i in range(STEPS):
        state = stepper.step(program, state, dt * i, dt)
    return state


def _kept(checkpoints):
    def loop(stepper, program, state, dt):
        window = Window(jnp.zeros(2, dt.dtype), STEPS * dt)
        span = Span(window, dt=dt, steps=STEPS)
        return advance(
            stepper, program=program, state=state, span=span, checkpoints=checkpoints
        )

    return loop


VALUES = jnp.array([16.0, 0.7])


@pytest.mark.parametrize(
    "checkpoints",
    [
        pytest.param(None, marks=pytest.mark.slow),
        2,
        pytest.param(STEPS, marks=pytest.mark.slow),
    ],
)
def test_reverse_mode_is_that_of_the_plain_steps(value, checkpoints):
    gradient = jax.jit(jax.grad(lambda v: value(v, _kept(checkpoints))))(VALUES)
    expected = jax.jit(jax.grad(lambda v: value(v, _plain)))(VALUES)
    np.testing.assert_allclose(gradient, expected, rtol=1e-11)


# By default reverse mode is that of the plain steps, above, and of differences and
# forward mode in test_gradients.
@pytest.mark.slow
def test_reverse_mode_is_the_central_difference(value):
    run = jax.jit(lambda v: value(v, _kept(None)))
    gradient = jax.jit(jax.grad(run))(VALUES)
    steps = 1e-5 * VALUES
    for i, step in enumerate(steps):
        move = jnp.zeros(2).at[i].set(step)
        difference = (run(VALUES + move) - run(VALUES - move)) / (2 * step)
        np.testing.assert_allclose(gradient[i], difference, rtol=1e-6)


@pytest.mark.slow
def test_forward_mode_is_reverse_mode(value):
    def run(v):
        return value(v, _kept(None))

    forward = jax.jit(jax.jacfwd(run))(VALUES)
    np.testing.assert_allclose(forward, jax.jit(jax.grad(run))(VALUES), rtol=1e-11)


@pytest.mark.parametrize(
    "solver",
    [jt.ForwardEuler(dt=DT), jt.SuperTimeStepping(dt=STEPS * DT, stages=7)],
    ids=type,
)
def test_two_steps_a_turn_are_one_after_the_other(monkeypatch, solver):
    """Large states exchange two buffers, small ones are copied after each step."""
    structure = jt.FullVolume(blocks(np.ones((3, 2, 2), bool), 0.01))
    material = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.7)
    body = jt.Body(structure, material, temperature=350.0)
    scene = jt.Scene((body,), (jt.Surroundings(290.0),), dtype="float64")
    plan = plan_run(scene, t1=STEPS * DT, save_at=None, solver=solver)
    start = initial_state(plan)
    dt = jnp.array(DT)
    window = Window(jnp.zeros(2), STEPS * dt)
    end_states = []
    for few in (module._FEW_VALUES, 0):
        monkeypatch.setattr(module, "_FEW_VALUES", few)
        # A function of its own: one program for both would be found again.
        end = jax.jit(
            lambda state, n: advance(
                plan.stepper, plan.compiled.program, state, Span(window, dt, steps=n)
            )
        )(start, jnp.array(STEPS))
        end_states.append(end)
    copied, exchanged = end_states
    assert np.ptp(copied.theta[0]) > 0.01
    np.testing.assert_allclose(copied.theta[0], exchanged.theta[0], rtol=1e-13)
    np.testing.assert_allclose(copied.ledger.heat, exchanged.ledger.heat, rtol=1e-12)


def test_one_state_a_step_is_kept():
    """Of a cheap step; what its loads are made of is not."""
    structure = jt.FullVolume(blocks(np.ones((6, 6, 6), bool), 0.01))

    def mean(emissivity, steps):
        material = jt.Material(
            16.0, density=8000.0, specific_heat=500.0, emissivity=emissivity
        )
        body = jt.Body(structure, material, temperature=350.0)
        scene = jt.Scene((body,), (jt.Surroundings(290.0),), dtype="float64")
        solution = jt.simulate(scene, steps * DT, solver=jt.ForwardEuler(dt=DT))
        return solution.surface_temperature.mean()

    sizes = []
    for n in (20, 120):
        call = jax.jit(lambda e, n=n: jax.grad(mean)(e, n)).lower(jnp.array(0.7))
        report = call.compile().memory_analysis()
        assert report is not None
        sizes.append(report.temp_size_in_bytes)
    state = 8 * 8 * 8 * 8
    # The state, and the ledger's few numbers.
    assert sizes[1] - sizes[0] < 1.2 * 100 * state
