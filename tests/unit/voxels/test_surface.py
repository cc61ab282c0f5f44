"""Fragments of the dominant axis cover the surface once; links and packed ranks."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_bodies import BALL, joined

from jaxthermo.geometry import shapes
from jaxthermo.voxels.lattice import pixel_axes
from jaxthermo.voxels.surface import attach_to_solid, surface_links, surface_voxels
from jaxthermo.voxels.voxelize import voxelize


@pytest.fixture(scope="module")
def ball_grid():
    return voxelize(BALL, 1 / 30, "dominant_axis")


@pytest.fixture(scope="module")
def figurine_grid():
    return voxelize(shapes.figurine(), 4e-3, "dominant_axis")


def rays(grid):
    """Axis and pixel of every fragment's ray."""
    cell = np.floor(grid.lattice.to_cells(grid.fragment_position)).astype(int)
    at = np.arange(len(cell))
    row, column = np.transpose([pixel_axes(int(axis)) for axis in grid.fragment_axis])
    return np.column_stack([grid.fragment_axis, cell[at, row], cell[at, column]])


def covered(grid):
    """Share of surface voxels that own a fragment."""
    owned = np.zeros(grid.solid.shape, bool)
    owned[tuple(grid.fragment_voxel.T)] = True
    voxels = surface_voxels(grid.solid)
    return owned[tuple(voxels.T)].mean()


def test_every_surface_voxel_of_a_ball_has_a_fragment(ball_grid):
    assert covered(ball_grid) > 0.995


def test_no_fragment_is_counted_twice(ball_grid, figurine_grid):
    for grid in (ball_grid, figurine_grid):
        along = grid.fragment_position[
            np.arange(len(grid.fragment_axis)), grid.fragment_axis
        ]
        steps = np.round(along / grid.pitch * 1e6)
        assert len(np.unique(np.column_stack([rays(grid), steps]), axis=0)) == len(
            along
        )
        dominant = np.abs(grid.fragment_normal).argmax(1)
        assert (dominant == grid.fragment_axis).all()
        exposed = {tuple(v) for v in surface_voxels(grid.solid)}
        owners = {tuple(v) for v in grid.fragment_voxel}
        assert len(owners - exposed) <= 0.01 * len(owners)


def test_fragments_come_in_lattice_order(figurine_grid):
    number = np.ravel_multi_index(
        tuple(figurine_grid.fragment_voxel.T), figurine_grid.solid.shape
    )
    assert (np.diff(number) >= 0).all()


def test_packed_ranks_are_free_of_gaps(ball_grid, figurine_grid):
    for grid in (ball_grid, figurine_grid):
        ray = rays(grid)
        packed = grid.fragment_layer[:, 1]
        _, group, size = np.unique(ray, axis=0, return_inverse=True, return_counts=True)
        order = np.lexsort([packed, group])
        start = np.cumsum(size) - size
        assert (packed[order] == np.arange(len(ray)) - start[group[order]]).all()
        # In the order of the peeled layers, and never behind them.
        peeled = grid.fragment_layer[order, 0]
        same = group[order][1:] == group[order][:-1]
        assert (np.diff(peeled)[same] > 0).all()
        assert (peeled >= packed[order]).all()


def test_layer_counts(ball_grid, figurine_grid):
    assert ball_grid.layers.peeled == ball_grid.layers.packed == (2, 2, 2)
    layers = figurine_grid.layers
    assert sum(layers.packed) <= 0.8 * sum(layers.peeled)
    assert all(p <= q for p, q in zip(layers.packed, layers.peeled, strict=True))


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_surface_voxels_and_links_against_brute_force(seed):
    rng = np.random.default_rng(seed)
    x, y, z = (int(n) for n in rng.integers(1, 6, 3))
    shape = (x, y, z)
    solid = rng.uniform(size=shape) < rng.uniform()
    padded = np.pad(solid, 1)
    faces = [(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, -1), (0, -1, 0), (-1, 0, 0)]
    exposed = [
        cell
        for cell in np.argwhere(solid).tolist()
        if any(not padded[tuple(np.add(cell, f) + 1)] for f in faces)
    ]
    voxels = surface_voxels(solid)
    assert voxels.tolist() == exposed
    expected = {
        (i, j)
        for i in range(len(exposed))
        for j in range(i + 1, len(exposed))
        if np.abs(np.subtract(exposed[i], exposed[j])).max() == 1
    }
    links = surface_links(voxels, shape)
    assert {tuple(pair) for pair in links.tolist()} == expected
    assert len(links) == len(expected)


def test_links_of_no_voxels():
    none = np.zeros((0, 3), np.int64)
    assert surface_links(none, (4, 5, 6)).shape == (0, 2)


def test_strays_go_to_the_nearest_solid_voxel():
    solid = np.zeros((7, 7, 7), bool)
    solid[3, 3, 3] = solid[3, 3, 5] = True
    position = np.array(
        [[3.5, 3.5, 3.1], [3.5, 3.5, 4.9], [0.5, 0.5, 0.5], [5.5, 5.4, 4.6]]
    )
    inward = np.array([[3, 3, 3], [3, 3, 4], [0, 0, -1], [5, 5, 4]])
    cell, lost = attach_to_solid(solid, position, inward)
    assert lost.tolist() == [False, False, True, False]
    assert cell[[0, 1, 3]].tolist() == [[3, 3, 3], [3, 3, 5], [3, 3, 5]]


def test_strays_of_every_place_at_once_need_little_memory():
    rng = np.random.default_rng(0)
    solid = rng.uniform(size=(9, 9, 9)) < 0.1
    inward = rng.integers(-1, 10, (4000, 3))
    position = np.clip(inward, 0, 8) + rng.uniform(size=(4000, 3))
    cell, lost = attach_to_solid(solid, position, inward)
    assert solid[tuple(cell[~lost].T)].all()
    centres = np.argwhere(solid) + 0.5
    best = ((position[:, None] - centres) ** 2).sum(-1).min(1)
    distance = ((position - cell - 0.5) ** 2).sum(1)
    first = solid[tuple(np.clip(inward, 0, 8).T)]
    # Farther ones may lie outside the cube of cells that is searched.
    is_near = ~first & (best < 2.25)
    assert not lost[is_near].any()
    assert distance[is_near] == pytest.approx(best[is_near])


def test_touching_an_edge_of_another_part_changes_nothing():
    cube = shapes.box((3.0, 3.0, 3.0))
    grid = voxelize(joined(cube, cube.moved((3.0, 3.0, 0.0))), 1.0)
    assert grid.fragment_area.sum() == pytest.approx(108.0)
    assert grid.solid_count == 54
