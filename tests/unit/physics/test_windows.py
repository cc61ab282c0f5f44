"""Values in windows of time: late in a run, at jumps, and as lines of steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.arrays import split_times
from jaxthermo.physics.time_varying import value_at
from jaxthermo.physics.windows import (
    FunctionOfTime,
    PiecewiseLinear,
    Window,
    over,
    start_of_step,
    within,
)


def window(start: float, end: float, dtype=jnp.float32) -> Window:
    """Window between two times [s]."""
    return Window(
        jnp.asarray(split_times(start), dtype), jnp.asarray(end - start, dtype)
    )


def table(times, values) -> PiecewiseLinear:
    """Table at whose times steps end."""
    return jt.Table(times, values).piecewise(ends_steps=True)


@pytest.mark.parametrize(
    ("late", "width"), [(100.0, 1e-6), (3e6, 0.01), (3.2e7, 1e-4), (0.0, 1e-9)]
)
def test_intervals_that_float32_rounds_to_nothing_keep_their_lines(late, width):
    knots = [late, late + width, late + 3 * width]
    value = table(knots, [1.0, 2.0, -4.0])
    for begin, end, first, last in [
        (knots[0], knots[1], 1.0, 2.0),
        (knots[1], knots[2], 2.0, -4.0),
        (knots[2], knots[2] + width, -4.0, -4.0),
    ]:
        span = window(begin, end)
        local = jax.jit(over)(value, span)
        ends = jnp.stack([jnp.zeros_like(span.length), span.length])
        got = jax.vmap(lambda time, local=local: value_at(local, time))(ends)
        # 48 bits of the time, of which the interval has what is left.
        rounding = max(1e-6, 10 * late * 2.0**-48 / width)
        assert np.asarray(got) == pytest.approx([first, last], abs=6 * rounding)


def test_a_switch_holds_up_to_its_end_and_not_after():
    value = jt.Until(table([0.0, 6e6], [0.0, 6.0]), 3e6 + 0.01)
    before = over(value, window(3e6, 3e6 + 0.01))
    after = over(value, window(3e6 + 0.01, 3e6 + 0.02))
    assert float(value_at(before, jnp.float32(0.005))) == pytest.approx(3.0)
    assert float(value_at(after, jnp.float32(0.0))) == 0.0


def test_a_time_of_the_host_is_not_rounded():
    value = jt.Until(jt.Table([3e6, 3e6 + 0.01], [1.0, 3.0]), 3e6 + 0.01)
    assert float(value_at(value, np.float64(3e6 + 0.005))) == pytest.approx(2.0)
    assert float(value_at(value, np.float64(3e6 + 0.01))) == 0.0


def test_a_program_without_such_values_is_the_same_object():
    program = (jnp.ones(3), {"h": 2.0})
    assert over(program, window(0.0, 1.0)) is program


def _line_of(value, start: float, dt: float):
    in_step = within(
        over(value, window(0.0, 8.0)), jnp.float32([start, 0]), jnp.float32(dt)
    )
    return lambda fraction: float(value_at(in_step, jnp.float32(start + fraction * dt)))


@pytest.mark.parametrize(("start", "dt"), [(0.0, 8.0), (0.5, 1.0), (2.9, 0.3), (5, 2)])
def test_a_table_of_unknown_times_keeps_its_integral_in_every_step(start, dt):
    times = np.array([1.0, 3.0, 3.1, 6.0])
    values = np.array([2.0, 8.0, 0.0, 1.0])
    line = _line_of(jt.Table(jnp.asarray(times), values), start, dt)
    fine = start + dt * (np.arange(40_000) + 0.5) / 40_000
    exact = np.interp(fine, times, values)
    assert line(0.5) == pytest.approx(exact.mean(), rel=1e-5)
    # Nor does it leave the values within the step.
    assert exact.min() - 1e-3 <= min(line(0.0), line(1.0))
    assert max(line(0.0), line(1.0)) <= exact.max() + 1e-3


def test_a_function_keeps_its_integral_in_every_step():
    value = FunctionOfTime(lambda time: time**5)
    line = _line_of(value, 1.0, 2.0)
    assert line(0.5) == pytest.approx((3.0**6 - 1) / 6 / 2, rel=1e-5)


def test_the_integral_has_derivatives_by_the_times_of_a_table():
    def mean(switch_off):
        times = jnp.stack([switch_off, switch_off + 1e-3])
        value = jt.Table(times, [1.0, 0.0]).piecewise(ends_steps=False)
        local = over(value, window(0.0, 8.0))
        step = within(local, jnp.zeros(2, jnp.float32), jnp.float32(8.0))
        return value_at(step, jnp.float32(4.0))

    assert float(jax.grad(mean)(jnp.float32(3.0))) == pytest.approx(1 / 8, rel=1e-3)


def test_steps_of_a_window_leave_no_time_out():
    """A pulse of 1 ms at the border of any two steps has its integral."""
    dt = jnp.float32(0.7)

    def mean(number, value):
        # A line has its mean in the middle of the step, where its origin is.
        return within(value, start_of_step(number, dt), dt).value

    for number in (1, 100, 4000):
        begin = number * float(dt) - 4e-4
        times = begin + np.array([0.0, 0.0005, 0.001])
        table = jt.Table(times, [0.0, 1e3, 0.0]).piecewise(ends_steps=False)
        value = over(table, window(0.0, 2900.0))
        steps = jnp.array([number - 1, number], jnp.int32)
        means = jax.jit(jax.vmap(mean, (0, None)))(steps, value)
        assert float(means.sum() * dt) == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize("size", [2, 3, 4, 5, 9, 10, 16, 17, 100])
def test_a_window_has_the_line_of_its_piece_in_a_table_of_any_size(size):
    knots = np.arange(size, dtype=float)
    value = table(knots, knots**2)

    @jax.jit
    @jax.vmap
    def line_at(start):
        split = jnp.stack([start, jnp.zeros_like(start)])
        return over(value, Window(split, jnp.float32(0.5)))(jnp.float32(0.25))

    starts = np.arange(-1.0, size + 1, 0.5, dtype=np.float32)
    right = np.interp(starts + 0.25, knots, knots**2)
    assert np.asarray(line_at(starts)) == pytest.approx(right, abs=1e-3)
