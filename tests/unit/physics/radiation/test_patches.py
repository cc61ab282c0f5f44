"""Fragments in patches: few enough, complete, and found again from any point."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box
from jaxthermo.geometry.vectors import triangle_normals, unit_vectors
from jaxthermo.physics.radiation.patches import SolidPatches
from jaxthermo.sheets.cells import sheet_cells
from jaxthermo.sheets.sheet_grid import sheet_grid
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import in_patches, moved, shell
from tests.sheets import rotation, turned, uneven_strip


@pytest.fixture(scope="module")
def hollow():
    """A hollow ball: all slopes, and two surfaces close to each other."""
    return voxelize(shell(0.1, 0.14), 0.02)


@pytest.fixture(scope="module")
def block():
    return voxelize(box((0.2, 0.11, 0.07)), 0.01)


@pytest.mark.parametrize("max_patches", [6, 30, 200])
def test_no_more_than_asked_for_and_nothing_lost(hollow, max_patches):
    patches = in_patches(hollow, max_patches).patches
    # Six more for the cavity, which has patches of its own.
    assert 6 <= patches.count <= max_patches + 6
    assert_array_equal(np.unique(patches.patch), np.arange(patches.count))
    assert patches.area.sum() == pytest.approx(hollow.fragment_area.sum(), rel=1e-12)
    moment = patches.area @ patches.centre
    expected = hollow.fragment_area @ hollow.fragment_position
    assert_allclose(moment, expected, rtol=1e-12, atol=1e-12)


def patches_at(body, points, normals):
    """Patches of points in the frame of a body, on faces with about these normals."""
    face_normal = unit_vectors(triangle_normals(body.vertices[body.faces]))
    solids = SolidPatches.of_bodies((body,), face_normal)
    return solids.at(
        body.pose.to_world(points),
        face=(body.pose.rotate(normals) @ face_normal.T).argmax(1),
        space=np.zeros(len(points), int),
    )


def test_a_patch_faces_one_way(hollow):
    patches = in_patches(hollow, 200).patches
    axis = np.abs(hollow.fragment_normal).argmax(1)
    rows = np.arange(len(axis))
    side = 2 * axis + (hollow.fragment_normal[rows, axis] > 0)
    for number in range(patches.count):
        assert len(np.unique(side[patches.patch == number])) == 1


@pytest.mark.parametrize("seed", range(4))
def test_points_near_fragments_are_in_their_patches(block, seed):
    random = np.random.default_rng(seed)
    grid = block
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    pose = moved(0.3, y=-2.0, z=1.0, rotation=turn)
    body = in_patches(grid, int(random.integers(6, 100)), pose)
    patch = body.patches.patch
    position = grid.fragment_position
    normal = grid.fragment_normal
    assert_array_equal(patches_at(body, position, normal), patch)
    # Anywhere on the fragment's own square, above or below by rounding.
    shift = random.uniform(-0.0049, 0.0049, position.shape) * (np.abs(normal) < 0.5)
    off = shift + normal * random.uniform(-1e-12, 1e-12, (len(position), 1))
    assert_array_equal(patches_at(body, position + off, normal), patch)


def test_where_no_fragment_is_the_nearest_patch_of_that_side(hollow):
    body = in_patches(hollow, 200)
    patches = body.patches
    points = np.array([[0.0, 0.0, 0.15], [0.0, 0.0, -0.15]])
    patch = patches_at(body, points, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    assert (patches.code[patch] % 6 == [5, 4]).all()
    assert patches.centre[patch[0], 2] > 0.05 and patches.centre[patch[1], 2] < -0.05


def test_points_on_needles_of_a_thin_wall_are_in_the_patch_of_the_nearest_third():
    mesh = turned(uneven_strip(1.0, 0.4), rotation(1))
    pitch = 0.05
    grid = sheet_grid(mesh, sheet_cells(mesh, pitch=pitch))
    body = in_patches(grid, 40)
    random = np.random.default_rng(0)
    # As many points everywhere, and some beyond the corners by rounding.
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    face = random.choice(len(area), 4000, p=area / area.sum())
    share = random.dirichlet(np.ones(3), len(face))
    share[:10] = np.eye(3)[random.integers(0, 3, 10)] * (1 + 1e-12)
    points = np.einsum("kc,kcd->kd", share, mesh.vertices[mesh.faces[face]])
    assert body.wall is not None
    patch = body.wall.patches_at(points, face)
    thirds = grid.thirds.position
    of_third = np.repeat(grid.cells.face_origin, 3)
    gaps = np.linalg.norm(points[:, None] - thirds, axis=2)
    gaps[face[:, None] != of_third] = np.inf
    fragment = grid.cells.fragments.of_corner.ravel()
    front = body.patches.patch[: len(grid.fragment_area) // 2][fragment]
    nearest = front[gaps.argmin(axis=1)]
    smallest = gaps.min(axis=1)
    # Another one only where a third of it is as near but for the size of a cell.
    differs = patch[0] != nearest
    gaps[front != patch[0][:, None]] = np.inf
    assert (gaps.min(axis=1) - smallest <= pitch / 8 * np.sqrt(2)).all()
    assert differs.mean() < 0.05
    # The patches have the areas of their fragments.
    counted = np.bincount(patch[0], minlength=body.patches.count) / len(face)
    expected = np.bincount(
        body.patches.patch, grid.fragment_area, body.patches.count
    ) * (counted > 0)
    assert_allclose(counted, expected / expected.sum(), atol=0.01)


def test_too_few_are_refused(hollow):
    with pytest.raises(InputError, match="5 patches a body: give 6"):
        in_patches(hollow, 5)
