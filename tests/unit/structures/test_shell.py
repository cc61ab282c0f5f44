"""The single shell: which voxels, which links, how much capacity."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxthermo.errors import InputError
from jaxthermo.structures.kinds.shell import SingleShell
from jaxthermo.structures.weights import ConductionWeights
from tests.bodies import blocks


def solid_of(seed: int) -> np.ndarray:
    """A few voxels, some of them apart."""
    random = np.random.default_rng(seed)
    return random.random(tuple(random.integers(1, 6, 3))) < random.uniform(0.2, 1)


def exposed_one_by_one(solid: np.ndarray) -> list[tuple[int, ...]]:
    padded = np.pad(solid, 1)
    steps = [s * e for s in (-1, 1) for e in np.eye(3, dtype=int)]
    return [
        tuple(int(i) for i in cell)
        for cell in np.argwhere(solid)
        if not all(padded[tuple(cell + step + 1)] for step in steps)
    ]


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6))
def test_shell_is_that_found_voxel_by_voxel(seed):
    solid = solid_of(seed)
    pitch = 0.25
    if not solid.any():
        return
    shell = SingleShell(blocks(solid, pitch))
    cells = exposed_one_by_one(solid)
    expected = {}
    for (i, cell), (j, neighbour) in combinations(enumerate(cells), 2):
        apart = np.abs(np.subtract(cell, neighbour))
        if apart.max() == 1:
            expected[i, j] = pitch * np.sqrt(apart.sum())
    nodes = shell.nodes()
    links = shell.links()
    np.testing.assert_allclose(nodes.centre, (np.array(cells) + 0.5) * pitch)
    assert [*zip(links.src.tolist(), links.dst.tolist(), strict=True)] == [*expected]
    distance = links.distance_src + links.distance_dst
    np.testing.assert_allclose(distance, [*expected.values()])
    np.testing.assert_array_equal(links.distance_src, links.distance_dst)
    np.testing.assert_allclose(links.area, pitch**2)
    assert links.src.dtype == links.dst.dtype == shell.fragment_node().dtype == np.int32
    np.testing.assert_allclose(shell.fragment_offset(), 0, atol=1e-12)


def test_capacity_is_the_whole_body_or_a_hollow_one():
    position = np.indices((20, 20, 20)) - 9.6
    grid = replace(blocks((position**2).sum(0) < 90, 0.01), volume_ratio=0.9)
    body = SingleShell(grid)
    hollow = SingleShell(grid, "own")
    assert body.capacity_ratio == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(hollow.nodes().volume, grid.voxel_volume)
    assert hollow.capacity_ratio == pytest.approx(hollow.node_count / grid.solid_count)
    assert hollow.capacity_ratio < 0.7
    assert len(np.unique(body.nodes().volume)) == 1
    assert not body.nodes().level.any()


def test_a_flat_sheet_conducts_1_plus_sqrt_2_times_as_well():
    """Through a cut of n voxels: n straight links and 2 (n - 1) slanting ones."""
    n = 200
    pitch = 0.5
    links = SingleShell(blocks(np.ones((3, n, 1), bool), pitch)).links()
    through = (links.src < n) & (links.dst >= n)
    # Per kelvin a pitch: the conductances of the links across the cut.
    flow = (links.area / (links.distance_src + links.distance_dst))[through].sum()
    assert flow == pytest.approx(pitch * (n + 2 * (n - 1) / np.sqrt(2)))
    assert flow / (n * pitch) == pytest.approx(1 + np.sqrt(2), rel=0.01)


def test_a_voxel_without_open_face_that_carries_a_fragment_is_in_the_shell():
    grid = blocks(np.ones((3, 3, 3), bool))
    assert SingleShell(grid).node_count == 26
    cell = grid.fragment_voxel.copy()
    cell[0] = 1
    shell = SingleShell(replace(grid, fragment_voxel=cell))
    assert shell.node_count == 27
    np.testing.assert_allclose(shell.fragment_offset(), 0, atol=1e-12)


def test_parts_that_do_not_touch_stay_apart_and_one_voxel_is_alone():
    solid = np.zeros((5, 1, 1), bool)
    solid[[0, 1, 3]] = True
    shell = SingleShell(blocks(solid))
    assert shell.links().src.tolist() == [0] and shell.links().dst.tolist() == [1]
    assert shell.fragment_node().max() == 2
    assert SingleShell(blocks(np.ones((1, 1, 1), bool))).link_count == 0


def test_a_mistaken_capacity_is_told():
    with pytest.raises(InputError, match='"body" or "own"'):
        SingleShell(blocks(np.ones((1, 1, 1), bool)), "all")  # type: ignore


def test_weights_are_kept():
    grid = blocks(np.ones((2, 1, 1), bool))
    assert SingleShell(grid).weights.are_one
    assert SingleShell(grid, weights=ConductionWeights(within=2.0)).weights.within == 2
