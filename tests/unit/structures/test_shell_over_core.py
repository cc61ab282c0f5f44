"""Single voxels over blocks: which is which, and that nothing is lost."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_volumes import assert_links, ball, parts_of, solids

from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import ShellOverCore
from jaxthermo.structures.partition.blocks import voxel_layers
from tests.bodies import blocks


@settings(deadline=None, max_examples=25)
@given(solids(7), st.integers(1, 3), st.integers(1, 4))
def test_fine_layers_and_parts_of_blocks_make_up_the_body(solid, layers, factor):
    grid = blocks(solid, 0.5)
    structure = ShellOverCore(grid, layers, factor)
    nodes = structure.nodes()
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-13)
    fine = voxel_layers(grid, layers) >= 0
    assert np.count_nonzero(nodes.level == 0) == fine.sum()
    np.testing.assert_allclose(nodes.volume[nodes.level == 0], 0.5**3)
    core_count = 0
    core = np.argwhere(solid & ~fine)
    for block in np.unique(core // factor, axis=0):
        inside = core[(core // factor == block).all(1)]
        core_count += len(parts_of({tuple(cell) for cell in inside}, solid.shape))
    assert np.count_nonzero(nodes.level == 1) == core_count
    assert (nodes.level[structure.fragment_node()] == 0).all()


def test_the_coupling_is_between_the_two_levels():
    """Every face of the core towards the shell is in a link from level 0 to level 1."""
    structure = ShellOverCore(blocks(np.ones((10, 10, 10), bool)), 1, 4)
    level = structure.nodes().level
    links = structure.links()
    across = level[links.src] != level[links.dst]
    # Flat faces only: a core of 8^3 voxels, each fine voxel over one block.
    assert links.area[across].sum() == pytest.approx(6 * 8**2)
    fine_only = (level[links.src] == 0) & (level[links.dst] == 0)
    np.testing.assert_allclose(links.distance_src[fine_only], 0.5)


def test_a_deep_fragment_makes_its_voxel_fine():
    grid = blocks(np.ones((9, 9, 9), bool))
    deep = grid.fragment_voxel.copy()
    deep[5] = 4
    structure = ShellOverCore(replace(grid, fragment_voxel=deep), 1, 4)
    node = structure.fragment_node()[5]
    assert structure.nodes().level[node] == 0
    np.testing.assert_allclose(structure.nodes().centre[node], 4.5)


def test_layers_through_the_whole_body_leave_no_core():
    grid = blocks(ball(4.3), 0.5)
    structure = ShellOverCore(grid, layers=20)
    full = FullVolume(grid)
    assert structure.nodes().level.max() == 0
    assert_links(structure, full)
