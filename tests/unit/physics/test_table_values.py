"""`Table`: linear between its times, constant beyond them, and without a loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt


TIMES = [0.5, 1.0, 4.0, 4.5]
VALUES = [3.0, -1.0, 2.0, 2.0]
AT = np.array([0.0, 0.5, 0.75, 1.0, 1.3, 3.999, 4.0, 4.2, 4.5, 9.0])


def test_a_table_is_linear_between_its_times():
    values = jax.jit(jax.vmap(jt.Table(TIMES, VALUES)))(jnp.asarray(AT))
    assert np.asarray(values) == pytest.approx(np.interp(AT, TIMES, VALUES), abs=1e-14)


def test_a_table_of_one_time_is_constant():
    assert float(jt.Table([3.0], [7.0])(jnp.asarray(1.0))) == 7.0


def test_derivatives_of_a_table_are_its_slopes():
    by_time = jax.jit(jax.vmap(jax.grad(jt.Table(TIMES, VALUES))))
    slopes = by_time(jnp.array([0.1, 0.6, 2.0, 4.1, 7.0]))
    assert np.asarray(slopes) == pytest.approx([0.0, -8.0, 1.0, 0.0, 0.0], abs=1e-14)
    by_value = jax.jit(jax.grad(lambda v: jt.Table(TIMES, v)(jnp.asarray(2.0))))
    assert np.asarray(by_value(jnp.asarray(VALUES))) == pytest.approx(
        [0.0, 2 / 3, 1 / 3, 0.0]
    )


def test_a_table_is_looked_up_without_a_loop():
    # XLA fails on a GPU where a loop of fixed length holds one whose result is an
    # index, as of `jnp.interp`.
    table = jt.Table(np.arange(100.0), np.arange(100.0))
    lowered = jax.jit(lambda time: table(time)).lower(jnp.asarray(1.0))
    assert "while" not in lowered.as_text()
