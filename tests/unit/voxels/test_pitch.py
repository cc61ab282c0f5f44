"""A pitch that cannot work is refused before anything is done."""

import tracemalloc

import numpy as np
import pytest
from voxel_bodies import BALL, joined

from jaxthermo import host_memory
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.memo.store import without_cache
from jaxthermo.voxels import lattice, voxelize as voxelize_module
from jaxthermo.voxels.voxelize import voxelize


@pytest.mark.parametrize("pitch", [0.0, -0.1, float("nan"), float("inf"), -np.inf, 0])
def test_pitch_is_positive(pitch):
    with pytest.raises(InputError, match="positive"):
        voxelize(BALL, pitch)


@pytest.mark.parametrize("pitch", [2.2, 1e3, 1e300])
def test_pitch_larger_than_the_body(pitch):
    with pytest.raises(InputError, match="larger than sphere.*unit"):
        voxelize(BALL, pitch)


@pytest.mark.parametrize(
    "pitch", [1, 1.0, np.float32(1), np.float64(1), np.asarray(1.0)]
)
def test_numbers_of_every_kind_are_a_pitch(pitch):
    grid = voxelize(shapes.box(4.0), pitch)
    assert grid.solid.shape == (4, 4, 4)
    assert isinstance(grid.pitch, float)


def test_a_body_that_no_voxel_centre_meets():
    # Far apart thin parts: the lattice is large, but no centre is inside.
    plate = shapes.box((8.0, 8.0, 0.2))
    vertices = np.concatenate([plate.vertices, plate.vertices + [0, 0, 1.8]])
    faces = np.concatenate([plate.faces, plate.faces + len(plate.vertices)])
    with pytest.raises(InputError, match="no voxel at a pitch of 1 m.*finer"):
        voxelize(Mesh(vertices, faces, "plates"), 1.0)


def test_no_triangles():
    with pytest.raises(InputError, match="no triangles"):
        voxelize(Mesh(np.zeros((3, 3)), np.zeros((0, 3), np.int64)), 1.0)


@pytest.mark.parametrize("pitch", [1e-3, 1e-9, 1e-300])
def test_memory_is_refused_before_it_is_taken(monkeypatch, pitch):
    def unreachable(*_):
        raise AssertionError("work began")

    for module in (host_memory, lattice):
        monkeypatch.setattr(module, "available_bytes", lambda: 10_000_000)
    monkeypatch.setattr(voxelize_module, "peel_axes", unreachable)
    with pytest.raises(InputError, match=r"sphere.*cells.*free.*such as 0\.\d+ m"):
        voxelize(BALL, pitch)


def test_the_pitch_that_is_advised_would_do(monkeypatch):
    for module in (host_memory, lattice):
        monkeypatch.setattr(module, "available_bytes", lambda: 10_000_000)
    surface = lattice.SURFACE_MEMORY["dominant_axis"]
    with pytest.raises(InputError) as caught:
        lattice.check_pitch(BALL, 1e-3, surface)
    advised = float(str(caught.value).split("such as ")[1].split()[0])
    lattice.check_pitch(BALL, advised, surface)


@pytest.mark.parametrize("surface_cells", ["dominant_axis", "crossings"])
@pytest.mark.parametrize(
    ("mesh", "pitch"),
    [
        (BALL, 0.02),
        (shapes.box((1.0, 0.8, 1.2)), 0.011),
        (shapes.sphere(1.0, subdivisions=5), 0.06),
    ],
    ids=["ball", "large triangles", "more triangles than voxels"],
)
def test_the_memory_asked_for_is_what_voxelize_takes(
    monkeypatch, mesh, pitch, surface_cells
):
    """Never less, and at most twice as much."""
    forecasts = []
    voxelize(mesh, 0.3, surface_cells)
    monkeypatch.setattr(lattice, "require_memory", lambda n, *_: forecasts.append(n))
    tracemalloc.start()
    try:
        with without_cache():
            voxelize(mesh, pitch, surface_cells)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.45 * forecasts[0] < peak < forecasts[0]


def test_a_flat_mesh():
    flat = Mesh(np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="no voxel"):
        voxelize(flat, 1.0)


def stray_plate():
    """A cube with a speck 1 km away, as scanners leave them."""
    speck = shapes.box(0.2).moved((1000.0, 0.0, 0.0))
    return joined(shapes.box(1.0), speck)


@pytest.mark.parametrize("surface_cells", ["dominant_axis", "crossings"])
def test_a_large_lattice_is_told_with_the_part_that_stretches_it(
    monkeypatch, surface_cells
):
    def unreachable(*_):
        raise AssertionError("work began")

    monkeypatch.setattr(voxelize_module, "_voxelized", unreachable)
    # Python's own warnings are errors in tests: this one comes before any work.
    line = r"makes 100060 x 100 x 100 cells: the part of 12 faces around \(1000, 0, 0\)"
    with pytest.raises(UserWarning, match=line):
        voxelize(stray_plate(), 0.01, surface_cells)


def test_a_large_lattice_of_a_single_part_names_none():
    surface = lattice.SURFACE_MEMORY["dominant_axis"]
    with pytest.warns(UserWarning, match="makes 500 x 500 x 500 cells: use a coarser"):
        lattice.check_pitch(shapes.box(1.0), 0.002, surface)
    lattice.check_pitch(shapes.box(1.0), 0.0022, surface)


def test_what_does_not_fit_names_the_part_too(monkeypatch):
    for module in (host_memory, lattice):
        monkeypatch.setattr(module, "available_bytes", lambda: 10_000_000)
    with pytest.raises(InputError, match="around .* stretches the 1e.06 cells of the"):
        voxelize(stray_plate(), 0.01)
