"""Collision and streaming: the textbook's step, closed forms, order, conservation."""

import functools

import jax
import numpy as np
import pytest

from jaxthermo.flow.channel import Channel
from jaxthermo.flow.flow import advance, fields, flow_program, initial_state
from jaxthermo.flow.lattice import MAGIC, flow_rates, textbook_step


def box(shape, viscosity, **options):
    """Periodic in both directions unless told otherwise."""
    return Channel(
        shape, 0.0, viscosity, **{"walls": "periodic", "ends": "periodic", **options}
    )


def after(program, state, steps):
    """State after an even number of steps."""
    return advance(program, state, None, 0.0, samples=1, stride=steps)[0]


def vortices(count, speed, program):
    """Taylor and Green's vortices, with their pressure."""
    k = 2 * np.pi / count
    y, x = (np.indices((count, count)) + 0.5) * k
    u = -speed * np.cos(x) * np.sin(y), speed * np.sin(x) * np.cos(y)
    pressure = -(speed**2) / 4 * (np.cos(2 * x) + np.cos(2 * y))
    return u, initial_state(program, u, 3 * pressure)


@pytest.mark.parametrize("force", [None, (2e-4, -1e-4)])
def test_a_step_is_that_of_the_textbook(force):
    program = flow_program(box((6, 8), 0.07, force=force), "float64")
    random = np.random.default_rng(1)
    u = random.uniform(-0.05, 0.05, (2, 6, 8))
    state = initial_state(program, (u[0], u[1]), random.uniform(-0.01, 0.01, (6, 8)))
    plain = np.stack([f[1:-1, 1:-1] for f in state.flow])
    state = after(program, state, 6)
    step = jax.jit(lambda f: textbook_step(f, flow_rates(0.07, MAGIC), force))
    for _ in range(6):
        plain = step(plain)
    populations = np.stack([f[1:-1, 1:-1] for f in state.flow])
    np.testing.assert_allclose(populations, plain, atol=1e-15)


@functools.cache
def parabola(viscosity, magic):
    """Largest error of the flow between two walls, over its highest speed."""
    height = 8
    top = 0.05
    force = 8 * viscosity * top / height**2
    channel = box(
        (height, 4), viscosity, walls="no_slip", force=(force, 0.0), magic=magic
    )
    program = flow_program(channel, "float64")
    state = after(program, initial_state(program), 2 * round(250 / viscosity))
    y = (np.arange(height) + 0.5) / height
    exact = 4 * top * y * (1 - y)
    speed = np.asarray(fields(program, state).x)
    return np.abs(speed - exact[:, None]).max() / top


@pytest.mark.parametrize("viscosity", [0.2, 0.5])
def test_the_flow_between_walls_is_exact_at_the_magic_parameter(viscosity):
    assert parabola(viscosity, MAGIC) < 1e-10


def test_at_another_magic_parameter_the_walls_lie_elsewhere():
    assert parabola(0.5, 0.5) > 1e-3


def vortex_error(count):
    """Relative error after the vortices have lost about half of their speed."""
    viscosity = 0.05
    speed = 0.64 / count
    program = flow_program(box((count, count), viscosity), "float64")
    u, state = vortices(count, speed, program)
    steps = round(count**2 / 12)
    steps += steps % 2
    left = np.exp(-2 * viscosity * (2 * np.pi / count) ** 2 * steps)
    end = fields(program, after(program, state, steps))
    error = np.hypot(end.x - left * u[0], end.y - left * u[1])
    return error.max() / (left * speed), left


def test_vortices_decay_with_the_second_order():
    errors = [vortex_error(count) for count in (12, 24, 48)]
    assert all(0.4 < left < 0.8 for _, left in errors)
    order = np.diff(np.log2([error for error, _ in errors]))
    np.testing.assert_allclose(order, -2, atol=0.15)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_mass_is_conserved_over_many_steps(dtype):
    program = flow_program(box((8, 8), 0.02), dtype)
    random = np.random.default_rng(2).uniform(-0.05, 0.05, (2, 8, 8))
    state = initial_state(program, (random[0], random[1]))

    def mass(s):
        return 64 + 3 * np.asarray(fields(program, s).pressure, float).sum()

    first_mass = mass(state)
    assert abs(mass(after(program, state, 10_000)) / first_mass - 1) < 1e-6


def test_float32_is_as_precise_as_the_deviation_from_rest():
    """Speeds far below the precision of populations near 1."""

    def speeds(dtype):
        program = flow_program(box((12, 12), 0.05), dtype)
        _, state = vortices(12, 1e-6, program)
        return np.asarray(fields(program, after(program, state, 12)).x, float)

    np.testing.assert_allclose(speeds("float32"), speeds("float64"), atol=1e-11)
