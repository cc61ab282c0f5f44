"""Equal objects are one object while it is in use, and are not kept beyond that."""

import gc
import weakref

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.memo.shared import shared
from jaxthermo.voxels.voxelize import _voxelized


class Box:
    """An object that is compared by identity."""


def test_equal_inputs_give_one_object():
    first = shared("box", (1.0, np.arange(3)), Box)
    assert shared("box", (1.0, np.arange(3)), Box) is first
    assert shared("box", (1.0, np.arange(4)), Box) is not first
    assert shared("crate", (1.0, np.arange(3)), Box) is not first


def test_an_object_that_nobody_uses_ends():
    first = weakref.ref(shared("box", 2.0, Box))
    gc.collect()
    assert first() is None


def test_inputs_without_known_content_are_never_equal():
    unknown = object()
    first = shared("box", unknown, Box)
    assert shared("box", unknown, Box) is not first


def test_equal_meshes_have_one_grid_with_what_follows_from_it():
    grid = jt.voxelize(jt.shapes.cone(0.04, 0.08), 0.02)
    again = jt.voxelize(jt.shapes.cone(0.04, 0.08), 0.02)
    assert again is grid
    built = jt.Aggregate(grid, factor=2).built
    assert jt.Aggregate(again, factor=2).built is built
    alone = _voxelized(jt.shapes.cone(0.04, 0.08), 0.02, "crossings")
    np.testing.assert_array_equal(grid.solid, alone.solid)
    np.testing.assert_array_equal(grid.fragment_position, alone.fragment_position)
    np.testing.assert_array_equal(grid.fragment_area, alone.fragment_area)


@pytest.mark.parametrize(
    "other",
    [
        lambda mesh: jt.voxelize(mesh, 0.015),
        lambda mesh: jt.voxelize(mesh, 0.02, surface_cells="dominant_axis"),
        lambda mesh: jt.voxelize(mesh.moved((0.001, 0.0, 0.0)), 0.02),
        lambda mesh: jt.voxelize(jt.Mesh(mesh.vertices, mesh.faces, "other"), 0.02),
    ],
    ids=["pitch", "surface", "place", "name"],
)
def test_unlike_arguments_have_grids_of_their_own(other):
    mesh = jt.shapes.cone(0.04, 0.08)
    grid = jt.voxelize(mesh, 0.02)
    assert other(mesh) is not grid
    # The first is found again after the other.
    assert jt.voxelize(mesh, 0.02) is grid
