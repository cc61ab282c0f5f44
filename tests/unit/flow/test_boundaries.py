"""Walls, inlet, outlet and body: balances of momentum and heat, waves that leave."""

import jax
import numpy as np
import pytest

from jaxthermo.flow.body import RoundBody
from jaxthermo.flow.channel import Channel
from jaxthermo.flow.flow import (
    advance,
    fields,
    flow_program,
    initial_state,
)


def after(program, state, steps, samples=1):
    return advance(program, state, None, 0.0, samples=samples, stride=steps)


def square(shape, low, high):
    mask = np.zeros(shape, bool)
    mask[low:high, low:high] = True
    return mask


@pytest.mark.parametrize("walls", ["slip", "periodic"])
def test_an_even_flow_stays_even(walls):
    program = flow_program(Channel((6, 12), 0.05, 0.1, walls=walls), "float64")
    end = fields(program, after(program, initial_state(program), 200)[0])
    np.testing.assert_allclose(end.x, 0.05, rtol=1e-12)
    np.testing.assert_allclose([end.y, end.pressure], 0.0, atol=1e-14)


def test_a_parabola_stays_one_up_to_the_outlet():
    channel = Channel((10, 30), 0.02, 0.2, inlet="poiseuille", walls="no_slip")
    program = flow_program(channel, "float64")
    end = fields(program, after(program, initial_state(program), 20_000)[0])
    y = (np.arange(10) + 0.5) / 10
    exact = y * (1 - y) * 0.02 / (y * (1 - y)).mean()
    # The inlet's own cells are not exact: the boundary is not that of a shear flow.
    np.testing.assert_allclose(end.x[:, 15:].T, np.tile(exact, (15, 1)), rtol=1e-4)
    slope = np.diff(np.asarray(end.pressure)[5, 15:])
    np.testing.assert_allclose(slope, -8 * 0.2 * exact.max() / 99.0, rtol=2e-3)
    # As much flows out as in.
    np.testing.assert_allclose(end.x.sum(0), 0.2, rtol=1e-6)


@pytest.mark.parametrize("speed", [0.0, 0.06])
def test_a_wave_leaves_through_the_outlet(speed):
    program = flow_program(Channel((4, 120), speed, 0.01), "float64")
    x = np.arange(120) - 60.0
    pulse = 1e-4 * np.exp(-(x**2) / 50) * np.ones((4, 1))
    uniform = speed + 0 * pulse
    # Moving to the right alone: the speed of the air in it is r times the wave's own.
    ahead = speed + np.sqrt(speed**2 + 1 / 3)
    state = initial_state(program, (uniform + ahead * pulse, 0.0), pulse)
    rests = []
    for _ in range(20):
        state = after(program, state, 10)[0]
        rests.append(np.abs(np.asarray(fields(program, state).pressure)).max())
    assert rests[5] > 2e-5
    assert max(rests[-6:]) < 0.02 * 1e-4 / 3


def test_the_drag_of_a_body_is_the_force_on_the_fluid_in_a_steady_flow():
    shape = (12, 16)
    force = 1e-5
    body = square(shape, 4, 8)
    channel = Channel(
        shape=shape,
        speed=0.0,
        viscosity=0.4,
        body=body,
        walls="slip",
        ends="periodic",
        force=(force, 0.0),
    )
    program = flow_program(channel, "float64")
    *_, read = after(program, initial_state(program), 3000)
    fluid = shape[0] * shape[1] - body.sum()
    np.testing.assert_allclose(read.force[-1], [force * fluid, 0.0], atol=1e-9)


# By default the drag of a square is the force on the fluid, of a cylinder the one of
# Schaefer and Turek.
@pytest.mark.slow
def test_a_cylinder_feels_the_same_force_wherever_cells_lie():
    """The interpolated surface; a mask of cells differs by its steps."""
    drags = []
    for shift in (0.0, 0.3):
        body = RoundBody((12 + shift, 12.0), 9.3)
        channel = Channel(
            shape=(24, 24), speed=0.02, viscosity=0.1, body=body, walls="periodic"
        )
        program = flow_program(channel, "float64")
        *_, read = after(program, initial_state(program), 1500)
        drags.append(float(read.force[-1, 0]))
        assert abs(float(read.force[-1, 1])) < 1e-9
    assert drags[0] == pytest.approx(drags[1], rel=0.01) and drags[0] > 0


@pytest.mark.parametrize(
    "round_body",
    [pytest.param(False, marks=pytest.mark.slow), True],
)
def test_the_heat_of_a_body_is_what_the_fluid_gains(round_body):
    shape = (14, 16)
    cylinder = RoundBody((7.2, 6.9), 5.0)
    mask = cylinder.mask(shape) if round_body else square(shape, 5, 9)
    channel = Channel(
        shape=shape,
        speed=0.0,
        viscosity=0.1,
        body=cylinder if round_body else mask,
        walls="slip",
        ends="periodic",
        diffusivity=0.15,
    )
    program = flow_program(channel, "float64")
    state = initial_state(program)
    gains = []
    heats = []
    # A sample is of the next step's heat: of every two steps one is missing.
    for _ in range(60):
        state, _, read = after(program, state, 2)
        heats.append(float(read.heat[-1]))
        temperature = np.asarray(fields(program, state).temperature)
        gains.append(temperature[~mask].sum())
    rates = np.diff(gains) / 2
    np.testing.assert_allclose(rates[20:], heats[20:-1], rtol=0.02)
    assert rates[-1] > 0


# Ten seconds, of which six compile the reverse mode: the only one of a flow.
@pytest.mark.slow
@pytest.mark.slice
def test_gradients_by_speed_and_viscosity_are_right():
    @jax.jit
    @jax.value_and_grad
    def drag(numbers):
        channel = Channel(
            shape=(16, 24),
            speed=numbers[0],
            viscosity=numbers[1],
            body=RoundBody((8.0, 8.2), 5.3),
            walls="slip",
        )
        program = flow_program(channel, "float64")
        return after(program, initial_state(program), 20, samples=3)[2].force[-1, 0]

    at = np.array([0.04, 0.05])
    step = 1e-5
    slope = drag(at)[1]
    for i, by in enumerate(step * np.eye(2)):
        rise = (drag(at + by)[0] - drag(at - by)[0]) / (2 * step)
        assert float(slope[i]) == pytest.approx(float(rise), rel=1e-6)
