"""Boxes, balls, cavities, unions and open meshes become what they are."""

import numpy as np
import pytest
from voxel_bodies import BALL, inverted, joined, normals, without

from jaxthermo.geometry import shapes
from jaxthermo.voxels.voxelize import voxelize


def inside_ball(grid, radius=1.0):
    cells = np.indices(grid.lattice.shape).reshape(3, -1).T
    distance = np.linalg.norm(grid.lattice.centres(cells), axis=1)
    return (distance < radius).reshape(grid.lattice.shape), distance


@pytest.mark.parametrize("counts", [(1, 1, 1), (5, 8, 11), (1, 6, 3)])
@pytest.mark.parametrize("pitch", [1.0, 0.1, 3e-3, 1 / 3])
def test_a_box_fills_its_lattice(counts, pitch):
    x, y, z = (n * pitch for n in counts)
    box = shapes.box((x, y, z)).moved((0.7, -0.3, 11.0))
    grid = voxelize(box, pitch)
    assert grid.solid.shape == counts
    assert grid.solid.all()
    assert grid.origin == pytest.approx(box.bounds[0])
    assert grid.volume_ratio == pytest.approx(1.0)
    assert grid.area_ratio == pytest.approx(1.0)
    assert grid.unscaled_because == ""
    assert grid.layers.peeled == (2, 2, 2)
    assert grid.voxel_volume == pytest.approx(pitch**3)
    for axis in range(3):
        for side in (-1, 1):
            face = grid.fragment_normal[:, axis] == side
            area = grid.fragment_area[face]
            assert len(area) == np.prod(counts) // counts[axis]
            assert area == pytest.approx(np.full(len(area), pitch**2))
            level = box.bounds[(side + 1) // 2, axis]
            assert grid.fragment_position[face, axis] == pytest.approx(level)
            end = 0 if side < 0 else counts[axis] - 1
            assert (grid.fragment_voxel[face, axis] == end).all()
    centre = grid.lattice.centres(grid.fragment_voxel)
    apart = np.abs(grid.fragment_position - centre)
    assert np.sort(apart, axis=1) == pytest.approx(
        np.repeat([[0.0, 0.0, pitch / 2]], len(apart), axis=0), abs=1e-9
    )


def test_lengths_as_a_float32_file_has_them_make_no_extra_cell():
    x, y, z = (float(np.float32(n * 0.001)) for n in (100, 700, 1100))
    assert voxelize(shapes.box((x, y, z)), 0.01).solid.shape == (10, 70, 110)
    longer = shapes.box((0.1001, 0.1, 0.1))
    assert voxelize(longer, 0.01).solid.shape == (11, 10, 10)


@pytest.fixture(scope="module")
def ball_grid():
    return voxelize(BALL, 1 / 40)


def test_a_balls_volume_and_area_before_scaling(ball_grid):
    assert ball_grid.volume_ratio == pytest.approx(1.0, abs=5e-3)
    assert ball_grid.area_ratio == pytest.approx(1.0, abs=1e-2)
    assert ball_grid.body_volume == pytest.approx(BALL.volume)
    assert ball_grid.fragment_area.sum() == pytest.approx(BALL.area)


def test_a_balls_voxels_and_fragments(ball_grid):
    inside, distance = inside_ball(ball_grid)
    differ = distance[(inside != ball_grid.solid).reshape(-1)]
    assert np.abs(differ - 1.0).max(initial=0.0) < 5e-3
    radius = np.linalg.norm(ball_grid.fragment_position, axis=1)
    assert radius == pytest.approx(np.ones(len(radius)), abs=5e-3)
    cosine = (ball_grid.fragment_position * ball_grid.fragment_normal).sum(1)
    assert cosine.min() > 0.99
    owner = ball_grid.lattice.centres(ball_grid.fragment_voxel)
    assert ball_grid.solid[tuple(ball_grid.fragment_voxel.T)].all()
    behind = ((ball_grid.fragment_position - owner) * ball_grid.fragment_normal).sum(1)
    assert behind.min() > -0.01 / 40
    assert (
        np.linalg.norm(ball_grid.fragment_position - owner, axis=1).max() <= 1.01 / 40
    )
    # The first moments of the surface vanish: nothing is counted on one side only.
    pull = ball_grid.fragment_normal * ball_grid.fragment_area[:, None]
    assert pull.sum(0) == pytest.approx(np.zeros(3), abs=5e-3)


@pytest.mark.parametrize("radius", [0.9, 0.97])
def test_a_hollow_ball_stays_hollow(radius):
    cavity = inverted(shapes.sphere(radius, subdivisions=4))
    shell = joined(BALL, cavity)
    grid = voxelize(shell, 1 / 40)
    within, _ = inside_ball(grid, radius - 0.02)
    assert not grid.solid[within].any()
    assert grid.layers.peeled == (4, 4, 4)
    assert grid.body_volume == pytest.approx(shell.volume)
    assert grid.volume_ratio == pytest.approx(1.0, abs=0.02)
    inner = np.linalg.norm(grid.fragment_position, axis=1) < (1 + radius) / 2
    assert grid.fragment_area[inner].sum() == pytest.approx(cavity.area, rel=1e-2)


def test_overlapping_parts_unite_and_what_lies_inside_is_no_surface():
    pair = joined(BALL, BALL.moved((1.0, 0.0, 0.0)))
    grid = voxelize(pair, 1 / 32)
    union = 2 * BALL.volume - np.pi / 12 * (4 + 1) * (2 - 1) ** 2
    assert grid.solid_count * grid.voxel_volume == pytest.approx(union, rel=5e-3)
    assert grid.area_ratio == pytest.approx(1.0, abs=2e-3)
    assert grid.volume_ratio == 1.0
    assert "overlap" in grid.unscaled_because
    # The mesh of a ball is 0.3 % smaller than the ball.
    outside = 6 * np.pi * BALL.area / (4 * np.pi)
    assert grid.fragment_area.sum() == pytest.approx(outside, rel=2e-3)
    position = grid.fragment_position
    for middle in (0.0, 1.0):
        assert np.linalg.norm(position - [middle, 0, 0], axis=1).min() > 1 - 5e-3
    assert grid.thin.thin_area < 1e-2


def test_boxes_that_touch_have_no_surface_between_them():
    cube = shapes.box((4.0, 4.0, 4.0))
    grid = voxelize(joined(cube, cube.moved((4.0, 0.0, 0.0))), 1.0)
    assert grid.solid.shape == (8, 4, 4) and grid.solid.all()
    assert len(grid.fragment_area) == 2 * 16 + 4 * 32
    assert grid.fragment_area.sum() == pytest.approx(160.0)
    assert grid.solid_count * grid.voxel_volume == pytest.approx(128.0)


def test_separate_parts_are_trusted():
    grid = voxelize(joined(BALL, BALL.moved((2.5, 0.0, 0.0))), 1 / 16)
    assert grid.unscaled_because == ""
    assert grid.body_volume == pytest.approx(2 * BALL.volume)


@pytest.mark.parametrize("side", [(0, 0, 1), (1, 0, 0), (0, -1, 0)])
def test_a_box_without_lid_fills(side):
    box = shapes.box((8.0, 6.0, 7.0))
    cup = without(box, normals(box) @ np.array(side) > 0.5)
    grid = voxelize(cup, 1.0)
    assert grid.solid.all() and grid.solid.shape == (8, 6, 7)
    assert (grid.area_ratio, grid.volume_ratio) == (1.0, 1.0)
    assert "open" in grid.unscaled_because
    # What closes it is exposed too, and is no surface of the mesh to the thesis.
    assert grid.fragment_area.sum() == pytest.approx(box.area)
    thesis = voxelize(cup, 1.0, "dominant_axis")
    assert thesis.fragment_area.sum() == pytest.approx(cup.area)


@pytest.mark.parametrize("seed", range(3))
def test_a_ball_with_holes_fills(seed):
    towards = np.random.default_rng(seed).normal(size=(4, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    holed = without(BALL, (normals(BALL) @ towards.T > np.cos(0.15)).any(1))
    closed = voxelize(BALL, 1 / 20)
    grid = voxelize(holed, 1 / 20)
    assert np.count_nonzero(grid.solid != closed.solid) < 0.02 * closed.solid_count
    # Steps of voxels close the holes.
    assert grid.fragment_area.sum() == pytest.approx(BALL.area, rel=2e-2)
    thesis = voxelize(holed, 1 / 20, "dominant_axis")
    assert thesis.fragment_area.sum() == pytest.approx(holed.area, rel=1e-2)
    assert grid.area_ratio == 1.0


def test_a_mesh_far_from_the_origin_is_the_same():
    near = voxelize(BALL, 1 / 16)
    far = voxelize(BALL.moved((1e4, -2e4, 3e4)), 1 / 16)
    assert np.count_nonzero(near.solid != far.solid) <= 6
    assert far.fragment_area.sum() == pytest.approx(near.fragment_area.sum())
