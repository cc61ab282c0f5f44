"""Sums of segments are exact to about one rounding, and take constant operations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.network.segment_sums import segment_sums, sums_of_lists, sums_of_sizes


@pytest.mark.parametrize("sizes", [(1,), (5, 64, 1, 65), (0, 3, 0), (5000, 2, 64 * 64)])
def test_each_segment_has_its_sum(sizes):
    values = np.random.default_rng(0).normal(size=sum(sizes)).astype(np.float32)
    parts = np.split(values.astype(float), np.cumsum(sizes)[:-1])
    expected = [part.sum() for part in parts]
    sums = np.asarray(sums_of_sizes(sizes)(jnp.asarray(values)))
    scale = max(np.abs(part).sum() for part in parts)
    assert np.abs(sums - expected).max() <= 1e-6 * scale


def test_values_between_segments_do_not_count():
    sums = segment_sums([slice(1, 3), slice(5, 6)], 8)
    assert np.asarray(sums(jnp.arange(8.0))).tolist() == [3.0, 5.0]


def test_lists_may_be_in_any_order():
    lists = [np.array([0, 3, 5]), np.array([4, 1])]
    assert np.asarray(sums_of_lists(lists, 6)(jnp.arange(6.0))).tolist() == [8.0, 5.0]


def test_long_segments_keep_their_digits():
    # A running sum in float32 stops at 2^24.
    count = 2**25
    sums = sums_of_sizes((count,))(jnp.ones(count))
    assert float(sums[0]) == count


def test_the_gradient_is_one():
    sums = sums_of_sizes((70, 3))
    slope = jax.grad(lambda values: sums(values)[0])(jnp.ones(73))
    assert np.asarray(slope).tolist() == [1.0] * 70 + [0.0] * 3


@pytest.mark.parametrize("sizes", [(1,), (5, 64, 1, 65), (0, 3, 0), (5000, 2, 64 * 64)])
def test_each_segment_has_its_largest_value(sizes):
    values = np.random.default_rng(0).normal(size=sum(sizes)) - 2
    parts = np.split(values, np.cumsum(sizes)[:-1])
    expected = [part.max(initial=-np.inf) for part in parts]
    largest = sums_of_sizes(sizes).largest(jnp.asarray(values))
    assert np.asarray(largest).tolist() == expected
