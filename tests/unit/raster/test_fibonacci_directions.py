"""Directions of a spiral are unit vectors, within their cap, and evenly spread."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.raster.views import cap_directions, half_sphere_directions


@pytest.mark.parametrize("least", [-1.0, 0.0, 0.5, 0.999])
def test_within_the_cap_around_any_axis(least):
    axis = np.array([1.0, -2.0, 0.5])
    found = cap_directions(axis, least, 400)
    cosine = found @ axis / np.linalg.norm(axis)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-12)
    assert (cosine >= least - 1e-12).all()
    # Uniform in solid angle: the cosine is uniform, and nothing leans to one side.
    assert cosine.mean() == pytest.approx((1 + least) / 2, abs=1e-12)
    across = found.mean(0) - cosine.mean() * axis / np.linalg.norm(axis)
    assert np.linalg.norm(across) < 0.01


@pytest.mark.parametrize("count", [64, 256])
def test_with_their_opposites_they_integrate_smooth_functions(count):
    half = half_sphere_directions(count)
    assert (half[:, 2] > 0).all()
    every = np.concatenate([half, -half])
    second = every.T @ every / len(every)
    np.testing.assert_allclose(second, np.eye(3) / 3, atol=1.5 / count)


def test_an_axis_must_be_a_direction():
    with pytest.raises(InputError, match="direction"):
        cap_directions((0.0, 0.0, 0.0), 0.0, 8)
