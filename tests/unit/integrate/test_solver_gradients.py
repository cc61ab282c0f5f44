"""Derivatives through every solver: forward, reverse, and reverse from checkpoints."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.scene.motion import Motion, PoseTable
from tests.bodies import blocks


END = 80.0
START = jnp.array([1.0, 10.0, 0.9, 1500.0])
"""k, h, emissivity, and a pulse of sun that is long over at the end."""

SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=5.0),
    "SuperTimeStepping": jt.SuperTimeStepping(dt=20.0, stages=5),
    "BackwardEuler": jt.BackwardEuler(dt=20.0),
    "CrankNicolson": jt.CrankNicolson(dt=20.0),
    "TRBDF2": jt.TRBDF2(dt=20.0),
}


@functools.cache
def _structure():
    return jt.FullVolume(blocks(np.ones((3, 2, 2), bool), 0.01))


def _loss(values, solver, memory=None, saves=None):
    k, h, emissivity, sun = values
    material = jt.Material(
        k, density=2000.0, specific_heat=800.0, emissivity=emissivity
    )
    body = jt.Body(_structure(), material, temperature=300.0)
    terms = (
        jt.Sun((1.0, 0.0, 0.0), jt.Until(sun, 40.0)),
        jt.Convection(h, 290.0),
        jt.Surroundings(280.0),
    )
    scene = jt.Scene((body,), terms, dtype="float64")
    run = jt.simulate(scene, END, saves, solver=solver, reverse_memory=memory)
    return (run.surface_temperature[-1] ** 2).mean() / 1e4


def _numeric(loss):
    """Central differences."""
    step = 1e-5

    def at(i, sign):
        return loss(START.at[i].multiply(1 + sign * step))

    pairs = [(at(i, 1) - at(i, -1)) / (2 * step * START[i]) for i in range(len(START))]
    return np.array(pairs)


# By default test_gradients differentiates explicit steps, and in the slice test_steady
# differentiates a solution of the implicit equations.
@pytest.mark.slow
@pytest.mark.parametrize("name", SOLVERS)
def test_forward_and_reverse_agree_with_differences(name):
    loss = jax.jit(functools.partial(_loss, solver=SOLVERS[name]))
    numeric = _numeric(loss)
    reverse = jax.jit(jax.grad(loss))(START)
    forward = jax.jit(jax.jacfwd(loss))(START)
    print(name, numeric, np.abs(reverse / numeric - 1), np.abs(forward / numeric - 1))
    assert (np.abs(numeric) > 1e-9).all()
    np.testing.assert_allclose(reverse, numeric, rtol=1e-5)
    np.testing.assert_allclose(forward, reverse, rtol=1e-6)


def _two_bodies(values, solver, saves):
    k, h, contact, flux = values
    materials = [
        jt.Material(conductivity, density=2000.0, specific_heat=800.0)
        for conductivity in (k, 2 * k)
    ]
    bodies = [
        jt.Body(_structure(), material, temperature=t, pose=jt.Pose((x, 0.0, 0.0)))
        for material, t, x in zip(materials, (300.0, 320.0), (0.0, 0.03), strict=True)
    ]
    terms = (
        jt.Convection(h, 290.0),
        jt.Contact(contact),
        jt.Surroundings(280.0),
        jt.HeatFlux(flux, on=jt.Side((-1.0, 0.0, 0.0))),
    )
    scene = jt.Scene(tuple(bodies), terms, dtype="float64")
    run = jt.simulate(scene, saves[-1], saves, solver=solver)
    return (run.surface_temperature[-1] ** 2).mean() / 1e4


SAVES = (5.0, 10.0, 30.0, 32.0, 80.0)


@pytest.mark.parametrize(
    "solver",
    [
        jt.ForwardEuler(dt=2.0),
        *(
            pytest.param(solver(dt=5.0, tolerance=1e-12), marks=pytest.mark.slow)
            for solver in (jt.BackwardEuler, jt.CrankNicolson, jt.TRBDF2)
        ),
    ],
)
def test_two_bodies_saved_at_uneven_times_have_the_gradient_of_differences(solver):
    start = jnp.array([10.0, 10.0, 200.0, 1500.0])
    loss = jax.jit(functools.partial(_two_bodies, solver=solver, saves=SAVES))
    gradient = jax.jit(jax.grad(loss))(start)
    numeric = [
        (loss(start + step) - loss(start - step)) / (2 * step.sum())
        for step in jnp.diag(1e-4 * start)
    ]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6)


def test_a_program_does_not_grow_with_the_number_of_save_times():
    def equations(saves):
        times = tuple(np.linspace(60.0 / saves, 60.0, saves).tolist())
        solver = jt.BackwardEuler(dt=1.0)
        loss = functools.partial(_loss, solver=solver, saves=times)
        return str(jax.make_jaxpr(loss)(START)).count(" = ")

    assert equations(12) <= 1.01 * equations(3)


def _turning(values, every):
    k, sun = values
    material = jt.Material(k, density=2000.0, specific_heat=800.0)
    path = PoseTable((0.0, 60.0), (jt.Pose(), jt.Pose.about((0, 0, 1), 2 * np.pi)))
    body = jt.Body(
        _structure(), material, temperature=300.0, pose=Motion(path, every=every)
    )
    terms = (jt.Sun((1.0, 0.0, 0.0), sun), jt.Convection(10.0, 290.0))
    scene = jt.Scene((body,), terms, dtype="float64")
    run = jt.simulate(scene, 60.0, [25.0, 60.0], solver=jt.ForwardEuler(dt=5.0))
    return (run.surface_temperature**2).mean() / 1e4


def test_a_turning_body_has_one_program_and_the_gradient_of_differences():
    start = jnp.array([1.0, 1000.0])
    loss = functools.partial(_turning, every=10.0)
    more_snapshots = functools.partial(_turning, every=2.0)

    def equations(loss):
        return str(jax.make_jaxpr(loss)(start)).count("scan[")

    assert equations(more_snapshots) == equations(loss)
    value = jax.jit(loss)
    numeric = [
        (value(start + step) - value(start - step)) / (2 * step.sum())
        for step in jnp.diag(1e-4 * start)
    ]
    np.testing.assert_allclose(jax.jit(jax.grad(loss))(start), numeric, rtol=1e-6)
    # Where numbers are known each snapshot has a program of its own.
    np.testing.assert_allclose(loss(start), value(start), rtol=1e-12)


def _taylor(loss, gradient):
    """Log-log slope of what a gradient leaves, along one direction."""
    direction = START * jnp.array([0.3, -0.5, 0.2, 0.4])
    slope = gradient @ direction
    sizes = np.array([1e-2, 5e-3, 2.5e-3])

    def along(e):
        return float(loss(START + e * direction) - loss(START) - e * slope)

    left = [abs(along(e)) for e in sizes]
    return np.diff(np.log(left)) / np.diff(np.log(sizes))


@pytest.mark.parametrize(
    "states", [pytest.param(n, marks=pytest.mark.slow) for n in (1, 4)]
)
def test_checkpoints_give_the_same_gradient_and_it_is_of_first_order(states):
    solver = SOLVERS["ForwardEuler"]
    size = 8 * int(np.prod(_structure().state_shape))
    loss = jax.jit(functools.partial(_loss, solver=solver))
    checkpointed_loss = functools.partial(_loss, solver=solver, memory=states * size)
    gradient = jax.jit(jax.grad(checkpointed_loss))(START)
    np.testing.assert_allclose(gradient, jax.jit(jax.grad(loss))(START), rtol=1e-12)
    np.testing.assert_allclose(_taylor(loss, gradient), 2.0, atol=0.05)


def test_no_room_for_a_state_is_said():
    with pytest.raises(
        jt.InputError, match="reverse_memory=10 bytes is less than one state"
    ):
        _loss(START, SOLVERS["ForwardEuler"], 10)


@pytest.mark.slow
def test_adaptive_steps_have_a_gradient_from_checkpoints():
    solver = jt.TRBDF2(error=1e-4)
    loss = jax.jit(functools.partial(_loss, solver=solver))
    checkpointed_loss = functools.partial(_loss, solver=solver, memory=100_000)
    reverse = jax.jit(jax.grad(checkpointed_loss))(START)
    # Steps are taken as given: what their choice changes is of the error's size.
    np.testing.assert_allclose(reverse, _numeric(loss), rtol=2e-3)
