"""Lambert's formula against the integral it stands for, horizon and all."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose

from jaxthermo.physics.radiation.area_source import polygon_view_factor
from jaxthermo.reference.view_factor import element_to_rectangle


UNIT = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def midpoint(position, normal, corners, count=300):
    """The plain sum over small squares of a rectangle."""
    t = (np.arange(count) + 0.5) / count
    a = corners[1] - corners[0]
    b = corners[3] - corners[0]
    points = corners[0] + t[:, None, None] * a + t[None, :, None] * b
    front = np.cross(a, b)
    gap = points - position
    square = (gap**2).sum(-1)
    leaves = (gap @ normal).clip(0)
    meets = -(gap @ front).clip(None, 0)
    return float((leaves * meets / (np.pi * square**2)).sum() / count**2)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_element_and_any_rectangle(seed):
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    corners = (UNIT - 0.5) * np.append(random.uniform(0.3, 2.0, 2), 1.0) @ turn.T
    position = random.normal(size=3)
    position *= (0.8 + np.linalg.norm(position)) / np.linalg.norm(position)
    normal = random.normal(size=3)
    normal /= np.linalg.norm(normal)
    factor = polygon_view_factor(position[None], normal[None], corners)[0]
    # Where the horizon cuts squares in two the plain sum is off by a part of one.
    assert factor == pytest.approx(midpoint(position, normal, corners), abs=2e-4)


def test_corner_above_the_element():
    corners = UNIT[::-1] * np.array([3.0, 2.0, 1.0]) + np.array([0.0, 0.0, 0.7])
    origin = np.zeros((1, 3))
    up = np.array([[0.0, 0.0, 1.0]])
    exact = element_to_rectangle(3.0, 2.0, 0.7)
    assert polygon_view_factor(origin, up, corners)[0] == pytest.approx(
        exact, abs=1e-14
    )


def test_half_below_the_horizon():
    """A wall that goes on below the floor is seen down to the floor."""
    wall = np.array([[0.0, -1, -5], [0, 1, -5], [0, 1, 2], [0, -1, 2]])
    above = wall.copy()
    above[:2, 2] = 0.0
    floor = np.random.default_rng(0).uniform(0.1, 2.0, (50, 3)) * [1.0, 1.0, 0.0]
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    cut, exact = (polygon_view_factor(floor, up, w) for w in (wall, above))
    assert_allclose(cut, exact, atol=1e-14)
    assert (exact > 0.01).any()


def test_a_square_seen_from_nowhere_near_to_all_round():
    up = np.array([[0.0, 0.0, 1.0]])
    front = UNIT[::-1] - np.array([0.5, 0.5, 0.0])
    far = np.array([0.0, 0.0, 1e6])
    tiny = polygon_view_factor(np.zeros((1, 3)), up, front + far)[0]
    assert tiny == pytest.approx(1 / (np.pi * 1e12), rel=1e-3)
    close = polygon_view_factor(np.zeros((1, 3)), up, front + far * 1e-12)[0]
    assert close == pytest.approx(1.0, abs=1e-5)


def test_its_back_and_a_point_at_its_corner_give_no_nan():
    up = np.array([[0.0, 0.0, 1.0]])
    behind = polygon_view_factor(np.zeros((1, 3)), up, UNIT + [0.0, 0.0, 1.0])[0]
    assert behind == 0.0
    corner = polygon_view_factor(np.zeros((1, 3)), up, UNIT[::-1])[0]
    within = polygon_view_factor(np.array([[0.3, 0.4, 0.0]]), up, UNIT[::-1])[0]
    assert 0.0 <= corner <= 1.0 and 0.0 <= within <= 1.0
