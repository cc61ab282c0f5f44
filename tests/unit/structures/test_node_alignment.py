"""Nodes in line conduct a straight gradient as it is, whatever they are filled with."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import blocks


EDGE = 4


@pytest.fixture(scope="module")
def wedge():
    """Its lower side falls across x and y, so that blocks are filled unevenly."""
    x, y, z = np.indices((16, 12, 12))
    return blocks(z >= 8 - 0.4 * x + 0.2 * y)


def _axis(structure):
    """Of every link, and whether both its ends have neighbours along all axes."""
    nodes = structure.nodes()
    links = structure.links()
    block = ((nodes.centre - structure.grid.lattice.origin) / EDGE).astype(int)
    axis = np.argmax(block[links.src] != block[links.dst], axis=1)
    linked = np.zeros(block.shape, bool)
    linked[links.src, axis] = linked[links.dst, axis] = True
    alone = np.flatnonzero(~linked.all(axis=1))
    return axis, ~np.isin(links.src, alone) & ~np.isin(links.dst, alone)


def _flows(structure, gradient):
    """Through every link [W], of a straight field, for 1 W/(m K); and what they are."""
    nodes = structure.nodes()
    links = structure.links()
    theta = nodes.location @ gradient
    length = links.distance_src + links.distance_dst
    flow = links.area * (theta[links.dst] - theta[links.src]) / length
    axis, joined = _axis(structure)
    assert joined.sum() > 20
    return flow[joined], (links.area * gradient[axis])[joined]


@pytest.mark.parametrize("gradient", [(3.0, 0.0, 0.0), (0.0, 2.0, -1.0)])
def test_a_straight_field_flows_as_it_is(wedge, gradient):
    gradient = np.array(gradient)
    off = []
    for alignment in (0.0, 0.7, 1.0):
        structure = jt.Aggregate(
            wedge, EDGE, min_time_constant=0.0, alignment=alignment
        )
        flow, expected = _flows(structure, gradient)
        off.append(np.abs(flow - expected).max())
    assert off[2] < 1e-12 < off[1] < 0.5 * off[0]


def test_only_along_axes_with_neighbours(wedge):
    sheet = blocks(np.ones((8, 8, 1), bool))
    still, moved = (jt.Aggregate(sheet, EDGE, alignment=a).nodes() for a in (0.0, 1.0))
    np.testing.assert_array_equal(moved.location, still.location)
    alone = jt.Aggregate(blocks(np.ones((3, 2, 1), bool)), EDGE, alignment=1.0).nodes()
    np.testing.assert_array_equal(alone.location, alone.centre)
    nodes = jt.Aggregate(wedge, EDGE, alignment=1.0).nodes()
    assert np.abs(nodes.location - nodes.centre).max() > 0.5


def test_distances_reach_from_node_to_node(wedge):
    structure = jt.Aggregate(wedge, EDGE, min_time_constant=0.0, alignment=1.0)
    links = structure.links()
    location = structure.nodes().location
    length = links.distance_src + links.distance_dst
    apart = np.linalg.norm(location[links.dst] - location[links.src], axis=1)
    _, joined = _axis(structure)
    np.testing.assert_allclose(length[joined], apart[joined], rtol=1e-12)
    assert min(links.distance_src.min(), links.distance_dst.min()) > 0


@pytest.mark.parametrize("alignment", [-0.1, 1.1, np.nan])
def test_what_is_no_share_is_refused(wedge, alignment):
    with pytest.raises(jt.InputError, match="alignment="):
        jt.Aggregate(wedge, EDGE, alignment=alignment)
