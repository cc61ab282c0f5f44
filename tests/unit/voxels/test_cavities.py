"""Closed cavities: found in the voxels, told from openings, faced by fragments."""

import numpy as np
import pytest
from scipy import ndimage

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.voxels.cavities import find_cavities
from jaxthermo.voxels.lattice import Lattice
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import shell


def lattice(solid, pitch=0.5):
    return Lattice(solid.shape, np.array([1.0, -2.0, 0.0]), pitch)


def hollow():
    """A block with two cavities: one voxel, and a room of 2 x 3 x 1."""
    solid = np.ones((8, 7, 5), bool)
    solid[1, 1, 1] = False
    solid[4:6, 2:5, 2] = False
    return solid


def test_each_cavity_has_a_number():
    solid = hollow()
    cavities = find_cavities(solid, lattice(solid))
    assert cavities is not None and cavities.count == 2
    cells = np.indices(solid.shape).reshape(3, -1).T
    number = cavities.at(cavities.lattice.centres(cells)).reshape(solid.shape)
    np.testing.assert_array_equal(number < 0, solid)
    single = number[1, 1, 1]
    room = number[4, 2, 2]
    assert {int(single), int(room)} == {1, 2}
    assert (number[4:6, 2:5, 2] == room).all()
    middle = cavities.lattice.centres(np.array([[1, 1, 1], [5, 3, 2], [0, 0, 0]]))
    far = np.array([[99.0, 0.0, 0.0]])
    at = cavities.at(np.concatenate([middle, far]))
    np.testing.assert_array_equal(at, [single, room, -1, 0])


def test_runs_of_cavities_are_the_labels_of_all_voxels():
    solid = np.random.default_rng(2).random((9, 8, 7)) < 0.7
    cavities = find_cavities(solid, lattice(solid))
    label = np.zeros([n + 2 for n in solid.shape], np.int32)
    ndimage.label(np.pad(~solid, 1, constant_values=True), output=label)
    outside = label[0, 0, 0]
    inner = label[1:-1, 1:-1, 1:-1]
    expected = np.where(inner == outside, 0, inner - (inner > outside))
    cells = np.indices(solid.shape).reshape(3, -1).T
    assert cavities is not None and cavities.count == label.max() - 1 > 1
    np.testing.assert_array_equal(
        cavities.at(cavities.lattice.centres(cells)),
        np.where(solid, -1, expected).ravel(),
    )


@pytest.mark.parametrize(
    ("opened", "left"),
    [
        ((slice(4, 5), slice(2, 3), slice(0, 2)), 1),
        # Across an edge or a corner only, no air passes.
        ((slice(3, 4), slice(1, 2), slice(0, 2)), 2),
    ],
)
def test_a_path_to_the_outside_goes_through_faces(opened, left):
    solid = hollow()
    solid[opened] = False
    cavities = find_cavities(solid, lattice(solid))
    assert cavities is not None and cavities.count == left


def test_without_a_cavity_there_is_nothing():
    solid = np.ones((4, 4, 4), bool)
    assert find_cavities(solid, lattice(solid)) is None
    solid[1:3, 1:3, 2:] = False
    assert find_cavities(solid, lattice(solid)) is None


@pytest.mark.parametrize("pitch", [0.02, 0.0131])
def test_fragments_of_a_hollow_ball_face_it_inside_only(pitch):
    grid = voxelize(shell(0.1, 0.14), pitch)
    inside = np.linalg.norm(grid.fragment_position, axis=1) < 0.12
    np.testing.assert_array_equal(grid.fragment_cavity > 0, inside)


def test_walls_of_one_voxel():
    inner = box((0.6, 0.6, 0.6))
    outer = box((0.8, 0.8, 0.8))
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)])
    mesh = Mesh(np.concatenate([outer.vertices, inner.vertices]), faces, "case")
    grid = voxelize(mesh, 0.1)
    inside = np.abs(grid.fragment_position).max(1) < 0.35
    np.testing.assert_array_equal(grid.fragment_cavity > 0, inside)


def test_a_convex_body_needs_no_search(monkeypatch):
    grid = voxelize(sphere(0.1, 2), 0.02)
    monkeypatch.setattr("jaxthermo.voxels.grid.find_cavities", None)
    assert grid.cavities is None and not grid.fragment_cavity.any()
