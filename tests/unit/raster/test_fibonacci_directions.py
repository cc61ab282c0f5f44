"""Directions of a spiral are unit vectors, within their cap, and evenly spread."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.raster.views import cap_directions, half_sphere_directions


@pytest.mark.parametrize("min_cosine", [-1.0, 0.0, 0.5, 0.999])
def test_within_the_cap_around_any_axis(min_cosine):
    axis = np.array([1.0, -2.0, 0.5])
    directions = cap_directions(axis, min_cosine, 400)
    cosine = directions @ axis / np.linalg.norm(axis)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-12)
    assert (cosine >= min_cosine - 1e-12).all()
    # Uniform in solid angle: the cosine is uniform, and nothing leans to one side.
    assert cosine.mean() == pytest.approx((1 + min_cosine) / 2, abs=1e-12)
    across = directions.mean(0) - cosine.mean() * axis / np.linalg.norm(axis)
    assert np.linalg.norm(across) < 0.01


@pytest.mark.parametrize("count", [64, 256])
def test_with_their_opposites_they_integrate_smooth_functions(count):
    half = half_sphere_directions(count)
    assert (half[:, 2] > 0).all()
    directions = np.concatenate([half, -half])
    second = directions.T @ directions / len(directions)
    np.testing.assert_allclose(second, np.eye(3) / 3, atol=1.5 / count)


def test_an_axis_must_be_a_direction():
    with pytest.raises(InputError, match="direction"):
        cap_directions((0.0, 0.0, 0.0), 0.0, 8)
