"""Structures built slab by slab are those of the whole lattice."""

import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_volumes import ball, solids

import jaxthermo as jt
from jaxthermo.structures.kinds.groups import _build_shell_over_core
from jaxthermo.structures.partition import slabs
from jaxthermo.structures.partition.blocks import (
    block_parts,
    build_blocks,
    number_by_first_voxel,
)
from tests.bodies import blocks


def _in_slabs_of(cells, build):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(slabs, "_SLAB_CELLS", cells)
        return build()


LENGTHS = ("centre", "location", "distance_src", "distance_dst")


def _assert_same(actual, expected, rounded=LENGTHS):
    """Numbers, areas and links exactly; what is named to rounding."""
    for name in ("fragment_node", "voxel_node"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name))
        assert getattr(actual, name).dtype == getattr(expected, name).dtype
    for columns, expected_columns in (
        (actual.nodes, expected.nodes),
        (actual.links, expected.links),
    ):
        for name, value in columns._asdict().items():
            expected_value = getattr(expected_columns, name)
            assert value.dtype == expected_value.dtype, name
            if name in rounded:
                np.testing.assert_allclose(
                    value, expected_value, rtol=1e-13, atol=1e-13
                )
            else:
                np.testing.assert_array_equal(value, expected_value, name)


@settings(deadline=None, max_examples=20)
@given(solids(9), st.integers(1, 5), st.sampled_from([1, 200]))
def test_groups_of_every_slab_together_are_those_of_the_lattice(solid, factor, cells):
    grid = blocks(solid, 0.3)

    def numbered(planes):
        labels, first = number_by_first_voxel(block_parts(solid[planes], factor))
        return slabs.Slab(labels, np.arange(len(first), dtype=np.int32) % 3)

    def by_slabs():
        built = slabs.build_slabs(grid, factor, 0, numbered)
        return built, list(slabs._block_slabs(solid.shape, factor))

    built, ranges = _in_slabs_of(cells, by_slabs)
    labels, _ = number_by_first_voxel(block_parts(solid, factor))
    _assert_same(built, build_blocks(grid, labels, built.nodes.level))
    assert ranges[0].start == 0 and ranges[-1].stop == len(solid)
    assert len(ranges) == -(-len(solid) // factor) or cells > 1


@settings(deadline=None, max_examples=12)
@given(solids(9), st.integers(1, 4), st.booleans())
def test_structures_do_not_depend_on_the_slabs(solid, factor, layered):
    grid = blocks(solid, 0.3)

    def build():
        if layered:
            return _build_shell_over_core(grid, 1, factor)
        return jt.Aggregate(grid, factor).built

    _assert_same(_in_slabs_of(1, build), build())


@pytest.mark.parametrize("layered", [False, True])
def test_cut_voxels_keep_their_volumes_and_open_areas_in_slabs(layered):
    mesh = jt.shapes.sphere(1.0, subdivisions=3)
    grid = jt.voxelize(mesh, 1 / 7.3, surface_cells="crossings")

    def build():
        if layered:
            return _build_shell_over_core(grid, 1, 3)
        return jt.Aggregate(grid, 3).built

    built = _in_slabs_of(1, build)
    _assert_same(built, build(), (*LENGTHS, "volume", "area"))
    assert built.nodes.volume.sum() == pytest.approx(mesh.volume, rel=1e-12)


def test_a_body_of_one_slab_is_built_from_the_lattice():
    grid = blocks(ball(4.6), 0.3)
    labels, first = number_by_first_voxel(block_parts(grid.solid, 3))
    level = np.zeros(len(first), np.int32)
    built = slabs.build_slabs(grid, 3, 0, lambda _: slabs.Slab(labels, level))
    expected = build_blocks(grid, labels, level)
    for columns, expected_columns in (
        (built.nodes, expected.nodes),
        (built.links, expected.links),
    ):
        for value, expected_value in zip(columns, expected_columns, strict=True):
            np.testing.assert_array_equal(value, expected_value)


def test_planes_without_voxels_are_slabs_without_nodes():
    solid = np.zeros((9, 3, 3), bool)
    solid[:2] = True
    solid[7:] = True
    structure = _in_slabs_of(1, lambda: jt.Aggregate(blocks(solid), 2))
    assert structure.capacity_ratio == 1
    assert structure.node_count == 12
    x = structure.nodes().centre[structure.links().src, 0]
    assert ((x < 2) | (x > 7)).all()


@pytest.mark.parametrize("cells", [2**18, 2**23])
@pytest.mark.parametrize("structure_class", [jt.Aggregate, jt.ShellOverCore])
def test_the_memory_asked_for_is_that_of_the_build(monkeypatch, structure_class, cells):
    forecasts = []
    monkeypatch.setattr(slabs, "_SLAB_CELLS", cells)
    monkeypatch.setattr(slabs, "require_memory", lambda n, *_: forecasts.append(n))
    monkeypatch.setenv("JAXTHERMO_CACHE", "off")
    grid = blocks(ball(40.0))
    tracemalloc.start()
    try:
        structure_class(grid, factor=8)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # The layers of a shell are found before: labels of all cells, with a rim.
    layers_bytes = 0 if structure_class is jt.Aggregate else 6 * grid.solid.size
    assert peak < forecasts[0] + layers_bytes
    assert forecasts[0] < 2 * peak


BUDDHA = """
import resource, sys
import jaxthermo as jt
mesh = jt.load_mesh(sys.argv[1], height=0.5, up="y")
grid = jt.voxelize(mesh, 0.5e-3)
structure = jt.Aggregate(grid, factor=16)
assert abs(structure.capacity_ratio - 1) < 1e-12
print(structure.node_count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_slabs_of_a_statue_are_its_whole_lattice(real_mesh, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_CACHE", "off")
    mesh = jt.load_mesh(real_mesh("happy-buddha.obj"), height=0.5, up="y")
    grid = jt.voxelize(mesh, 0.5 / 400)

    def build():
        return jt.Aggregate(grid, factor=16).built

    # Thin parts are filled up by their conductances, which depend on lengths.
    rounded = (*LENGTHS, "volume")
    _assert_same(_in_slabs_of(1, build), _in_slabs_of(2**40, build), rounded)


@pytest.mark.slow
def test_fine_voxels_of_a_statue_in_coarse_blocks_fit_in_memory(real_mesh):
    """169 million cells; 1.2 GiB with the libraries, 4.3 GiB for the whole lattice."""
    command = [sys.executable, "-c", BUDDHA, str(real_mesh("happy-buddha.obj"))]
    off = {**os.environ, "JAXTHERMO_CACHE": "off"}
    run = subprocess.run(command, capture_output=True, text=True, env=off, check=True)
    nodes, peak = map(int, run.stdout.split())
    assert 14_000 < nodes < 16_000
    assert peak * 1024 < 2 * 2**30


def test_a_build_that_does_not_fit_is_refused(monkeypatch):
    monkeypatch.setattr("jaxthermo.host_memory.available_bytes", lambda: 1000)
    with pytest.raises(jt.InputError, match="building a structure of .* coarser pitch"):
        jt.Aggregate(blocks(ball(4.6)), 2)
