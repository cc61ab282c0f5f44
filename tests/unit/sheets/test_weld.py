"""Joining triangles: gaps, T-junctions, faces that occur twice or have no area."""

from dataclasses import replace

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.sheets.cells import sheet_cells
from tests.sheets import grid_plate, meshes_together


def soup(mesh):
    """Every face with vertices of its own."""
    return Mesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        np.arange(3 * len(mesh.faces)).reshape(-1, 3),
    )


def test_a_box_of_loose_faces_is_closed():
    box = shapes.box((0.4, 0.3, 0.2))
    cells = sheet_cells(soup(box), pitch=0.1)
    assert cells.border == 0
    assert cells.welded.welded_vertices == 3 * len(box.faces) - 8
    assert cells.node_count == sheet_cells(box, pitch=0.1).node_count


def test_double_faces_and_faces_without_area_are_dropped_and_counted():
    box = shapes.box((0.4, 0.3, 0.2))
    extra = np.array([box.faces[3], box.faces[5, ::-1], [0, 0, 1], [2, 2, 2]])
    mesh = replace(box, faces=np.concatenate([box.faces, extra]))
    cells = sheet_cells(mesh, pitch=0.1)
    assert (cells.welded.double_faces, cells.welded.degenerate_faces) == (2, 2)
    assert cells.area.sum() == pytest.approx(box.area, rel=1e-12)


@pytest.mark.parametrize("gap", [0.0, 5e-4])
def test_a_t_junction_is_closed_within_the_weld(gap):
    left = grid_plate(np.array([0, 0.5]), np.linspace(0, 0.4, 5))
    right = grid_plate(np.array([0.5 + gap, 1.0]), np.linspace(0, 0.4, 4))
    mesh = meshes_together(left, right)
    perimeter = 2 * (1.0 + 0.4)
    joined = sheet_cells(mesh, pitch=0.1, weld=1e-3)
    assert joined.open_seams == 0
    assert joined.border == pytest.approx(perimeter, rel=1e-3)
    assert joined.welded.cut_edges > 0
    # The area of the mesh, not of the welded one.
    assert joined.area.sum() == pytest.approx(mesh.area, rel=1e-12)
    apart = sheet_cells(mesh, pitch=0.1)
    if gap:
        assert apart.border == pytest.approx(perimeter + 0.8, rel=1e-3)
        assert apart.open_seams == pytest.approx(0.8, rel=0.15)
    else:
        assert apart.border == pytest.approx(perimeter)
        assert apart.open_seams == 0


def test_a_weld_does_not_collapse_a_row_of_points():
    plate = grid_plate(np.linspace(0, 1, 101), np.array([0, 1.0]))
    cells = sheet_cells(plate, pitch=0.25, weld=0.011)
    assert cells.border == pytest.approx(4.0)
    assert cells.area.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("weld", [1e-3, 4e-3])
def test_strips_within_the_weld_keep_their_area(weld):
    """Their faces collapse into lines and points, whose nodes have their area."""
    x = np.array([0, 0.3, 0.5, 0.5005, 0.5016, 0.503, 0.8, 1.0])
    y = np.array([0, 0.2, 0.2009, 0.202, 0.6])
    plate = grid_plate(x, y)
    cells = sheet_cells(plate, pitch=0.2, weld=weld)
    assert cells.welded.welded_vertices > 0
    assert (cells.face_area > 0).all()
    assert cells.area.sum() == pytest.approx(plate.area, rel=1e-12)
    assert cells.fragments.area.sum() == pytest.approx(plate.area, rel=1e-12)


def test_needles_end_in_few_pieces():
    needle = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1e-3, 0]]), np.array([[0, 1, 2]]))
    cells = sheet_cells(needle, pitch=0.02)
    assert len(cells.faces) <= 4 * 100
