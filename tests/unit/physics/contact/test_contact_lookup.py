"""Fragment of a surface point, against a comparison with all fragments."""

import numpy as np
import pytest
from placed import ball_grid, box_grid

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.physics.contact.shares import (
    MAX_FRAGMENT_DISTANCE,
    _nearest_fragments,
)
from jaxthermo.voxels.voxelize import voxelize


BALL = ball_grid(0.9, 0.2)
BOX = box_grid((1.0, 1.0, 0.6), 0.2)


def on_surface(grid, count, seed=0):
    """Random points on a mesh, spread by area, and their triangles."""
    random = np.random.default_rng(seed)
    area = np.linalg.norm(grid.mesh.area_vectors, axis=1)
    triangle = random.choice(len(area), count, p=area / area.sum())
    weights = random.dirichlet((1.0, 1.0, 1.0), count)
    corners = grid.mesh.triangles[triangle]
    return (weights[..., None] * corners).sum(1), triangle


def test_points_on_a_box_lie_in_the_square_of_their_fragment():
    point, triangle = on_surface(BOX, 500)
    fragment = _nearest_fragments(BOX, point, triangle)
    assert (fragment >= 0).all()
    apart = np.abs(point - BOX.fragment_position[fragment])
    axis = BOX.fragment_axis[fragment]
    assert apart.max() <= 0.1 + 1e-9
    assert apart[np.arange(500), axis] == pytest.approx(np.zeros(500), abs=1e-12)


def test_points_on_a_ball_find_one_as_near_as_its_rays_are():
    point, triangle = on_surface(BALL, 500)
    fragment = _nearest_fragments(BALL, point, triangle)
    assert (fragment >= 0).all()
    apart = np.linalg.norm(point[:, None] - BALL.fragment_position, axis=2)
    mine = apart[np.arange(500), fragment]
    assert mine.max() < 1.3 * BALL.pitch
    # The ray of one's own dominant axis, if not the very nearest fragment.
    assert (mine - apart.min(1)).max() < 0.7 * BALL.pitch
    vectors = BALL.mesh.area_vectors[triangle]
    assert ((vectors * BALL.fragment_normal[fragment]).sum(1) > 0).all()


def test_thin_sheets_keep_their_sides_apart():
    sheet = box_grid((2.0, 2.0, 0.2), 0.2)
    point, triangle = on_surface(sheet, 300, seed=1)
    fragment = _nearest_fragments(sheet, point, triangle)
    vectors = sheet.mesh.area_vectors[triangle]
    assert ((vectors * sheet.fragment_normal[fragment]).sum(1) > 0).all()


def test_a_part_without_voxels_has_no_fragments():
    """A needle far from the box, thinner than a voxel and between the rays."""
    needle = box_grid((0.02, 0.02, 0.5), 0.02).mesh.moved((1.35, 0.05, 0.0))
    block = BOX.mesh
    faces = np.concatenate([block.faces, needle.faces + len(block.vertices)])
    mesh = Mesh(np.concatenate([block.vertices, needle.vertices]), faces)
    grid = voxelize(mesh, 0.2)
    far = np.flatnonzero(mesh.triangles.mean(1)[:, 0] > 1.0)
    point = mesh.triangles[far].mean(1)
    apart = np.linalg.norm(point[:, None] - grid.fragment_position, axis=2).min(1)
    assert (apart > MAX_FRAGMENT_DISTANCE * grid.pitch).all()
    assert (_nearest_fragments(grid, point, far) == -1).all()
