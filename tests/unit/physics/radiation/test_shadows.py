"""Shadows that the surfaces of one search receive, as by maps of all triangles."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.physics.radiation import shadows
from jaxthermo.physics.radiation.shadows import Squares, lit_fractions, sunlit_samples
from jaxthermo.physics.radiation.window import window_of
from jaxthermo.raster.depth_buffer import nearest_depth
from jaxthermo.raster.views import (
    fitted_view,
    orthographic_view,
    pixels_at,
    view_frame,
)


PITCH = 0.05
GRID = jt.voxelize(jt.shapes.box((0.3, 0.2, 0.1)), PITCH)
PLACES = ((0.0, 0.0, 0.0), (0.1, 0.05, 0.4), (3.0, 0.0, 0.0))
DIRECTIONS = ((0.2, 0.1, -1.0), (-1.0, 0.3, -0.4), (0.0, 0.0, -1.0))


def squares_at(place, edge=PITCH):
    position = GRID.fragment_position + np.asarray(place)
    return Squares(position, GRID.fragment_normal, edge)


def triangles_at(places):
    return np.concatenate([GRID.mesh.triangles + np.asarray(p) for p in places])


def fully_drawn(triangles, squares, direction):
    """Lit fractions by a map of all triangles, without leaving out any."""
    position, normal, edge = squares
    facing = np.flatnonzero(normal @ np.asarray(direction) < 0)
    pixel = shadows._shadow_pixel(edge)
    view = orthographic_view(position[facing], direction, pixel)
    raised = position[facing] + normal[facing] * shadows._LIFT * pixel
    at = view.project(shadows._samples(raised, normal[facing], edge))
    row, column = pixels_at(view, at)
    nearest = nearest_depth(
        view.project(triangles),
        row=row,
        column=column,
        width=view.width,
        height=view.height,
    )
    lit = np.zeros(len(position))
    lit[facing] = (at[:, 2] <= nearest).reshape(4, -1).mean(axis=0)
    return lit


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_surfaces_of_one_search_are_lit_as_by_full_maps(direction):
    triangles = triangles_at(PLACES)
    surfaces = [squares_at(place) for place in PLACES]
    lit = sunlit_samples(triangles, surfaces, direction)
    for samples, squares in zip(lit, surfaces, strict=True):
        expected = fully_drawn(triangles, squares, direction)
        np.testing.assert_array_equal(lit_fractions(samples), expected)
        (alone,) = sunlit_samples(triangles, [squares], direction)
        np.testing.assert_array_equal(samples, alone)
    shaded, _, free = (lit_fractions(samples).sum() for samples in lit)
    assert 0 < shaded <= free


def test_triangles_beside_an_image_are_left_out():
    direction = (0.0, 0.0, -1.0)
    (lit,) = sunlit_samples(
        triangles_at(PLACES[2:]), [squares_at(PLACES[0])], direction
    )
    is_facing = GRID.fragment_normal[:, 2] > 0
    np.testing.assert_array_equal(lit_fractions(lit), is_facing)
    frame = view_frame((0.0, 0.0, 1.0))
    view, at = fitted_view(squares_at(PLACES[2]).position, frame, PITCH)
    window = window_of(
        view,
        triangles=triangles_at(PLACES),
        at=at,
        is_behind=lambda low, high: np.ones(len(at), bool),
        task="a map",
    )
    assert window is not None and len(window.corners) == len(GRID.mesh.faces)
    first = np.array([1.0, 1.0, 0.0])
    expected = view.project(triangles_at(PLACES[2:])) - first
    np.testing.assert_array_equal(window.corners, expected)
