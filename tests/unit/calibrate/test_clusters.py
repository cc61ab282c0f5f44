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
    independent = np.sqrt(1 - correlation) * rng.standard_normal((clusters, size))
    return (shared + independent).ravel(), np.repeat(np.arange(clusters), size)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 1.0])
def test_the_design_effect_is_the_closed_form(correlation):
    """Kish: 1 + (m - 1) rho for clusters of m."""
    residual, cluster = _alike(
        np.random.default_rng(1), clusters=4000, size=10, correlation=correlation
    )
    effect = design_effect(residual, cluster)
    assert effect == pytest.approx(1 + 9 * correlation, rel=0.06)


def test_standard_errors_are_the_spread_over_repeated_data():
    """Of a mean and a slope, of which independent residuals tell half too little."""
    rng = np.random.default_rng(2)
    count = 60
    size = 10
    position = np.repeat(rng.uniform(-1, 1, count), size)
    rows = np.stack([np.ones(len(position)), position])
    inverse = np.linalg.inv(rows @ rows.T)
    estimates = []
    variances = []
    for _ in range(400):
        data, cluster = _alike(rng, clusters=count, size=size, correlation=0.5)
        z = inverse @ (rows @ data)
        scatter = score_covariance(rows, z @ rows - data, cluster)
        estimates.append(z)
        variances.append(np.diag(inverse @ scatter @ inverse))
    spread = np.std(estimates, axis=0)
    np.testing.assert_allclose(np.sqrt(np.mean(variances, axis=0)), spread, rtol=0.1)
    assert (np.sqrt(np.diag(inverse)) < 0.5 * spread).all()
    parameters = ParameterSet(
        tuple(
            Parameter(name=f"weights.p{n}", start=(0.0,), lower=-np.inf, upper=np.inf)
            for n in range(2)
        )
    )
    judged = identify(
        parameters, z=estimates[-1], jacobian=rows, sd=1.0, scatter=scatter
    ).verdicts
    errors = [verdict.standard_error or 0.0 for verdict in judged]
    np.testing.assert_allclose(errors, np.sqrt(variances[-1]))


def test_squares_of_an_image_are_clusters():
    """At all times, but not of two views."""
    row, column = np.mgrid[:40, :70]
    clusters = image_clusters((row * 70 + column).ravel(), 70).reshape(40, 70)
    assert clusters.max() == 5
    assert clusters[0, 31] == clusters[31, 0] == clusters[0, 0]
    assert (
        len(set(clusters[[0, 0, 0, 32, 32, 32], [0, 32, 64, 0, 32, 64]].tolist())) == 6
    )
    numbers = view_clusters([[0, 1, 69], [0, 1]], [70, 70], 2)
    np.testing.assert_array_equal(numbers, [0, 0, 1, 2, 2] * 2)
