"""Links of cut voxels: open areas, and slivers over the concave edges of the steps."""

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.cut_links import Sides, cut_links
from jaxthermo.voxels.voxel_bits import VoxelBits
from jaxthermo.voxels.voxelize import voxelize


def test_links_of_a_box_have_its_section():
    grid = voxelize(shapes.box((0.14, 0.114, 0.198)), 0.01, "crossings")
    assert grid.cut is not None
    links = grid.cut.links
    assert not links.over_edge.any()
    # The 12 voxels across y are 11.4 wide: 0.7 of a face at either side.
    is_open = np.isclose(links.extra, -0.3)
    assert is_open.any() and not links.step[is_open, 1].any()
    edge = np.isclose(links.extra, 0.7 * 0.9 - 1)
    assert edge.any() and (links.step[edge, 0] == 1).all()
    assert set(np.round(1 + links.extra, 9)) == {0.7, 0.9, 0.63}


def one_step(normal, excess):
    """A step of three voxels, whose two cells face +x and +y with one normal."""
    solid = np.array([[True, True], [True, False]])[..., None]
    voxel = np.array([[0, 1, 0], [1, 0, 0]])
    cell = np.full((3, 2, 2), -1, np.int32)
    cell[[0, 1], 1, [0, 1]] = 0, 1
    sides = Sides(cell=cell, excess=np.full(2, excess), normal=np.tile(normal, (2, 1)))
    number = VoxelBits.of(solid).number(tuple(voxel.T))
    return cut_links(number, section=np.ones((2, 3)), sides=sides, solid=solid)


def test_the_sliver_of_one_step_at_45_degrees():
    links = one_step(np.array([1.0, 1.0, 0.0]) / np.sqrt(2), 0.0)
    # A quarter: over the edge a gradient along the surface passes sqrt(1/8) h.
    assert links.step.tolist() == [[1, -1, 0]] and links.voxel.tolist() == [[0, 1, 0]]
    assert links.extra == pytest.approx(0.25)


@pytest.mark.parametrize("slope", [0.2, 0.7, 1.3])
def test_a_sliver_conducts_along_its_surface_and_not_across(slope):
    """The dissipation of T = g . x is that of the sliver for g along the surface."""
    normal = np.array([slope, 1.0, 0.0]) / np.hypot(slope, 1)
    links = one_step(normal, 0.0)
    difference = links.step @ np.array([normal, [-normal[1], normal[0], 0.0]]).T
    across, along = links.extra @ np.square(difference)
    assert across == pytest.approx(0.0, abs=1e-14)
    # Its width times the way along the surface from one voxel to the other.
    width = (normal[0] + normal[1]) / 4
    assert along == pytest.approx(width * (normal[0] + normal[1]))


def test_edges_between_sheets_have_no_sliver():
    """The inner edge of an L, whose cells have normals at right angles."""
    solid = np.array([[True, True], [True, False]])[..., None]
    voxel = np.array([[0, 1, 0], [1, 0, 0]])
    cell = np.full((3, 2, 2), -1, np.int32)
    cell[[0, 1], 1, [0, 1]] = 0, 1
    sides = Sides(cell, np.zeros(2), np.eye(3)[:2])
    number = VoxelBits.of(solid).number(tuple(voxel.T))
    links = cut_links(number, section=np.ones((2, 3)), sides=sides, solid=solid)
    assert len(links.extra) == 0


def test_a_structure_has_all_links_once_in_order():
    structure = FullVolume(voxelize(shapes.sphere(1.0), 1 / 6.3, "crossings"))
    links = structure.links()
    assert structure.link_count == len(links.src)
    key = links.src.astype(int) * structure.node_count + links.dst
    assert (np.diff(key) > 0).all() and (links.src < links.dst).all()
    assert (links.area > 0).all()
    straight = structure.nodes().location
    straight = np.linalg.norm(straight[links.dst] - straight[links.src], axis=1)
    assert links.distance_src + links.distance_dst == pytest.approx(straight)
