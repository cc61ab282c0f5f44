"""Standard errors of residuals that are alike in clusters: textbook forms."""

import numpy as np
import pytest

from calibrate.analysis.identifiability import identify
from calibrate.problem.clusters import (
    design_effect,
    image_clusters,
    score_covariance,
    view_clusters,
)
from calibrate.problem.parameters import Parameter, ParameterSet


def _alike(rng, clusters, size, correlation):
    """Residuals of variance 1 with a correlation within clusters."""
    shared = np.sqrt(correlation) * rng.standard_normal((clusters, 1))
    own = np.sqrt(1 - correlation) * rng.standard_normal((clusters, size))
    return (shared + own).ravel(), np.repeat(np.arange(clusters), size)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 1.0])
def test_the_design_effect_is_the_closed_form(correlation):
    """Kish: 1 + (m - 1) rho for clusters of m."""
    residual, cluster = _alike(np.random.default_rng(1), 4000, 10, correlation)
    effect = design_effect(residual, cluster)
    assert effect == pytest.approx(1 + 9 * correlation, rel=0.06)


def test_standard_errors_are_the_spread_over_repeated_data():
    """Of a mean and a slope, of which independent residuals tell half too little."""
    rng, (count, size) = np.random.default_rng(2), (60, 10)
    place = np.repeat(rng.uniform(-1, 1, count), size)
    rows = np.stack([np.ones(len(place)), place])
    inverse = np.linalg.inv(rows @ rows.T)
    found, variances = [], []
    for _ in range(400):
        data, cluster = _alike(rng, count, size, 0.5)
        z = inverse @ (rows @ data)
        scatter = score_covariance(rows, z @ rows - data, cluster)
        found.append(z)
        variances.append(np.diag(inverse @ scatter @ inverse))
    spread = np.std(found, axis=0)
    np.testing.assert_allclose(np.sqrt(np.mean(variances, axis=0)), spread, rtol=0.1)
    assert (np.sqrt(np.diag(inverse)) < 0.5 * spread).all()
    parameters = ParameterSet(
        tuple(Parameter(f"weights.p{n}", (0.0,), -np.inf, np.inf) for n in range(2))
    )
    judged = identify(parameters, found[-1], rows, 1.0, scatter).verdicts
    errors = [verdict.standard_error or 0.0 for verdict in judged]
    np.testing.assert_allclose(errors, np.sqrt(variances[-1]))


def test_squares_of_an_image_are_clusters():
    """At all times, but not of two views."""
    row, column = np.mgrid[:40, :70]
    found = image_clusters((row * 70 + column).ravel(), 70).reshape(40, 70)
    assert found.max() == 5
    assert found[0, 31] == found[31, 0] == found[0, 0]
    assert len(set(found[[0, 0, 0, 32, 32, 32], [0, 32, 64, 0, 32, 64]].tolist())) == 6
    numbers = view_clusters([[0, 1, 69], [0, 1]], [70, 70], 2)
    np.testing.assert_array_equal(numbers, [0, 0, 1, 2, 2] * 2)
