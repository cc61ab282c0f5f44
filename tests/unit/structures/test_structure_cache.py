"""Structures are read again for the same voxels and options, and for no others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxthermo.memo import stored
from jaxthermo.memo.found import forget_findings
from jaxthermo.structures import cache
from jaxthermo.structures.cache import built_once
from jaxthermo.structures.structure import Built, Links, Nodes
from tests.bodies import blocks


class Builder:
    """Makes distinct arrays and counts how often it was asked."""

    def __init__(self):
        self.calls = 0

    def __call__(self, grid=None, **options) -> Built:
        del grid, options
        self.calls += 1
        index = np.arange(6, dtype=np.int32)
        return Built(
            nodes=Nodes(
                centre=np.arange(18.0).reshape(6, 3),
                volume=index + 0.5,
                level=index % 3,
                location=np.arange(18.0, 36.0).reshape(6, 3),
            ),
            links=Links(
                index[:-1], index[1:], *(np.full((3, 5), 2.0) * [[1], [2], [3]])
            ),
            fragment_node=index[::-1].copy(),
            voxel_node=index - 1,
        )


def arrays(built: Built) -> list[np.ndarray]:
    return [*built.nodes, *built.links, built.fragment_node, built.voxel_node]


def assert_same(first: Built, second: Built) -> None:
    for actual, expected in zip(arrays(first), arrays(second), strict=True):
        assert actual.dtype == expected.dtype
        np.testing.assert_array_equal(actual, expected)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An empty cache that keeps structures of any duration and size."""
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path))
    monkeypatch.setattr(stored, "_MIN_SECONDS", 0.0)
    monkeypatch.setattr(cache, "_MIN_VOXELS", 1)
    return tmp_path / "memo"


@pytest.fixture
def grid():
    return blocks(np.ones((2, 3, 4), bool))


def test_a_hit_gives_the_same_arrays_without_building(folder, grid):
    build = Builder()
    first = built_once("kind", grid, {"levels": None}, build)
    again = built_once(
        "kind", blocks(np.ones((2, 3, 4), bool)), {"levels": None}, build
    )
    forget_findings()
    stored_before = built_once("kind", grid, {"levels": None}, build)
    assert build.calls == 1
    for built in (again, stored_before):
        assert_same(first, built)


def test_whatever_a_structure_follows_from_is_a_miss(folder, grid):
    build = Builder()
    hole = grid.solid.copy()
    hole[0, 0, 0] = False
    moved = replace(grid.lattice, origin=np.array([0.0, 0.0, 1.0]))
    misses = [
        ("other", grid, {}),
        ("kind", grid, {"levels": 2}),
        ("kind", grid, {"levels": "2"}),
        ("kind", grid, {"levels": np.array([2, 3])}),
        ("kind", grid, {"levels": np.array([2, 4])}),
        ("kind", replace(grid, solid=hole), {}),
        ("kind", replace(grid, lattice=moved), {}),
        ("kind", replace(grid, volume_ratio=0.9), {}),
        ("kind", replace(grid, mesh=grid.mesh.moved((1.0, 0.0, 0.0))), {}),
        ("kind", replace(grid, fragment_normal=-grid.fragment_normal), {}),
        ("kind", replace(grid, fragment_position=2 * grid.fragment_position), {}),
        ("kind", replace(grid, fragment_voxel=grid.fragment_voxel[::-1]), {}),
    ]
    built_once("kind", grid, {}, build)
    for number, (name, body, options) in enumerate(misses):
        built_once(name, body, options, build)
        assert build.calls == number + 2
    assert len(list(folder.iterdir())) == len(misses) + 1


def test_options_of_no_known_content_are_not_stored(folder, grid):
    build = Builder()
    for _ in range(2):
        built_once("kind", grid, {"levels": object()}, build)
    assert build.calls == 2 and not folder.exists()


def test_structures_of_one_grid_share_their_arrays(folder, grid):
    first, second = (built_once("kind", grid, {}, Builder()) for _ in range(2))
    assert first is second


def test_small_bodies_leave_nothing(folder, grid, monkeypatch):
    monkeypatch.setattr(cache, "_MIN_VOXELS", 25)
    built_once("kind", grid, {}, Builder())
    assert not folder.exists()
