"""Volumes of cut voxels: none so small that it sets the step, the total kept."""

import numpy as np
import pytest
from voxel_bodies import dense_volumes

from jaxthermo.geometry import shapes
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.cut_links import CutLinks
from jaxthermo.voxels.cut_voxels import MIN_OPEN, CutVoxels, limited
from jaxthermo.voxels.voxelize import voxelize


def solid_block(*shape):
    return np.ones(shape, bool)


def cut(voxel, volume):
    none = np.zeros((0, 3), int)
    links = CutLinks(none, none, np.zeros(0))
    return CutVoxels(
        voxel=np.array(voxel),
        volume=np.array(volume),
        section=np.ones((len(voxel), 3)),
        links=links,
    )


def test_a_sliver_takes_from_its_neighbours_until_it_keeps_the_step():
    raised = limited(cut([[0, 0, 0]], [0.1]), solid_block(3, 3, 3))
    volume = dense_volumes(raised, (3, 3, 3))
    assert volume.sum() == pytest.approx(26.1, rel=1e-14)
    # Three neighbours: its step is volume / 3, of a whole voxel inside 1 / 6.
    assert volume[0, 0, 0] == pytest.approx(0.72 / 6 * 3)
    neighbours = volume[[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert neighbours == pytest.approx(1 - (0.36 - 0.1) / 3)
    assert np.count_nonzero(volume != 1) == 4


def test_large_volumes_stay():
    voxel = [[0, 0, 0], [1, 1, 1]]
    volume = [0.6, 1.4]
    raised = limited(cut(voxel, volume), solid_block(2, 2, 2))
    np.testing.assert_array_equal(raised.voxel, voxel)
    np.testing.assert_array_equal(raised.volume, volume)


def test_a_body_of_one_thin_voxel_keeps_its_volume():
    raised = limited(cut([[0, 0, 0]], [0.2]), solid_block(1, 1, 1))
    assert raised.volume.tolist() == [0.2]
    assert limited(cut([[0, 0, 0]], [-0.1]), solid_block(1, 1, 1)).volume >= MIN_OPEN


@pytest.mark.parametrize("offset", [0.0, 0.17, 0.5, 0.83])
def test_no_voxel_of_a_body_has_a_step_shorter_than_that(offset):
    """0.7 of the step of a voxel inside, without what the surface exchanges."""
    mesh = shapes.sphere(1.0).moved((offset / 9, 0.0, 0.0))
    structure = FullVolume(voxelize(mesh, 1 / (9 + offset), "crossings"), stencil=False)
    links = structure.links()
    nodes = structure.nodes()
    conductance = links.area / (links.distance_src + links.distance_dst)
    ends = np.concatenate([links.src, links.dst])
    rate = np.bincount(ends, np.tile(conductance, 2)) / nodes.volume
    assert rate.max() * structure.grid.pitch**2 / 6 <= 1 / 0.7 * (1 + 1e-3)
