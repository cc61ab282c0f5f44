"""Results of one computation: one for the same objects, whatever they hold."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.memo.once import once


def test_the_same_objects_have_one_result():
    calls = []

    @once
    def total(*arrays, scale=1):
        calls.append(len(arrays))
        return scale * sum(array.sum() for array in arrays)

    first = np.arange(3.0)
    second = np.arange(3.0)
    assert total(first, second) == total(first, second) == 6
    assert calls == [2]
    # Equal ones are others.
    total(second, first)
    total(first)
    assert total(first, scale=2) == 6
    assert calls == [2, 2, 1, 1]


def test_an_object_that_is_gone_leaves_its_address_to_no_other():
    number = once(lambda box: box[0])
    assert [number([n]) for n in range(50)] == list(range(50))


def test_traced_objects_have_results_of_their_trace():
    def twice(x):
        square = once(jnp.square)
        return square(x) + square(x)

    assert jax.grad(twice)(3.0) == 12.0
    assert str(jax.make_jaxpr(twice)(3.0)).count("square") == 1
