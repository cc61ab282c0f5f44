"""Weights by cells are those of all pairs of points and fragments."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.arrays import linear_map
from jaxthermo.image.fragment_cells import CHUNK, FragmentCells, cells_of
from jaxthermo.scene.scene import BodyGeometry


def geometry_of(grid: jt.VoxelGrid) -> BodyGeometry:
    return BodyGeometry(
        grid.mesh.vertices,
        grid.mesh.faces,
        grid.fragment_position,
        grid.fragment_normal,
        grid.fragment_area,
        grid.pitch,
        jt.Pose(),
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
    geometry, radius = geometry_of(grid), reach * grid.pitch
    numbers = np.random.default_rng(3)
    points = numbers.uniform(-0.12, 0.12, (CHUNK // 4, 3))
    points[:200] = 0.05 * points[:200] / np.linalg.norm(points[:200], axis=1)[:, None]
    normals = numbers.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    found = cells_of(geometry, radius).weighted(points, normals)
    assert (np.diff(found.owner) >= 0).all() and (found.weight > 0).all()
    dense = np.zeros((len(points), len(grid.fragment_area)))
    np.add.at(dense, (found.owner, found.fragment), found.weight)
    expected = all_weights(geometry, points, normals, radius)
    assert expected.any()
    np.testing.assert_allclose(dense, expected, rtol=1e-9, atol=1e-16)


def test_pairs_are_at_least_those_within_the_radius():
    grid = jt.voxelize(jt.shapes.box((0.04, 0.03, 0.02)), 0.005)
    geometry = geometry_of(grid)
    points = np.random.default_rng(5).uniform(-0.05, 0.05, (300, 3))
    owner, fragment, _ = FragmentCells(geometry, 0.01).pairs(points)
    found = set(zip(owner.tolist(), fragment.tolist(), strict=True))
    assert len(found) == len(owner)
    away = np.linalg.norm(points[:, None] - geometry.fragment_position, axis=-1)
    near = np.argwhere(away < 0.01).tolist()
    assert near and found >= {(p, s) for p, s in near}


@pytest.mark.parametrize("shape", [(3,), (7, 3), (5, 4, 3), (0, 3)])
def test_a_linear_map_is_the_product(shape):
    numbers = np.random.default_rng(1)
    vectors, matrix = numbers.normal(size=shape), numbers.normal(size=(3, 3))
    np.testing.assert_allclose(
        linear_map(vectors, matrix), vectors @ matrix, rtol=1e-12, atol=1e-14
    )
    np.testing.assert_array_equal(linear_map(vectors, np.eye(3)), vectors)
