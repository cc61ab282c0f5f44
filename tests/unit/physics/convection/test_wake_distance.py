"""Distances behind other objects, in their diameters, by rays along the wind."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxthermo.geometry import shapes
from jaxthermo.physics.convection.wake_geometry import upstream_wakes


PITCH = 0.0125
ALONG_X = np.array([1.0, 0.0, 0.0])
CYLINDER = shapes.cylinder(0.05, 0.1, sections=32)
FAR = (0.0, 1.0, 0.0)
"""Far from all others, so that every scene has three objects."""

ANGLE = np.radians(np.arange(0.0, 360.0, 7.0))
SIDE = np.concatenate(
    [
        np.stack([-0.05 * np.cos(ANGLE), 0.05 * np.sin(ANGLE), 0 * ANGLE + z], axis=1)
        for z in (-0.02, 0.01)
    ]
)
"""Points on the cylinder's side, the first of each ring at the front."""
FRONT = np.flatnonzero(SIDE[:, 0] < -0.0499)
MIDDLE = np.abs(SIDE[:, 1]) < 0.035


def distance_of(triangles, points=SIDE, direction=ALONG_X):
    """Distance x / D behind the object upstream, infinite without one."""
    wakes = upstream_wakes(triangles, position=points, direction=direction, pitch=PITCH)
    return wakes.behind


def scene(*places, size=1.0):
    """A cylinder at the origin and two others, the first of another size."""
    scaled = [CYLINDER.triangles * factor for factor in (size, 1.0)]
    moved = [o + np.asarray(at) for o, at in zip(scaled, places, strict=True)]
    return np.concatenate([CYLINDER.triangles, *moved])


def test_a_body_is_not_in_its_own_wake_nor_in_that_of_what_stands_beside():
    triangles = scene((-0.3, 0.2, 0.0), FAR)
    distance = distance_of(triangles)
    assert np.isinf(distance).all()


@pytest.mark.parametrize("gap", [0.05, 0.5])
def test_the_distance_is_from_the_rear_of_what_is_upstream(gap):
    upstream = np.array([-0.1 - gap, 0.0, 0.0])
    triangles = scene(upstream, FAR)
    distance = distance_of(triangles)
    # Off the middle the rear lies farther upstream, and the front farther down.
    expected = gap + SIDE[:, 0] + 0.1 - np.sqrt(0.05**2 - SIDE[:, 1] ** 2)
    assert_allclose(distance[MIDDLE], expected[MIDDLE] / 0.1, atol=0.1)
    assert_allclose(distance[FRONT], gap / 0.1, atol=0.05)
    assert np.isfinite(distance).all()
    # The one upstream is in no wake, nor is anything in a wind the other way.
    first = distance_of(triangles, SIDE + upstream)
    assert np.isinf(first).all()
    assert np.isinf(distance_of(triangles, direction=-ALONG_X)).all()


def test_the_last_of_several_objects_counts_by_its_own_size():
    triangles = scene((-0.3, 0.0, 0.0), (-0.8, 0.0, 0.0), size=2.0)
    distance = distance_of(triangles)
    assert_allclose(distance[FRONT], 0.15 / 0.2, atol=0.05)


def test_objects_are_told_apart_within_one_set_of_points():
    """As of two cylinders in one mesh, one behind the other."""
    upstream = np.array([-0.4, 0.0, 0.0])
    points = np.concatenate([SIDE + upstream, SIDE])
    distance = distance_of(scene(upstream, FAR), points)
    assert np.isinf(distance[: len(SIDE)]).all()
    assert np.isfinite(distance[len(SIDE) :][MIDDLE]).all()


def test_the_wind_may_blow_any_way():
    """Objects, points and wind are turned about z together."""
    c = np.cos(0.7)
    s = np.sin(0.7)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    triangles = scene((-0.35, 0.0, 0.0), FAR) @ turn.T
    distance = distance_of(triangles, SIDE @ turn.T, turn @ ALONG_X)
    assert_allclose(distance[FRONT], 2.5, atol=0.06)
