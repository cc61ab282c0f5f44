"""Arrays of a scene on their way to the device."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.arrays import on_device, typed_array


def test_arrays_go_to_the_device_and_all_else_stays():
    here = np.arange(3.0)
    there, again, number, name = on_device((here, here, 2, "name"))
    assert isinstance(there, jax.Array)
    np.testing.assert_array_equal(there, here)
    assert again is there
    assert (number, name) == (2, "name")


def test_known_arrays_stay_known_where_others_are_traced():
    def sum_of(x):
        known, traced = on_device((np.arange(3.0), x))
        assert traced is x
        return np.asarray(known).sum() * traced

    assert float(jax.jit(sum_of)(2.0)) == 6.0


def test_a_value_is_of_numpy_unless_it_is_on_the_device():
    assert isinstance(typed_array(2.0, np.float32), np.ndarray)
    assert typed_array(2.0, np.float32).dtype == np.float32
    assert isinstance(typed_array(jnp.ones(2), np.float32), jax.Array)
    assert float(jax.grad(lambda x: typed_array([x, 1.0], float)[0] ** 2)(3.0)) == 6.0
