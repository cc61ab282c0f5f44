"""Cylinders found in bodies: true ones, limbs, sticks, discs, balls, single voxels."""

import numpy as np
import pytest

from jaxthermo.voxels.cylinders import Cylinder, cylinder_parts, parts_of
from tests.bodies import blocks


UP = np.array([0.0, 0.0, 1.0])
HALF = 0.15
"""Half the edge of the box that bodies are made in [m]."""


def body(inside, pitch=0.005):
    """The voxels whose centres (x, y, z) are `inside`; the box starts at -HALF."""
    centre = (np.arange(round(2 * HALF / pitch)) + 0.5) * pitch - HALF
    return blocks(inside(*np.meshgrid(centre, centre, centre, indexing="ij")), pitch)


def rod(radius, low, high, x0=0.0):
    """Upright, from z = low to high, at x = x0."""

    def inside(x, y, z):
        return (np.hypot(x - x0, y) <= radius) & (z > low) & (z < high)

    return inside


def together(*shapes):
    return lambda x, y, z: np.any([shape(x, y, z) for shape in shapes], axis=0)


def middle(cylinder):
    """In the coordinates that the body was made in."""
    return np.asarray(cylinder.axis_point) - HALF


def off(cylinder, axis):
    """Angle between a cylinder and an axis [degrees]."""
    cosine = abs(float(cylinder.direction @ axis)) / np.linalg.norm(axis)
    return np.degrees(np.arccos(min(1.0, cosine)))


@pytest.mark.parametrize("height", [0.05, 0.1, 0.28])
def test_a_cylinder_is_itself_whatever_its_proportions(height):
    grid = body(rod(0.05, -height / 2, height / 2))
    (cylinder,) = cylinder_parts(grid).cylinders
    assert off(cylinder, UP) < 1e-6
    assert cylinder.diameter == pytest.approx(0.1, rel=0.01)
    assert cylinder.length == pytest.approx(height, abs=1e-9)
    np.testing.assert_allclose(middle(cylinder), 0.0, atol=1e-9)


@pytest.mark.parametrize("degrees", [10.0, 35.0, 60.0, 90.0])
def test_a_tilted_one_keeps_its_axis_and_its_diameter(degrees):
    angle = np.radians(degrees)
    axis = np.array([np.sin(angle), 0.0, np.cos(angle)])

    def inside(x, y, z):
        along = axis[0] * x + axis[2] * z
        across = np.sqrt(np.maximum(x * x + y * y + z * z - along**2, 0))
        return (across < 0.02) & (np.abs(along) < 0.1)

    (cylinder,) = cylinder_parts(body(inside)).cylinders
    assert off(cylinder, axis) < 1.0
    assert cylinder.diameter == pytest.approx(0.04, rel=0.06)
    assert cylinder.length == pytest.approx(0.2, rel=0.06)


def test_two_legs_end_where_the_trunk_begins():
    legs = [rod(0.01, -0.13, -0.05, x) for x in (-0.03, 0.03)]
    cylinders = cylinder_parts(body(together(rod(0.05, -0.05, 0.05), *legs))).cylinders
    trunk, *small = cylinders
    assert trunk.diameter == pytest.approx(0.1, rel=0.02)
    assert sorted(round(middle(leg)[0], 3) for leg in small) == [-0.03, 0.03]
    for leg in small:
        assert leg.diameter == pytest.approx(0.02, rel=0.1)
        assert leg.length == pytest.approx(0.08, rel=0.08)
        assert off(leg, UP) < 1e-6


def test_every_fragment_belongs_to_the_part_that_it_lies_on():
    grid = body(together(rod(0.05, 0.0, 0.1), rod(0.015, -0.1, 0.0)))
    decomposed = cylinder_parts(grid)
    height = grid.fragment_position[:, 2] - HALF
    assert (decomposed.fragment[height > 0.01] == 0).all()
    assert (decomposed.fragment[height < -0.01] == 1).all()
    counts = [row["fragments"] for row in decomposed.rows()]
    assert sum(counts) == len(grid.fragment_area) and min(counts) > 0


def test_a_lying_body_is_cut_across_its_own_axis():
    upright = together(rod(0.02, -0.1, 0.1), rod(0.05, -0.02, 0.02))
    cylinders = cylinder_parts(body(lambda x, y, z: upright(y, z, x))).cylinders
    assert len(cylinders) == 3
    assert all(
        off(cylinder, np.array([1.0, 0.0, 0.0])) < 1e-6 for cylinder in cylinders
    )


def test_a_ball_is_one_upright_part_with_its_caps():
    decomposed = cylinder_parts(body(lambda x, y, z: x * x + y * y + z * z < 0.05**2))
    (cylinder,) = decomposed.cylinders
    assert off(cylinder, UP) < 1e-6
    assert 0.08 < cylinder.diameter < 0.1
    assert not decomposed.fragment.any()


@pytest.mark.parametrize("shape", [(20, 20, 1), (1, 1, 1), (1, 30, 1), (9, 2, 9)])
def test_sheets_sticks_and_single_voxels_have_a_part_too(shape):
    decomposed = cylinder_parts(blocks(np.ones(shape, bool), 0.01))
    assert not decomposed.fragment.any()
    (only,) = decomposed.cylinders
    assert only.length is not None
    volume = np.pi / 4 * only.diameter**2 * only.length
    assert volume == pytest.approx(np.prod(shape) * 1e-6, rel=1e-9)


def test_what_does_not_hang_together_is_two_parts():
    rods = [rod(0.02, -0.1, 0.1, x) for x in (-0.05, 0.05)]
    cylinders = cylinder_parts(body(together(*rods))).cylinders
    assert sorted(round(middle(p)[0], 3) for p in cylinders) == [-0.05, 0.05]
    assert all(p.diameter == pytest.approx(0.04, rel=0.05) for p in cylinders)


def test_coarser_blocks_find_what_single_voxels_do():
    """120 voxels along an edge are taken in blocks of two."""
    shape = together(rod(0.02, -0.15, 0.15), rod(0.05, 0.0, 0.06))
    cylinders = [
        cylinder_parts(body(shape, pitch)).cylinders for pitch in (0.005, 0.0025)
    ]
    assert len(cylinders[0]) == len(cylinders[1]) == 3
    for coarse, fine in zip(*cylinders, strict=True):
        assert coarse.diameter == pytest.approx(fine.diameter, rel=0.1)
        np.testing.assert_allclose(coarse.axis_point, fine.axis_point, atol=0.01)


def test_cylinders_given_for_a_body_take_their_place():
    grid = blocks(np.ones((4, 4, 9), bool), 0.01)
    user_cylinder = Cylinder((0.0, 0.0, 0.0), (0, 0, 1), 0.3)
    assert parts_of(grid, (user_cylinder,), 0).cylinders == (user_cylinder,)
    assert (
        parts_of(grid, (user_cylinder,), 1).cylinders == cylinder_parts(grid).cylinders
    )
