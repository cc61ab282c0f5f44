"""Cylinders: distances from them, which of them is nearest, bad input."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxthermo.errors import InputError
from jaxthermo.voxels.cylinders import Cylinder, _nearest_parts, given_cylinders


points = st.tuples(*[st.floats(-3, 3)] * 3).map(lambda p: np.array([p]))


@settings(deadline=None, max_examples=100)
@given(point=points)
def test_the_distance_is_that_of_the_nearest_point_of_the_surface(point):
    """Against points sampled all over it."""
    cylinder = Cylinder((0.0, 0.0, 0.0), (0, 0, 2), 1.0, 2.0)
    angle, share = np.meshgrid(np.linspace(0, 2 * np.pi, 73), np.linspace(0, 1, 41))
    rim = 0.5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    side = rim + (2 * share - 1)[..., None] * [0, 0, 1]
    ends = [rim * share[..., None] + [0, 0, z] for z in (-1, 1)]
    sampled = np.concatenate([side, *ends]).reshape(-1, 3)
    nearest = np.linalg.norm(sampled - point, axis=1).min()
    (distance,) = cylinder.distance(point)
    assert abs(distance) == pytest.approx(nearest, abs=0.06)
    inside = np.hypot(*point[0, :2]) < 0.5 and abs(point[0, 2]) < 1
    assert (distance < 0) == inside or abs(distance) < 1e-9


def test_one_without_a_length_has_no_ends():
    endless = Cylinder((0.0, 0.0, 0.0), (0, 0, 1), 1.0)
    distance = endless.distance(np.array([[1.0, 0.0, 1e6], [0.0, 0.0, -1e6]]))
    np.testing.assert_allclose(distance, [0.5, -0.5])


def test_points_go_to_the_cylinder_they_are_nearest_to_or_deepest_in():
    thick = Cylinder((0.0, 0.0, 0.0), (0, 0, 1), 1.0, 1.0)
    thin = Cylinder((0.0, 0.0, 1.0), (0, 0, 1), 0.2, 1.0)
    at = np.array([[0.0, 0.0, 1.2], [0.5, 0.0, 0.0], [0.4, 0.0, 0.6], [0.2, 0, 0.9]])
    nearest = _nearest_parts([thick, thin], at)
    np.testing.assert_array_equal(nearest.fragment, [1, 0, 0, 1])
    rows = nearest.rows()
    assert [row["fragments"] for row in rows] == [2, 2]
    assert rows[1]["diameter_m"] == 0.2 and rows[1]["axis"] == [0.0, 0.0, 1.0]


def test_arrays_may_be_given_and_cylinders_compared():
    cylinder = Cylinder(np.zeros(3), np.array([0, 0, 1]), 1.0)
    assert cylinder == Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0)
    assert hash(cylinder) == hash(Cylinder((0, 0, 0), (0, 0, 1), 1.0))
    assert given_cylinders(None) == () and given_cylinders([cylinder]) == (cylinder,)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (((0, 0, 0), (0, 0, 0), 1.0), "axis=.* not all zero"),
        (((0, 0), (0, 0, 1), 1.0), "axis_point"),
        (((0, 0, np.nan), (0, 0, 1), 1.0), "axis_point"),
        (("middle", (0, 0, 1), 1.0), "axis_point"),
        (((0, 0, 0), (0, 0, 1), -1.0), "diameter=-1.0"),
        (((0, 0, 0), (0, 0, 1), 0.0), "diameter=0.0"),
        (((0, 0, 0), (0, 0, 1), np.nan), "diameter=nan"),
        (((0, 0, 0), (0, 0, 1), "5 cm"), "diameter='5 cm'"),
        (((0, 0, 0), (0, 0, 1), 1.0, 0.0), "length=0.0"),
        (((0, 0, 0), (0, 0, 1), 1.0, -2.0), "length=-2.0"),
    ],
)
def test_a_mistake_is_one_line(arguments, words):
    with pytest.raises(InputError, match=words) as raised:
        Cylinder(*arguments)
    assert "\n" not in str(raised.value)


def test_cylinders_nowhere_near_are_refused():
    lost = Cylinder((0.0, 0.0, 900.0), (0, 0, 1), 1.0, 1.0, body=2)
    with pytest.raises(InputError, match="body 2.*900 m away"):
        _nearest_parts([lost], np.zeros((4, 3)))
