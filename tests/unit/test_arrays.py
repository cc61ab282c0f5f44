"""Types of values, and rows of arrays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.arrays import (
    device_array,
    in_sorted,
    is_compiling,
    linear_map,
    linear_map_in_columns,
    numbered,
    ranks,
    rows_of,
    rows_remembered,
    sorted_union,
    stable_order,
    stacked,
    typed_array,
    unique_rows,
)


def test_a_value_is_of_numpy_unless_it_is_on_the_device():
    assert isinstance(typed_array(2.0, np.float32), np.ndarray)
    assert typed_array(2.0, np.float32).dtype == np.float32
    assert isinstance(typed_array(jnp.ones(2), np.float32), jax.Array)
    assert float(jax.grad(lambda x: typed_array([x, 1.0], float)[0] ** 2)(3.0)) == 6.0


@pytest.mark.parametrize("value", [2.5, np.arange(3.0), jnp.arange(3.0), [1.0, 2.0]])
def test_a_moved_array_is_the_one_that_jax_makes(value):
    for dtype in (None, jnp.float32, jnp.float64):
        expected = jnp.asarray(value, dtype)
        for array in (device_array(value, dtype), jax.jit(device_array)(value)):
            assert isinstance(array, jax.Array)
            np.testing.assert_array_equal(array, expected)
        moved = device_array(value, dtype)
        assert moved.dtype == expected.dtype and moved.weak_type == expected.weak_type


@pytest.mark.parametrize("bound", [3, 2**40])
def test_different_rows_are_those_of_numpy(bound):
    # Products of three such ranges are too many for one number.
    rows = np.random.default_rng(0).integers(-bound, bound, (200, 3))
    rows = np.concatenate([rows, rows[:50]])
    distinct, number = unique_rows(rows)
    plain, inverse = np.unique(rows, axis=0, return_inverse=True)
    np.testing.assert_array_equal(distinct, plain)
    np.testing.assert_array_equal(number, inverse.reshape(-1))
    assert len(unique_rows(rows[:0])[0]) == 0


def test_union_of_numbers_is_that_of_numpy():
    random = np.random.default_rng(0)
    few = random.integers(0, 50, 40)
    many = random.integers(-9, 90, 70)
    np.testing.assert_array_equal(sorted_union(few, many), np.union1d(few, many))
    assert len(sorted_union(few[:0])) == 0


def test_numbers_among_sorted_ones_are_flagged():
    rng = np.random.default_rng(7)
    values = rng.integers(-5, 60, (40, 3))
    for size in (0, 1, 25):
        ordered = np.sort(rng.integers(0, 50, size))
        np.testing.assert_array_equal(
            in_sorted(values, ordered), np.isin(values, ordered)
        )


@pytest.mark.parametrize("bound", [5, 2**62])
def test_the_order_of_numbers_is_that_of_a_stable_sort(bound):
    # With the larger ones an index does not fit into the same 64 bits.
    for count in (0, 1, 300):
        key = np.random.default_rng(0).integers(0, bound, count)
        plain = np.argsort(key, kind="stable")
        np.testing.assert_array_equal(stable_order(key), plain)


def test_rows_of_one_array_are_put_together_without_operations():
    def together(array):
        with rows_remembered():
            rows = rows_of(array)
            assert stacked(rows, array.dtype) is array
            return stacked([rows[2], rows[0]], array.dtype)

    assert jax.jit(together)(jnp.arange(3.0)).tolist() == [2.0, 0.0]


def test_rows_of_several_arrays_and_numbers_are_gathered():
    def together(first, second):
        with rows_remembered():
            a, b = rows_of(first)
            c, _ = rows_of(second)
            return stacked([c, 5.0, b, a, c], first.dtype)

    values = jax.jit(together)(jnp.arange(2.0), jnp.array([7.0, 8.0]))
    assert values.tolist() == [7.0, 5.0, 1.0, 0.0, 7.0]


def test_other_numbers_are_stacked():
    assert stacked([1.0, np.float64(2.0)], np.float32).tolist() == [1.0, 2.0]
    rows = rows_of(jnp.arange(2.0))
    assert stacked([rows[1], 3.0], np.float32).tolist() == [1.0, 3.0]


@pytest.mark.parametrize("shape", [(3,), (7, 3), (5, 4, 3), (0, 3)])
def test_a_linear_map_is_the_product_by_a_matrix(shape):
    random = np.random.default_rng(1)
    vectors = random.normal(size=shape)
    matrix = random.normal(size=(3, 2))
    product = linear_map(vectors, matrix)
    np.testing.assert_allclose(product, vectors @ matrix, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(linear_map(vectors, np.eye(3)), vectors)
    assert linear_map(vectors.astype(np.float32), matrix).dtype == np.float64
    in_columns = linear_map_in_columns(vectors, matrix)
    np.testing.assert_array_equal(in_columns, product)
    assert np.moveaxis(in_columns, -1, 0).flags.c_contiguous


def test_compiling_is_told_from_computing():
    seen = []

    @jax.jit
    def compiled(x):
        seen.append(is_compiling())
        with jax.ensure_compile_time_eval():
            seen.append(is_compiling())
        return x + 1

    assert not is_compiling()
    assert float(compiled(1.0)) == 2.0
    assert seen == [True, False]

    # Differentiated and mapped values alone are computed, not compiled.
    def computed(x):
        seen.append(is_compiling())
        return x

    jax.vmap(computed)(np.ones(2))
    jax.grad(computed)(1.0)
    assert seen == [True, False, False, False]


def test_ranks_are_those_of_sorted_numbers():
    labels = np.random.default_rng(0).integers(0, 50, 40)
    np.testing.assert_array_equal(ranks(labels), numbered(labels).number)
    assert ranks(np.zeros(0, np.int64)).shape == (0,)
