"""Full volume: a lattice for explicit steps, links for the solves of a sparse body."""

import jaxthermo as jt


def test_solves_of_a_sparse_body_store_the_links():
    grid = jt.voxelize(jt.shapes.cone(0.03, 0.06), 0.004, "crossings")
    structure = jt.FullVolume(grid)
    assert len(structure.state_shape) == 3
    assert len(structure.for_solves().state_shape) == 1
