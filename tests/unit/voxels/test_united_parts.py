"""Parts that overlap, are flush, nested or touch have the surface of their union.

The union is that of manifold3d, an exact one.
"""

import importlib.util

import numpy as np
import pytest
from united_parts import pitch_of, united_parts
from voxel_bodies import joined

from jaxthermo.geometry import shapes
from jaxthermo.voxels.voxelize import voxelize


needs_library = pytest.mark.skipif(
    importlib.util.find_spec("manifold3d") is None, reason="the extra is not installed"
)
SURFACES = ("crossings", "dominant_axis")


@needs_library
@pytest.mark.parametrize("surface_cells", SURFACES)
@pytest.mark.parametrize(
    "seeds", [range(20), pytest.param(range(100), marks=pytest.mark.slow)]
)
def test_areas_and_volumes_of_random_unions(seeds, surface_cells):
    errors = []
    for seed in seeds:
        body = united_parts(seed)
        grid = voxelize(body.mesh, pitch_of(body.mesh), surface_cells)
        area_error = abs(grid.fragment_area.sum() / body.area - 1)
        volume_error = abs(grid.body_volume / body.volume - 1)
        errors.append(max(area_error, volume_error))
        # An area that is not the mesh's is told with its uncertainty, but where less
        # than 0.2 % of the surface is hidden.
        assert area_error <= max(3e-3, grid.area_uncertainty), body.description
    assert np.count_nonzero(np.array(errors) > 0.01) <= 0.03 * len(seeds)


def flush_blocks():
    """Two blocks of 0.1 m that overlap by half and have four pairs of flush sides."""
    block = shapes.box((0.1, 0.1, 0.1))
    return joined(block, block.moved((0.05, 0.0, 0.0)))


@pytest.mark.parametrize("surface_cells", SURFACES)
@pytest.mark.parametrize("pitch", [0.01, 0.0093])
def test_flush_sides_count_once(pitch, surface_cells):
    grid = voxelize(flush_blocks(), pitch, surface_cells)
    # 2 (0.15 * 0.1 + 0.15 * 0.1 + 0.1 * 0.1)
    assert grid.fragment_area.sum() == pytest.approx(0.08, rel=0.01)
    if pitch == 0.01:
        assert grid.fragment_area.sum() == pytest.approx(0.08, rel=1e-6)
        assert grid.body_volume == pytest.approx(0.0015, rel=1e-6)
    # Sides that face each other are as large, within 1 % of the smallest.
    pull = grid.fragment_normal * grid.fragment_area[:, None]
    assert pull.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-4)


@pytest.mark.parametrize("surface_cells", SURFACES)
def test_the_stated_uncertainty_is_that_of_areas(surface_cells):
    # Along the lattice the edge of what is hidden is off in all rays alike.
    rng = np.random.default_rng(0)
    block = shapes.box((0.1, 0.1, 0.1))
    ratios = []
    for _ in range(16):
        aside = rng.uniform(0.02, 0.08)
        body = joined(block, block.moved((0.05, aside, 0.0)))
        # Two sides of 0.02 m2 less the overlap, and the outline of both in height.
        area = 2 * (0.02 - 0.05 * (0.1 - aside)) + 2 * (0.15 + 0.1 + aside) * 0.1
        grid = voxelize(body, rng.uniform(0.003, 0.015), surface_cells)
        error = abs(grid.fragment_area.sum() / area - 1)
        ratios.append(error / grid.area_uncertainty)
    assert max(ratios) < 1
    assert np.median(ratios) > 0.1


@pytest.mark.parametrize("surface_cells", SURFACES)
def test_a_part_given_twice_is_a_part(surface_cells):
    ball = shapes.sphere(1.0, subdivisions=3)
    once = voxelize(ball, 0.1, surface_cells)
    twice = voxelize(joined(ball, ball), 0.1, surface_cells)
    assert (twice.solid == once.solid).all()
    assert len(twice.fragment_area) == len(once.fragment_area)
    assert twice.fragment_position == pytest.approx(once.fragment_position)
    counted = once.fragment_area.sum() / once.area_ratio
    assert twice.fragment_area.sum() == pytest.approx(counted, rel=0.02)


def test_both_sides_of_a_thin_gap_stay():
    # Parts with 1/50 of a voxel between them: air, however thin.
    cube = shapes.box((4.0, 4.0, 4.0))
    grid = voxelize(joined(cube, cube.moved((4.02, 0.0, 0.0))), 1.0)
    assert grid.fragment_area.sum() == pytest.approx(2 * cube.area, rel=0.02)
