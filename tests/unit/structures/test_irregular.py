"""Irregular levels: exact in cubes that fit, and in no body cut off or short-cut."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.shell import IrregularMultiLevel
from jaxthermo.structures.partition.assignment import assign_voxels, voxel_depth
from tests.bodies import blocks
from tests.unit.structures.irregular_bodies import (
    cells_one_by_one,
    parts,
    solid_of,
    solid_parts,
    steps_to_outside,
)
from tests.unit.structures.voxel_volumes import assert_links


seeds = st.integers(0, 10**6)


def cube(n: int, pitch: float = 1.0, **options) -> IrregularMultiLevel:
    return IrregularMultiLevel(blocks(np.ones((n, n, n), bool), pitch), **options)


@pytest.mark.parametrize("power", [1, 2, 3, 4, 5])
def test_a_cube_of_two_voxels_less_than_a_power_of_two_is_filled_exactly(power):
    """Level l is the shell of a cube of 2^(power - l) - 2 cells; the sum is n^3."""
    n = 2 ** (power) - 2 if power > 1 else 1
    body = cube(n, 0.1)
    sides = [2 ** (power - l) - 2 for l in range(power - 1)] if power > 1 else [1]
    shells = [m**3 - max(m - 2, 0) ** 3 for m in sides]
    assert np.bincount(body.nodes().level).tolist() == shells
    assert (body.cover_count() == 1).all()
    assert body.coverage() == (0, 0, 0)
    assert body.capacity_ratio == pytest.approx(1, abs=1e-12)


def test_coupling_of_a_fine_face_to_the_next_level_is_two_thirds_of_its_size():
    """G = k A / L with A = s^2 and L = s / 2 + 2 s / 2, s the size of the fine cell."""
    pitch = 0.1
    body = cube(30, pitch)
    level = body.nodes().level
    links = body.links()
    steps = level[links.dst] - level[links.src]
    assert set(steps.tolist()) == {0, 1}
    size = pitch * 2.0 ** level[links.src]
    conductance = links.area / (links.distance_src + links.distance_dst)
    np.testing.assert_allclose(conductance[steps == 0], size[steps == 0])
    np.testing.assert_allclose(conductance[steps == 1], size[steps == 1] * 2 / 3)
    # Every face between the shells of 30, 14 and 6 cells a side, and the last 2.
    assert np.bincount(level[links.src][steps == 1]).tolist() == [
        6 * (m - 2) ** 2 for m in (30, 14, 6)
    ]


@settings(deadline=None, max_examples=10)
@given(seeds)
def test_cells_are_those_found_one_by_one(seed):
    solid = solid_of(seed)
    if not solid.any():
        return
    body = IrregularMultiLevel(blocks(solid, 0.5))
    levels = cells_one_by_one(solid)
    low = np.concatenate([np.array(c).reshape(-1, 3) for c in levels])
    size = np.repeat(2 ** np.arange(len(levels)), [len(c) for c in levels])
    nodes = body.nodes()
    np.testing.assert_allclose(nodes.centre, (low + size[:, None] / 2) * 0.5)
    np.testing.assert_allclose(nodes.volume, (size * 0.5) ** 3)
    assert body.level_count == len(levels)


@settings(deadline=None, max_examples=12)
@given(seeds)
def test_depth_is_the_number_of_steps_to_the_outside(seed):
    solid = solid_of(seed)
    x, y, z = np.array(solid.shape) + 1
    depth = voxel_depth(blocks(solid))
    inner = depth[1:x, 1:y, 1:z]
    np.testing.assert_array_equal(inner, steps_to_outside(solid))
    assert depth.sum() == inner.sum()


@settings(deadline=None, max_examples=12)
@given(seeds)
def test_coverage_is_that_counted_one_by_one(seed):
    solid = solid_of(seed)
    if not solid.any():
        return
    body = IrregularMultiLevel(blocks(solid, 0.5))
    count = np.zeros(solid.shape, int)
    for centre, level in zip(body.nodes().centre, body.nodes().level, strict=True):
        low = np.rint(centre / 0.5 - 2**level / 2).astype(int)
        x, y, z = (slice(l, l + 2**level) for l in low)
        count[x, y, z] += 1
    np.testing.assert_array_equal(body.cover_count(), count)
    shares = body.coverage()
    voxels = solid.sum()
    assert shares.crack == pytest.approx((count[solid] == 0).sum() / voxels)
    assert shares.outside == pytest.approx(count[~solid].sum() / voxels)
    total = 1 + shares.overlap - shares.crack + shares.outside
    assert body.capacity_ratio == pytest.approx(total, abs=1e-12)


@settings(deadline=None, max_examples=25)
@given(seeds, st.sampled_from([None, None, 1, 2, 3]))
def test_nodes_hang_together_as_the_body_does(seed, levels):
    """No part is cut off, none is joined to another, and only lone voxels are alone."""
    solid = solid_of(seed)
    if not solid.any():
        return
    body = IrregularMultiLevel(blocks(solid), levels=levels)
    mine = parts(body)
    links = body.links()
    level = body.nodes().level
    shell = np.argwhere(steps_to_outside(solid) == 1)
    of_solid = solid_parts(solid)[tuple(shell.T)]
    pairs = np.unique(np.stack([mine[: len(shell)], of_solid]), axis=1)
    # Every part has a shell, and lies in one part of the body only.
    assert set(mine) == set(pairs[0]) and len(pairs[0]) == len(set(mine))
    if levels is None:
        assert len(pairs[0]) == len(set(of_solid))
    linked = np.zeros(body.node_count, bool)
    linked[links.src] = linked[links.dst] = True
    assert (level[~linked] == 0).all()
    sizes = np.bincount(solid_parts(solid)[solid])
    assert (sizes[of_solid[~linked[: len(shell)]]] == 1).all()


def test_a_cell_that_sticks_out_joins_no_other_part():
    """The cell of 16 voxels from 15 to 30 reaches from an octahedron into a cube."""
    position = np.moveaxis(np.indices((40, 40, 40)), 0, -1)
    octahedron = np.abs(position - 22).sum(-1) <= 16
    cube_beyond = ((position >= 28) & (position <= 30)).all(-1)
    solid = octahedron | cube_beyond
    assert solid_parts(solid).max() == 2
    body = IrregularMultiLevel(blocks(solid))
    assert body.nodes().centre[body.nodes().level == 4].tolist() == [[23, 23, 23]]
    # The middle of the cube has no other cell.
    assert body.cover_count()[29, 29, 29] == 1
    assert len(set(parts(body))) == 2


@settings(deadline=None, max_examples=20)
@given(seeds)
def test_links_are_sound(seed):
    solid = solid_of(seed)
    if not solid.any():
        return
    body = IrregularMultiLevel(blocks(solid, 2.0))
    links = body.links()
    size = 2.0 ** body.nodes().level * 2
    key = links.src.astype(int) * body.node_count + links.dst
    assert (np.diff(key) > 0).all() and (links.src < links.dst).all()
    assert links.src.dtype == links.dst.dtype == body.fragment_node().dtype == np.int32
    assert (links.area >= 4).all()
    # A gap may lie between the face and the cell, never the other way round.
    assert (links.distance_src >= size[links.src] / 2).all()
    assert (links.distance_dst >= size[links.dst] / 2).all()
    np.testing.assert_allclose(body.fragment_offset(), 0, atol=1e-12)


@settings(deadline=None, max_examples=10)
@given(seeds)
def test_a_body_is_divided_among_its_cells(seed):
    """Whoever owns a voxel covers it, or bridges a gap to it; all voxels are owned."""
    solid = solid_of(seed)
    if not solid.any():
        return
    depth = voxel_depth(blocks(solid))
    cells = [np.array(c).reshape(-1, 3) for c in cells_one_by_one(solid)]
    levels = [(c + 1) // 2**l for l, c in enumerate(cells)]
    (owner, gap), left = assign_voxels(depth > 0, levels)
    assert [len(c) for c in left] == [len(c) for c in levels]
    assert ((owner >= 0) == (depth > 0)).all()
    low = np.concatenate([c * 2**l for l, c in enumerate(left)])
    size = np.repeat(2 ** np.arange(len(left)), [len(c) for c in left])[:, None]
    at = np.argwhere(depth > 0)
    mine = owner[tuple(at.T)]
    below = low[mine] - at
    beyond = at - (low + size - 1)[mine]
    steps = np.maximum(np.maximum(below, beyond), 0).sum(1)
    inside = gap[tuple(at.T)] == 0
    assert (steps[inside] == 0).all()
    assert (steps <= gap[tuple(at.T)]).all()
    assert len(np.unique(mine[inside])) == len(low)


def test_a_hidden_cell_is_left_out():
    """Fragments put on inner voxels pull these into the shell, over coarser cells."""
    grid = blocks(np.ones((6, 6, 6), bool))
    assert IrregularMultiLevel(grid).node_count == 6**3 - 4**3 + 8
    cells = np.argwhere(np.ones((2, 2, 2), bool)) + 1
    fragments = grid.fragment_voxel.copy()
    fragments[:8] = cells
    levels = [np.argwhere(np.ones((2, 2, 2), bool)) + 2, np.array([[1, 1, 1]])]
    body = np.pad(np.ones((6, 6, 6), bool), 1)
    territory, left = assign_voxels(body, levels)
    assert [len(c) for c in left] == [8, 0]
    assert territory.owner.max() == 7
    pulled = IrregularMultiLevel(replace(grid, fragment_voxel=fragments))
    assert len(set(parts(pulled))) == 1


@pytest.mark.parametrize("shape", [(1, 1, 1), (7, 1, 1), (9, 8, 1), (2, 5, 6)])
def test_a_thin_body_is_the_full_volume(shape):
    grid = blocks(np.ones(shape, bool))
    thin = IrregularMultiLevel(grid)
    full = FullVolume(grid, stencil=False)
    for ours, theirs in [(thin.nodes(), full.nodes()), (thin.links(), full.links())]:
        for actual, expected in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(actual, expected)
    np.testing.assert_array_equal(thin.fragment_node(), full.fragment_node())


@settings(deadline=None, max_examples=10)
@given(seeds)
@example(0)
def test_levels_are_the_outer_ones(seed):
    solid = solid_of(seed)
    if not solid.any():
        return
    grid = blocks(solid)
    complete = IrregularMultiLevel(grid)
    for levels in range(1, complete.level_count):
        some = IrregularMultiLevel(grid, levels=levels)
        outer = complete.nodes().level < levels
        np.testing.assert_array_equal(
            some.nodes().centre, complete.nodes().centre[outer]
        )
    for levels in (complete.level_count, 99):
        unlimited = IrregularMultiLevel(grid, levels=levels)
        assert_links(unlimited, complete)


def test_the_total_capacity_can_be_kept():
    position = np.indices((20, 20, 20)) - 9.6
    grid = blocks((position**2).sum(0) < 90)
    plain = IrregularMultiLevel(grid)
    scaled = IrregularMultiLevel(grid, keep_capacity=True)
    assert abs(plain.capacity_ratio - 1) > 1e-3
    assert scaled.capacity_ratio == pytest.approx(1, abs=1e-12)
    ratio = scaled.nodes().volume / plain.nodes().volume
    np.testing.assert_allclose(ratio, 1 / plain.capacity_ratio)
    assert_links(scaled, plain)


def test_an_empty_grid_has_no_nodes():
    body = IrregularMultiLevel(blocks(np.zeros((2, 3, 2), bool)))
    assert body.node_count == body.link_count == body.level_count == 0
