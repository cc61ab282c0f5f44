"""Pairs of boxes against a loop over all of them."""

import numpy as np
from hypothesis import given, settings, strategies as st

from jaxthermo.geometry.nearby import overlapping_boxes


def every_pair(lower, upper):
    return [
        (i, j)
        for i in range(len(lower))
        for j in range(i + 1, len(lower))
        if (lower[i] <= upper[j]).all() and (lower[j] <= upper[i]).all()
    ]


@settings(deadline=None, max_examples=100)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(0, 30),
    size=st.floats(0.05, 0.8),
    stretch=st.sampled_from([(1.0, 1.0, 1.0), (9.0, 1.0, 1.0), (1.0, 1.0, 9.0)]),
)
def test_every_pair_is_found_once(seed, count, size, stretch):
    random = np.random.default_rng(seed)
    lower = random.random((count, 3)) * stretch
    upper = lower + size * random.random((count, 3))
    pairs = overlapping_boxes(lower, upper)
    assert [tuple(pair) for pair in pairs.tolist()] == every_pair(lower, upper)


def test_boxes_that_share_a_face_an_edge_or_a_corner_overlap():
    lower = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [1.01, 0, 0]], float)
    pairs = overlapping_boxes(lower, lower + 1.0)
    assert pairs[pairs[:, 0] == 0].tolist() == [[0, 1], [0, 2], [0, 3]]
