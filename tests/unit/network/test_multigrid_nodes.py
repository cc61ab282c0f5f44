"""Groups are connected inside their blocks and conduct as their links do."""

import gc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.memo.found import findings_size
from jaxthermo.network.link_operator import LinkNetwork
from jaxthermo.network.multigrid import _lattice_levels, _node_levels, node_layout
from jaxthermo.network.network import AbstractNodeNetwork
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import Octree
from tests.bodies import blocks


_heat_rate = jax.jit(lambda network, state: network.heat_rate(state))
_diagonal = jax.jit(lambda network: network.diagonal())


def _levels(layout, network):
    assert isinstance(network, AbstractNodeNetwork)
    return _node_levels(layout, network)


def _body(solid):
    structure = FullVolume(blocks(solid), stencil=False)
    return structure, assemble_uniform(structure, 2.0, 1.0, np.float64)


def test_a_group_is_what_hangs_together_inside_a_block():
    """Two sheets in one block are two groups."""
    solid = np.ones((4, 4, 4), bool)
    solid[1] = False
    structure, network = _body(solid)
    coarse = node_layout(structure, 8).coarser[0]
    centre = structure.nodes().centre
    block = np.floor(centre / 2).astype(int)
    for group in range(coarse.group.max() + 1):
        members = np.flatnonzero(coarse.group == group)
        assert len(np.unique(block[members], axis=0)) == 1
    assert len(coarse.members[0]) == 4 + 4
    assert (np.bincount(coarse.group) == [4] * 4 + [8] * 4).all()
    _, transfers = _levels(node_layout(structure, 8), network)
    values = np.random.default_rng(0).normal(size=len(coarse.group))
    total = eqx.filter_jit(transfers[0].restrict)(jnp.asarray(values))
    np.testing.assert_allclose(total, np.bincount(coarse.group, values))
    spread = eqx.filter_jit(transfers[0].prolong)(total)
    np.testing.assert_array_equal(spread, np.asarray(total)[coarse.group])


def test_a_box_of_links_coarsens_as_the_lattice_does():
    solid = np.ones((4, 6, 8), bool)
    structure, network = _body(solid)
    networks, _ = _levels(node_layout(structure, 20), network)
    dense = assemble_uniform(FullVolume(structure.grid), 2.0, 1.0, np.float64)
    lattices, _ = _lattice_levels(dense, 100)
    values = np.random.default_rng(0).normal(size=(2, 3, 4))
    lattice_rate = np.asarray(_heat_rate(lattices[1], np.pad(values, 1)))
    rate = _heat_rate(networks[1], values.reshape(-1))
    inside = lattice_rate[1:-1, 1:-1, 1:-1].reshape(-1)
    np.testing.assert_allclose(rate, inside, atol=1e-12)


def test_links_between_cells_that_stay_alone_keep_their_conductance():
    """The large cells of an octree are as large as the first blocks."""
    structure = Octree(blocks(np.ones((12, 12, 12), bool)))
    network = assemble_uniform(structure, 2.0, 1.0, np.float64)
    layout = node_layout(structure, 100)
    coarse = layout.coarser[0]
    alone = np.bincount(coarse.group)[coarse.group] == 1
    links = structure.links()
    ends = np.stack([links.src, links.dst], axis=1)
    linked = np.flatnonzero(alone[ends].all(axis=1))
    assert len(linked) > 10
    networks, _ = _levels(layout, network)
    state = np.zeros(structure.node_count)
    state[both_first := ends[linked[0], 0]] = 1.0
    groups = np.zeros(len(coarse.members[0]))
    groups[coarse.group[both_first]] = 1.0
    fine = np.asarray(_heat_rate(network, state))
    merged = np.asarray(_heat_rate(networks[1], groups))
    other = ends[linked[0], 1]
    np.testing.assert_allclose(merged[coarse.group[other]], fine[other], rtol=1e-12)
    assert fine[other] > 0


def test_rows_and_pairs_have_the_same_levels():
    structure = Octree(blocks(np.random.default_rng(0).random((8, 8, 8)) < 0.9))
    rows = assemble_uniform(structure, 2.0, 1.0, np.float64)
    links = structure.links()
    conductance = 2.0 * links.area / (links.distance_src + links.distance_dst)
    given = links.src, links.dst, conductance, structure.nodes().volume
    pairs = LinkNetwork(*jax.device_put(given))
    layout = node_layout(structure, 20)
    from_rows, from_pairs = (_levels(layout, n)[0] for n in (rows, pairs))
    for a, b in zip(from_rows[1:], from_pairs[1:], strict=True):
        np.testing.assert_allclose(_diagonal(a), _diagonal(b), rtol=1e-12)


def test_parts_that_nothing_links_stay_apart_and_end_the_levels():
    solid = np.zeros((9, 9, 9), bool)
    solid[::2, ::2, ::2] = True
    structure, _ = _body(solid)
    assert node_layout(structure, 10).coarser == ()


def test_a_layout_is_found_once_and_goes_with_its_structure():
    gc.collect(0)
    count = findings_size()[0]
    structure, _ = _body(np.ones((3, 3, 3), bool))
    assert node_layout(structure, 5) is node_layout(structure, 5)
    assert node_layout(structure, 5) is not node_layout(structure, 8)
    assert findings_size()[0] >= count + 2
    del structure
    gc.collect(0)
    assert findings_size()[0] == count


def test_other_networks_are_refused():
    structure, network = _body(np.ones((3, 3, 3), bool))
    dense = assemble_uniform(FullVolume(structure.grid), 2.0, 1.0, np.float64)
    with pytest.raises(TypeError, match="Stencil"):
        _node_levels(node_layout(structure, 5), dense)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="RowNetwork"):
        _lattice_levels(network, 5)
