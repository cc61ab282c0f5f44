"""Views along any direction are right-handed and hold what they are made for."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from peeling import SPHERE, ray_balance

from jaxthermo.errors import InputError
from jaxthermo.geometry.vectors import unit_vector
from jaxthermo.raster.views import orthographic_view, view_frame


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.dot(d, d) > 1e-6)


@given(direction=directions)
def test_frames_are_right_handed_and_look_forwards(direction):
    frame = view_frame(direction)
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert frame[2] == pytest.approx(unit_vector(direction))


@pytest.mark.parametrize(
    "bad",
    [(0, 0, 0), (1, 0), (np.nan, 0, 1), (np.inf, 0, 0), "up", ("a", 1, 2), None, 3.0]
    + [[(1, 0, 0)], (1, (2, 3), 4)],
)
def test_what_is_no_direction_is_refused(bad):
    with pytest.raises(InputError, match="wind"):
        unit_vector(bad, "wind")


@settings(deadline=None, max_examples=15)
@given(direction=directions, pitch=st.floats(0.19, 0.21))
def test_a_view_holds_the_whole_body(direction, pitch):
    triangles = SPHERE.triangles + np.array([5.0, -3.0, 2.0])
    view = orthographic_view(triangles, direction, pitch)
    seen = view.project(triangles)
    assert (seen[..., :2] > 0).all()
    assert (seen[..., :2] < (view.width, view.height)).all()
    assert seen[..., 2].min() == pytest.approx(0.0, abs=1e-9)
    layers = view.peel(triangles)
    assert not ray_balance(layers).any()
    assert layers.entering[layers.layer == 0].all()
    shadow = np.count_nonzero(layers.layer == 0) * pitch**2
    assert shadow == pytest.approx(np.pi, rel=0.1)
