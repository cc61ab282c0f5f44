"""Weights by cells are those of all pairs of points and fragments."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.sparse import csr_array

import jaxthermo as jt
from jaxthermo.image.surface import fragment_cells as module
from jaxthermo.image.surface.fragment_cells import (
    CHUNK,
    FragmentCells,
    Limits,
    cells_of,
)
from jaxthermo.image.surface.shapes import ShapePoints, Shapes
from jaxthermo.scene.scene import BodyGeometry, body_geometry


NO_LIMITS = Limits(np.array([np.inf]))


def geometry_of(grid: jt.VoxelGrid) -> BodyGeometry:
    return BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_position,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=jt.Pose(),
    )


def all_weights(geometry, points, normals, radius) -> np.ndarray:
    """Weights [p, s] of every pair, by the formula."""
    away = points[:, None] - geometry.fragment_position
    fade = np.maximum(1 - (away**2).sum(-1) / radius**2, 0)
    cosine = np.maximum(normals @ geometry.fragment_normal.T, 0)
    return fade**2 * cosine**2 * geometry.fragment_area


@pytest.mark.parametrize("reach", [1.0, 2.0, 3.7])
def test_weights_of_points_on_and_far_from_a_body(reach):
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.01)
    geometry = geometry_of(grid)
    radius = reach * grid.pitch
    numbers = np.random.default_rng(3)
    points = numbers.uniform(-0.12, 0.12, (CHUNK // 4, 3))
    points[:200] = 0.05 * points[:200] / np.linalg.norm(points[:200], axis=1)[:, None]
    normals = numbers.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    cells = cells_of(Shapes.of((geometry,)), reach)
    pairs = cells.weighted(ShapePoints.of_one(points, normals))
    assert (np.diff(pairs.owner) >= 0).all() and (pairs.weight > 0).all()
    dense = np.zeros((len(points), len(grid.fragment_area)))
    np.add.at(dense, (pairs.owner, pairs.fragment), pairs.weight)
    expected = all_weights(geometry, points=points, normals=normals, radius=radius)
    assert expected.any()
    np.testing.assert_allclose(dense, expected, rtol=1e-9, atol=1e-16)


def test_pairs_are_at_least_those_within_the_radius():
    grid = jt.voxelize(jt.shapes.box((0.04, 0.03, 0.02)), 0.005)
    geometry = geometry_of(grid)
    points = np.random.default_rng(5).uniform(-0.05, 0.05, (300, 3))
    cells = FragmentCells(Shapes.of((geometry,)), 2.0)
    owner, slot = cells.pairs(ShapePoints.of_one(points, points))
    actual = set(zip(owner.tolist(), cells.front[slot].tolist(), strict=True))
    assert len(actual) == len(owner)
    away = np.linalg.norm(points[:, None] - geometry.fragment_position, axis=-1)
    near = np.argwhere(away < 0.01).tolist()
    assert near and actual >= {(p, s) for p, s in near}


class BallPoints(NamedTuple):
    """A ball of voxels, with points on and around it."""

    shapes: Shapes
    points: ShapePoints


def ball_points(count: int) -> BallPoints:
    geometry = geometry_of(jt.voxelize(jt.shapes.sphere(0.05), 0.01))
    numbers = np.random.default_rng(8)
    normals = numbers.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = numbers.uniform(0.02, 0.1, (count, 1)) * normals
    shapes = Shapes.of((geometry,))
    return BallPoints(shapes, ShapePoints.of_one(points, normals))


def reference(cells, points, limits=NO_LIMITS) -> csr_array:
    """Means from the pairs that numpy finds."""
    row, fragment, weight = cells.weighted(points, limits)
    count = len(points.shape)
    total = np.bincount(row, weight, count)
    size = count, cells.fragment_count
    return csr_array((weight / total[row], (row, fragment)), size)


@pytest.mark.parametrize("pairs", [2**9, 2**18])
def test_the_program_computes_the_weights_of_numpy(pairs, monkeypatch):
    monkeypatch.setattr(module, "_PAIRS", pairs)
    monkeypatch.setattr(module, "_POINTS", 2**11)
    count = CHUNK + 300 if pairs > 2**9 else 300
    monkeypatch.setattr(module, "CHUNK", min(CHUNK, count - 1))
    shapes, points = ball_points(count)
    cells = cells_of(shapes, 2.0)
    weights = cells.means(points)
    expected = reference(cells, points)
    assert 0 < (np.diff(weights.indptr) == 0).sum() < count
    assert weights.nnz == expected.nnz and abs(weights - expected).max() < 1e-12

    limits = Limits(np.linspace(0.0, 0.01, count), 0.9)
    some = cells.means(points, limits)
    expected_some = reference(cells, points, limits)
    assert 0 < some.nnz < weights.nnz and abs(some - expected_some).max() < 1e-12
    # Another fragment where none is near.
    alone = np.flatnonzero(np.diff(weights.indptr) == 0)
    filled = cells.means(points, otherwise=lambda which: which % 7)
    fallback = csr_array((np.ones(len(alone)), (alone, alone % 7)), weights.shape)
    assert abs(filled - weights - fallback).max() == 0
    assert filled.nnz == weights.nnz + len(alone)


@pytest.mark.parametrize("count", [300, CHUNK + 300])
def test_a_wall_is_searched_for_both_of_its_faces_at_once(count):
    mesh = jt.shapes.sphere(0.05, 2)
    steel = jt.Material(50.0, density=7800.0, specific_heat=470.0)
    grid = jt.Sheet(mesh, (jt.Layer(steel, 1e-3),), 0.01).grid
    geometry = body_geometry(grid, jt.Pose())
    assert geometry.is_two_sided
    numbers = np.random.default_rng(4)
    out = numbers.normal(size=(count, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    points = numbers.uniform(0.04, 0.06, (count, 1)) * out
    # Seen from outside, from inside, and aslant.
    normals = out * numbers.choice([-1.0, 1.0], (count, 1))
    normals += numbers.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    height = numbers.uniform(0.0, 0.02, count)
    means = cells_of(Shapes.of((geometry,)), 2.0).means(
        ShapePoints.of_one(points, normals), Limits(height, 0.3)
    )
    expected = all_weights(geometry, points=points, normals=normals, radius=0.02)
    away = points[:, None] - geometry.fragment_position
    expected *= np.abs(np.einsum("psi,pi->ps", away, normals)) < height[:, None]
    expected *= normals @ geometry.fragment_normal.T > 0.3
    total = expected.sum(axis=1, keepdims=True)
    assert (total > 0).mean() > 0.5
    expected /= np.where(total > 0, total, 1)
    np.testing.assert_allclose(means.toarray(), expected, atol=1e-12)
    half = len(geometry.fragment_area) // 2
    assert expected[:, :half].any() and expected[:, half:].any()


def test_without_a_table_of_cells_they_are_the_same(monkeypatch):
    shapes, near = ball_points(500)
    far = 1e3 * near.position[:100]
    points = ShapePoints.of_one(
        np.concatenate([near.position, far, -far]),
        np.concatenate([near.normal, near.normal[:100], near.normal[:100]]),
    )
    by_table = FragmentCells(shapes, 2.0).means(points)
    monkeypatch.setattr(module, "_MAX_CELLS", 0)
    by_search = FragmentCells(shapes, 2.0).means(points)
    assert by_table.nnz > 0 and abs(by_table - by_search).max() == 0
    assert (np.diff(by_table.indptr)[500:] == 0).all()
