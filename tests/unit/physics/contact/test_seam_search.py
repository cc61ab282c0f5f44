"""Seams at the borders of sheets: what they join, along which length."""

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.seam_search import SeamPairs, seams_between
from jaxthermo.sheets.sheet_grid import BACK, FRONT
from tests.sheet_bodies import plate
from tests.unit.physics.contact.placed import box_grid, pose


PITCH = 0.05


@functools.cache
def sheet_grid(turned_over=False, pitch=PITCH):
    mesh = plate(0.3, 0.1)
    faces = mesh.faces[:, ::-1] if turned_over else mesh.faces
    layers = (jt.Layer("copper", 1e-3),)
    return jt.Sheet(Mesh(mesh.vertices, faces), layers, pitch=pitch).grid


def sheet(translation=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), **options):
    return PlacedGrid(sheet_grid(**options), pose(translation, turn))


def seam(first, second, threshold=None):
    seams = seams_between((first, second), threshold)
    return seams.get((0, 1), SeamPairs.none())


@pytest.mark.parametrize("turned_over", [False, True])
@pytest.mark.parametrize("angle", [0.0, 90.0, -40.0])
def test_two_borders_that_meet_are_one_seam(turned_over, angle):
    """Along the common edge alone, not along the edges that go away from it."""
    radians = np.radians(angle)
    centre = (0.15 + 0.15 * np.cos(radians), 0.0, -0.15 * np.sin(radians))
    pairs = seam(
        sheet(), sheet(centre, (0.0, angle, 0.0), turned_over=turned_over, pitch=0.03)
    )
    assert pairs.length.sum() == pytest.approx(0.1, rel=1e-12)
    assert not pairs.on_face_a.any()
    assert not pairs.on_face_b.any()
    first = sheet_grid()
    second = sheet_grid(turned_over, 0.03)
    assert (first.fragment_face[pairs.fragment_a] == FRONT).all()
    # Of upright sheets neither way round is the same.
    if angle != 90.0:
        side = BACK if turned_over else FRONT
        assert (second.fragment_face[pairs.fragment_b] == side).all()
    assert_allclose(first.fragment_foot[pairs.fragment_a][:, 0], 0.15, atol=1e-12)


def test_a_sheet_ends_on_the_face_of_another():
    upright = sheet((0.02, 0.0, -0.15), (0.0, 90.0, 0.0))
    for pairs in (seam(sheet(), upright), seam(upright, sheet()).swapped()):
        assert pairs.length.sum() == pytest.approx(0.1, rel=1e-12)
        assert pairs.on_face_a.all()
        assert not pairs.on_face_b.any()
        assert (sheet_grid().fragment_face[pairs.fragment_a] == BACK).all()
        x = sheet_grid().fragment_foot[pairs.fragment_a][:, 0]
        assert_allclose(x, 0.02, atol=PITCH)


def test_a_sheet_ends_on_a_solid():
    block = PlacedGrid(box_grid((0.1, 0.2, 0.2), 0.02), pose((0.2, 0.0, 0.0)))
    pairs = seam(sheet(), block)
    assert pairs.length.sum() == pytest.approx(0.1, rel=1e-12)
    grid = block.grid
    assert (grid.fragment_normal[pairs.fragment_b][:, 0] < -0.99).all()
    by_row = np.bincount(
        np.round(grid.fragment_position[pairs.fragment_b][:, 1] / 0.01).astype(int) + 9,
        pairs.length,
    )
    expected = np.array([0.01, 0.02, 0.02, 0.02, 0.02, 0.01])
    assert_allclose(by_row[by_row > 0], expected, atol=0.1 / 32)


def test_gaps_up_to_the_threshold_count():
    for gap, threshold, joins in (
        (0.004, None, True),
        (0.006, None, False),
        (0.006, 0.01, True),
        (0.0011, 0.001, False),
    ):
        pairs = seam(sheet(), sheet((0.3 + gap, 0.0, 0.0)), threshold)
        assert bool(pairs.rows) == joins
        if joins:
            assert pairs.length.sum() == pytest.approx(0.1, rel=1e-12)


def test_solids_and_sheets_that_are_apart_have_none():
    block = PlacedGrid(box_grid((0.1, 0.2, 0.2), 0.02), pose())
    beside = PlacedGrid(box_grid((0.1, 0.2, 0.2), 0.02), pose((0.1, 0.0, 0.0)))
    assert not seam(block, beside).rows
    assert not seam(sheet(), sheet((0.0, 0.0, 0.02))).rows
