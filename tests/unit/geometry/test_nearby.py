"""Pairs of boxes against a loop over all of them, and lines that pass by."""

import numpy as np
from hypothesis import given, settings, strategies as st

from jaxthermo.geometry.nearby import may_meet, overlapping_boxes


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


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 10**6), distance=st.floats(0.0, 6.0))
def test_lines_that_pass_near_triangles_are_flagged(seed, distance):
    """By the closest approach of the lines through all points to all corners."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(5, 3))
    triangles = random.normal(size=(4, 3, 3)) + [distance, 0.0, 0.0]
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    way = triangles.reshape(-1, 3) - points[:, None]
    aside = np.cross(directions[:, None, None], way)
    nearest = np.linalg.norm(aside, axis=-1).min(axis=(1, 2))
    flags = may_meet(points, triangles, directions, 0.1)
    assert flags[nearest <= 0.1].all()


def test_lines_beside_triangles_are_not_flagged():
    points = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    triangles = points[None, [0, 1, 1]] + [0.0, 3.0, 0.0]
    directions = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    assert may_meet(points, triangles, directions, 1.9).tolist() == [False, True, False]
    assert may_meet(points, triangles, directions, 2.1).tolist() == [True, True, True]


def test_nothing_is_met_where_nothing_is():
    points = np.zeros((1, 3))
    none = np.zeros((0, 3, 3))
    assert may_meet(points, none, np.eye(3), 1.0).tolist() == [False] * 3
    assert (
        may_meet(points[:0], np.zeros((1, 3, 3)), np.eye(3), 1.0).tolist()
        == [False] * 3
    )
