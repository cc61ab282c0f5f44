"""The thesis' own mesh at its own resolution, 228 x 550 x 228 with a margin of one.

Real meshes are loaded by default in `test_load_good_files`; areas and volumes
of shapes are in `test_bodies`, their packed layers in `test_crossings`.
"""

import numpy as np
import pytest

from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.voxels.voxelize import voxelize


PITCH = 0.5 / 548


@pytest.fixture(scope="module")
def loaded():
    return {}


@pytest.fixture
def buddha(real_mesh, loaded):
    if not loaded:
        mesh = load_mesh(real_mesh("happy-buddha.obj"), height=0.5, up="y")
        loaded.update(mesh=mesh, grid=voxelize(mesh, PITCH))
    return loaded["mesh"], loaded["grid"]


def turned(mesh, degrees):
    """About (1, 1, 1), by Rodrigues' formula."""
    angle = np.radians(degrees)
    cross = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return Mesh(mesh.vertices @ turn.T, mesh.faces, mesh.name)


@pytest.mark.slow
def test_layers(buddha):
    """In the file's x, y, z: 18, 20, 12; the thesis has 18, 20 and 8.

    Along the file's z the layers from the ninth on hold 18 of 210 000 fragments, and
    their number depends on where the lattice lies: 8 to 14 over shifts by part of a
    voxel.
    """
    _, grid = buddha
    assert grid.lattice.shape == (226, 226, 548)
    assert grid.layers.peeled == (18, 12, 20)


@pytest.mark.slow
@pytest.mark.slice
def test_packing_halves_the_layers(buddha):
    """Thesis 4.2: 46 layers become 25."""
    _, grid = buddha
    assert sum(grid.layers.packed) == pytest.approx(sum(grid.layers.peeled) / 2, abs=2)


@pytest.mark.slow
@pytest.mark.slice
def test_true_area_and_volume(buddha):
    mesh, grid = buddha
    assert grid.unscaled_because == ""
    assert grid.area_ratio == pytest.approx(1.0, abs=2e-3)
    assert grid.volume_ratio == pytest.approx(1.0, abs=1e-3)
    assert grid.thin.thin_area < 0.01 * mesh.area
    assert grid.thin.lost_area < 1e-4 * mesh.area


@pytest.mark.slow
@pytest.mark.slice
def test_the_volume_does_not_depend_on_the_axes(buddha):
    mesh, grid = buddha
    rotated = voxelize(turned(mesh, 30.0), PITCH)
    assert rotated.solid_count == pytest.approx(grid.solid_count, rel=0.01)
    assert rotated.area_ratio == pytest.approx(1.0, abs=2e-3)
