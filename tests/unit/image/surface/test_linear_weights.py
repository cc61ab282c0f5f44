"""Weights with the mean position of a point, against a solve of each point alone."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse import csr_array

from jaxthermo.image.surface.linear_weights import linear_weights


RADIUS = 0.3
# A row that keeps its weights.
UNCHANGED = 7


@pytest.fixture(scope="module")
def case():
    """Points in the unit square and beyond it, and scattered positions near them."""
    rng = np.random.default_rng(0)
    position = np.pad(rng.uniform(0, 1, (150, 2)), ((0, 0), (0, 1)))
    points = np.pad(rng.uniform(-0.1, 1.1, (60, 2)), ((0, 0), (0, 1)))
    gap = np.linalg.norm(points[:, None] - position, axis=2)
    dense = np.maximum(1 - (gap / RADIUS) ** 2, 0) ** 2
    weights = csr_array(dense / dense.sum(axis=1, keepdims=True))
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    rows = np.flatnonzero(np.arange(len(points)) != UNCHANGED)
    tilted = linear_weights(
        weights,
        rows=rows,
        points=points,
        normals=normals,
        position=position,
        radius=np.full(len(points), RADIUS),
    )
    unchanged = slice(*weights.indptr[UNCHANGED : UNCHANGED + 2])
    np.testing.assert_array_equal(tilted.data[unchanged], weights.data[unchanged])
    return points[rows], position, weights[rows], tilted[rows]


def test_weights_are_those_of_each_point_alone(case):
    points, position, weights, tilted = case
    inner = np.flatnonzero((points[:, :2] > 0.1).all(1) & (points[:, :2] < 0.9).all(1))
    for number in inner:
        entries = slice(*weights.indptr[number : number + 2])
        offset = (position[weights.indices[entries]] - points[number])[:, :2] / RADIUS
        weight = weights.data[entries]

        def total(tilt, offset=offset, weight=weight):
            return np.log(weight @ np.exp(offset @ tilt)) + 0.5e-6 * tilt @ tilt

        tilt = minimize(total, np.zeros(2), tol=1e-12).x
        alone = weight * np.exp(offset @ tilt)
        alone /= alone.sum()
        np.testing.assert_allclose(tilted.data[entries], alone, atol=1e-5)
        assert np.linalg.norm(alone @ offset) < 1e-4
    assert len(inner) > 20


def test_mean_positions_are_the_points(case):
    points, position, weights, tilted = case
    np.testing.assert_allclose(tilted.sum(axis=1), 1, rtol=1e-12)
    assert (tilted.data > 0).all()
    off = np.linalg.norm(tilted @ position - points, axis=1) / RADIUS
    inner = ((points[:, :2] > 0.1) & (points[:, :2] < 0.9)).all(axis=1)
    assert off[inner].max() < 2e-5
    # Outside there is no such mean, but a nearer one than that of the given weights.
    before = np.linalg.norm(weights @ position - points, axis=1) / RADIUS
    outside = ((points < -0.02) | (points > 1.02)).any(axis=1)
    assert outside.sum() > 5
    assert (off[outside] < before[outside]).all()


def test_weights_at_one_place_have_one_factor():
    numbers = np.random.default_rng(2)
    apart = np.pad(numbers.uniform(0, 1, (9, 2)), ((0, 0), (0, 1)))
    times = np.array([1, 3, 1, 1, 2, 1, 1, 1, 4])
    point = np.array([[0.5, 0.4, 0.0]])
    given = numbers.uniform(0.1, 1.0, times.sum())
    given /= given.sum()
    sums = np.add.reduceat(given, np.cumsum(times) - times)

    def solved(weights, position):
        return linear_weights(
            csr_array(weights[None]),
            rows=np.array([0]),
            points=point,
            normals=np.array([[0.0, 0.0, 1.0]]),
            position=position,
            radius=np.ones(1),
        ).data

    together = solved(given, np.repeat(apart, times, axis=0))
    alone = solved(sums, apart)
    np.testing.assert_allclose(together / given, np.repeat(alone / sums, times))
    np.testing.assert_allclose(alone @ apart, point[0], atol=1e-4)
