"""Nodes, links and fragments of surfaces: areas to the last digit, no negative link."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.sheets.cells import sheet_cells


def assert_consistent(cells, area):
    links = cells.links
    assert cells.area.sum() == pytest.approx(area, rel=1e-12)
    assert cells.face_area.sum() == pytest.approx(area, rel=1e-12)
    by_node = np.zeros_like(cells.area)
    fragments = cells.fragments
    np.add.at(by_node, (fragments.node, fragments.part), fragments.area)
    np.testing.assert_allclose(by_node, cells.area, rtol=1e-9, atol=1e-12 * area)
    assert (np.diff(fragments.node) >= 0).all()
    assert (links.weight > 0).all()
    assert (links.src < links.dst).all()
    assert (np.diff(links.src) >= 0).all()
    triples = np.stack([links.src, links.dst, links.part], axis=1)
    assert len(np.unique(triples, axis=0)) == len(triples)


@pytest.mark.parametrize("nodes", ["cells", "vertices"])
def test_a_box_has_its_area_and_the_normals_of_its_sides(nodes):
    mesh = shapes.box((1.0, 0.5, 0.3))
    cells = sheet_cells(mesh, pitch=0.1, nodes=nodes)
    assert_consistent(cells, mesh.area)
    normals = np.abs(cells.fragments.normal)
    np.testing.assert_allclose(np.sort(normals, axis=1), [[0, 0, 1]] * len(normals))
    assert cells.border == 0


def test_two_sheets_in_one_cell_are_two_nodes():
    plate = np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    upper = plate + [0, 0, 0.001]
    mesh = Mesh(np.concatenate([plate, upper]), np.concatenate([faces, faces + 4]))
    cells = sheet_cells(mesh, pitch=0.05)
    assert cells.node_count == 2
    np.testing.assert_allclose(cells.area[:, 0], 4e-4)


def test_a_mesh_without_area_is_refused():
    line = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="no area: give a surface"):
        sheet_cells(line, pitch=0.1)


@pytest.mark.parametrize("sides", [(1.4, 1.4, 3.0), (4.0, 3.0, 2.0)])
def test_rounding_does_not_choose_between_nodes_at_one_distance(sides):
    box = shapes.box(sides)
    node = sheet_cells(box, pitch=1.0).vertex_node
    noise = np.random.default_rng(0)
    for _ in range(6):
        rounding = 1e-16 * noise.standard_normal(box.vertices.shape)
        rounded = Mesh(box.vertices + rounding, box.faces)
        np.testing.assert_array_equal(sheet_cells(rounded, pitch=1.0).vertex_node, node)
