"""Bodies from arrays of voxels: faces, areas and volumes of the cubes."""

import numpy as np
import pytest

from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.voxels.from_array import grid_from_voxels
from jaxthermo.voxels.grid import voxel_report
from jaxthermo.voxels.voxelize import voxelize


SOLID = np.random.default_rng(0).random((5, 4, 6)) > 0.4


def test_every_open_face_is_a_fragment_and_the_mesh_encloses_the_cubes():
    grid = grid_from_voxels(SOLID, 0.01, origin=(1.0, 2.0, 3.0))
    padded = np.pad(SOLID, 1)
    faces = 0
    for axis in range(3):
        faces += np.count_nonzero(np.diff(padded.astype(int), axis=axis))
    assert len(grid.fragment_area) == faces
    assert grid.mesh.is_watertight
    assert grid.mesh.volume == pytest.approx(SOLID.sum() * 1e-6, rel=1e-12)
    assert grid.mesh.area == pytest.approx(grid.fragment_area.sum(), rel=1e-12)
    # Every fragment lies between its solid voxel and an empty one.
    cell = grid.fragment_voxel
    assert SOLID[tuple(cell.T)].all()
    neighbour = cell + np.round(grid.fragment_normal).astype(int) + 1
    assert not padded[tuple(neighbour.T)].any()
    np.testing.assert_allclose(
        grid.fragment_position,
        np.array([1.0, 2.0, 3.0]) + (cell + 0.5 + grid.fragment_normal / 2) * 0.01,
    )
    assert (np.diff(np.ravel_multi_index(tuple(cell.T), SOLID.shape)) >= 0).all()
    assert voxel_report(grid)["volume_m3"]["voxels_unscaled"] == pytest.approx(
        grid.mesh.volume
    )


def test_a_box_is_the_same_from_an_array_as_from_its_mesh():
    mesh = shapes.box((0.03, 0.02, 0.04)).moved((0.015, 0.01, 0.02))
    from_array = grid_from_voxels(np.ones((3, 2, 4), bool), 0.01)
    from_mesh = voxelize(mesh, 0.01)
    assert from_array.layers == from_mesh.layers

    def sorted_rows(grid):
        rows = np.column_stack([grid.fragment_position, grid.fragment_normal])
        return rows[np.lexsort(np.round(rows, 6).T)]

    np.testing.assert_allclose(
        sorted_rows(from_array), sorted_rows(from_mesh), atol=1e-12
    )
    np.testing.assert_allclose(from_array.fragment_area, from_mesh.fragment_area[0])
    assert from_array.voxel_volume == pytest.approx(from_mesh.voxel_volume)


def test_layers_count_along_each_ray():
    solid = np.array([True, False, True]).reshape(3, 1, 1)
    grid = grid_from_voxels(solid, 1.0)
    assert grid.layers.peeled == (4, 2, 2)
    along = np.abs(grid.fragment_normal[:, 0]) > 0.5
    order = np.argsort(grid.fragment_position[along, 0])
    assert grid.fragment_layer[along, 0][order].tolist() == [0, 1, 2, 3]


def test_arrays_that_are_no_body(tmp_path):
    with pytest.raises(InputError, match=r"got int64 of shape \(2, 2\)"):
        grid_from_voxels(np.ones((2, 2), int), 1.0)
    with pytest.raises(InputError, match="no voxel is True"):
        grid_from_voxels(np.zeros((2, 2, 2), bool), 1.0)
    with pytest.raises(InputError, match="pitch=0.0"):
        grid_from_voxels(np.ones((2, 2, 2), bool), 0.0)
    with pytest.raises(InputError, match="give three numbers"):
        grid_from_voxels(np.ones((2, 2, 2), bool), 1.0, origin=(0.0, np.nan, 0.0))


def test_a_body_of_a_config(tmp_path):
    np.save(tmp_path / "scan.npy", SOLID)
    data = {"solid": str(tmp_path / "scan.npy"), "pitch": "1 mm"}
    body = {**data, "material": "copper", "temperature": 300}
    built = BodyConfig.model_validate(body).build()
    assert (built.structure.grid.solid == SOLID).all()
    np.save(tmp_path / "scan.npy", SOLID.astype(int))
    with pytest.raises(InputError, match="expected true or false"):
        BodyConfig.model_validate(body).build()
    wrong = {**body, "voxels_high": 5}
    del wrong["pitch"]
    with pytest.raises(ValueError, match="the array has them: give the `pitch`"):
        BodyConfig.model_validate(wrong)
