"""Surface cells from all crossings: one on every exposed face, with true areas."""

import numpy as np
import pytest
from voxel_bodies import BALL, inverted, joined, without

from jaxthermo.geometry import shapes
from jaxthermo.voxels.crossings import find_crossings
from jaxthermo.voxels.fill import fill_by_vote
from jaxthermo.voxels.lattice import Lattice, peel_axes
from jaxthermo.voxels.surface import face_axes
from jaxthermo.voxels.voxelize import voxelize


def crossings(mesh, pitch):
    lattice = Lattice.around(mesh, pitch)
    views = peel_axes(mesh, lattice)
    solid = fill_by_vote(views, lattice.shape)
    normals, _ = face_axes(mesh)
    cells, _ = find_crossings(
        views, solid=solid, normals=normals, is_closed=mesh.is_watertight
    )
    return cells, solid


def exposed_faces(solid):
    return sum(
        np.abs(np.diff(np.pad(solid, 1).astype(int), axis=a)).sum() for a in (0, 1, 2)
    )


@pytest.fixture(scope="module")
def ball():
    return voxelize(BALL, 1 / 12.3, "crossings")


def test_every_exposed_face_has_one_cell(ball):
    cells, solid = crossings(BALL, 1 / 12.3)
    assert cells.on_face.all() and len(cells.axis) == exposed_faces(solid)
    side = np.column_stack([cells.number, cells.axis, cells.ahead])
    assert len(np.unique(side, axis=0)) == len(side)
    assert len(ball.fragment_area) == len(side)


def test_cells_are_on_the_surface_and_their_feet_are_nearest_to_the_nodes(ball):
    for points in (ball.fragment_position, ball.fragment_foot):
        # Chords of the mesh's facets, and the tangent plane at the crossing.
        assert np.linalg.norm(points, axis=1) == pytest.approx(1.0, abs=6e-3)
    centre = ball.lattice.centres(ball.fragment_voxel)
    away = ball.fragment_foot - centre
    assert np.cross(away, ball.fragment_normal) == pytest.approx(0, abs=1e-12)
    depth = 1 - np.linalg.norm(centre, axis=1)
    # Nodes nearer than a tenth of a voxel along a ray count as that far.
    assert ball.fragment_depth == pytest.approx(depth, abs=0.1 * ball.pitch)
    assert (ball.fragment_depth > 0).all()


@pytest.mark.parametrize("cells", [6.0, 8.0, 12.0, 12.5, 20.3])
def test_area_and_volume_of_a_ball_before_any_scaling(cells):
    """The mesh's own area, and a volume of second order."""
    grid = voxelize(BALL, 1 / cells, "crossings")
    assert grid.area_ratio == pytest.approx(1.0, abs=1e-3)
    assert grid.volume_ratio == pytest.approx(1.0, abs=0.2 / cells**2)
    assert grid.fragment_area.sum() == pytest.approx(BALL.area, rel=1e-12)
    assert grid.body_volume == pytest.approx(BALL.volume, rel=1e-12)


def test_a_box_is_exact_whatever_its_size():
    size = 0.140, 0.114, 0.198
    grid = voxelize(shapes.box(size), 0.01, "crossings")
    assert grid.volume_ratio == pytest.approx(1.0, abs=1e-12)
    assert grid.area_ratio == pytest.approx(1.0, abs=1e-12)
    for axis in range(3):
        on_axis = np.abs(grid.fragment_normal[:, axis]) > 0.9
        expected = 2 * np.prod(size) / size[axis]
        assert grid.fragment_area[on_axis].sum() == pytest.approx(expected, rel=1e-12)
    # Each node has the part of the box that is nearest to it.
    assert grid.volume_at(np.argwhere(grid.solid)).sum() == pytest.approx(np.prod(size))
    represented = grid.represented
    assert represented is not None and not represented.is_off
    assert represented.smallest_section.true == pytest.approx(0.140 * 0.114)
    assert represented.smallest_section.represented == pytest.approx(0.140 * 0.114)


def test_vector_areas_close():
    """A constant flux brings no heat in sum: the cells of a body are closed."""
    for mesh in (BALL, shapes.cone(1.0, 2.0), shapes.tube(1.1, 0.85, 0.9)):
        grid = voxelize(mesh, 1 / 12.3, "crossings")
        total = (grid.fragment_area[:, None] * grid.fragment_normal).sum(axis=0)
        assert total == pytest.approx(0, abs=2e-3 * mesh.area), mesh.name


def test_a_centre_on_the_surface_has_its_crossing():
    """Where a centre is as good as on the surface the vote may put it inside or not."""
    # 34.0 voxels to the inside of the wall, with centres at whole numbers.
    mesh = shapes.tube(0.11, 0.085, 0.01, sections=720)
    grid = voxelize(mesh, 0.0025, "crossings")
    assert grid.area_ratio == pytest.approx(1.0, abs=2.5e-3)
    inner = np.hypot(*grid.fragment_position[:, :2].T) < 0.0975
    inner &= np.abs(grid.fragment_normal[:, 2]) < 0.9
    expected = 2 * np.pi * 0.085 * 0.01
    assert grid.fragment_area[inner].sum() == pytest.approx(expected, rel=4e-3)


def test_the_vote_closes_holes_with_whole_faces():
    box = shapes.box((0.1, 0.1, 0.1))
    lidless = without(box, box.area_vectors[:, 2] > 0)
    grid = voxelize(lidless, 0.01, "crossings")
    assert grid.solid_count == 1000 and "open" in grid.unscaled_because
    assert grid.fragment_area.sum() == pytest.approx(0.06)
    lid = grid.fragment_normal[:, 2] > 0.9
    assert lid.sum() == 100 and grid.represented is None
    assert grid.fragment_position[lid, 2] == pytest.approx(0.05)


def test_a_cavity_has_cells_that_point_into_it():
    hollow = joined(shapes.sphere(1.0), inverted(shapes.sphere(0.5)))
    grid = voxelize(hollow, 0.08, "crossings")
    inner = np.linalg.norm(grid.fragment_position, axis=1) < 0.75
    outward = (grid.fragment_position * grid.fragment_normal).sum(axis=1)
    assert (outward[inner] < 0).all() and (outward[~inner] > 0).all()
    areas = [grid.fragment_area[side].sum() for side in (inner, ~inner)]
    assert areas == pytest.approx([np.pi, 4 * np.pi], rel=0.02)
    assert set(grid.fragment_cavity[inner]) == {1}
    assert set(grid.fragment_cavity[~inner]) == {0}


def block_and_sheet(where):
    """A block of 6 x 6 x 6 voxels and a sheet 0.4 voxels thick that it holds."""
    sheet = shapes.box((8.0, 6.0, 0.4)).moved((7.5, 0.0, where))
    return joined(shapes.box((6.0, 6.0, 6.0)), sheet)


def test_a_sheet_on_voxel_centres_has_its_own_volume():
    grid = voxelize(block_and_sheet(0.5), 1.0, "crossings")
    assert grid.body_volume == pytest.approx(216 + 8 * 6 * 0.4, rel=2e-3)
    assert grid.thin.thin_area > 90 and grid.thin.lost_area == 0


def test_a_sheet_between_voxel_centres_keeps_its_heat_where_a_node_is_near():
    grid = voxelize(block_and_sheet(0.0), 1.0, "crossings")
    near = 216 + 1.0 * 6 * 0.4
    assert grid.body_volume == pytest.approx(near, rel=2e-3)
    # What is far from any node is lost, and nothing else stands for it.
    assert grid.thin.lost_area == pytest.approx(84.0, rel=0.05)
    assert grid.area_ratio == 1.0 and grid.represented is not None
    assert grid.represented.is_off
    assert grid.fragment_position[:, 0].max() < 6.0


def test_thin_parts_are_those_along_the_dominant_axis():
    assert voxelize(BALL, 1 / 15, "crossings").thin.thin_fragments == 0


def test_packed_layers_are_those_of_the_dominant_axis():
    """Thesis 4.2: each piece of surface once, in front."""
    mesh = shapes.figurine()
    ours, thesis = (voxelize(mesh, 5e-3, k) for k in ("crossings", "dominant_axis"))
    assert ours.layers == thesis.layers
    assert sum(ours.layers.packed) <= 0.8 * sum(ours.layers.peeled)
    is_main = np.abs(ours.fragment_normal).argmax(1) == ours.fragment_axis
    np.testing.assert_array_equal(ours.fragment_layer[:, 1] >= 0, is_main)
