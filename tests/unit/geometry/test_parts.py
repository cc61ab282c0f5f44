"""Named parts of GLB and OBJ files, and the voxels and materials of each."""

import numpy as np
import pytest
import trimesh

import jaxthermo as jt
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes


CLAY = jt.Material(1.0, 2000.0, 1000.0)
STEEL = jt.Material(16.0, 8000.0, 500.0)

# A square prism of 1 x 1 x 2 whose surface is two patches: the lower and upper half.
OBJ = """
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0
v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
v 0 0 2\nv 1 0 2\nv 1 1 2\nv 0 1 2
g foot
f 4 3 2 1
f 1 2 6 5
f 2/1 3/1 7/1 6/1
f 3 4 8 7 # back
f 4 1 5 8
g head left
f 5 6 10
f 5 10 9
f 6 7 11 10
f 7 8 12 11
f -5 -8 -4
f 8 9 12
f 9 10 11 12
"""


@pytest.fixture
def knife(tmp_path):
    """Two boxes that touch at x = 0, moved by their nodes, y up as in a GLB."""
    scene = trimesh.Scene()
    for name, x in (("blade", 0.02), ("grip", -0.02)):
        box = trimesh.creation.box((0.04, 0.01, 0.02))
        scene.add_geometry(
            box,
            node_name=name,
            transform=trimesh.transformations.translation_matrix((x, 0, 0)),
        )
    path = tmp_path / "knife.glb"
    path.write_bytes(scene.export(file_type="glb"))
    return path


def test_parts_of_a_glb_are_where_the_whole_mesh_has_them(knife):
    merged = jt.load_mesh(knife, unit="m", up="y", repair=False)
    meshes = jt.load_parts(knife, unit="m", up="y")
    assert sorted(meshes) == ["blade", "grip"]
    for mesh in meshes.values():
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(8e-6, rel=1e-6)
    assert meshes["blade"].bounds[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert meshes["grip"].bounds[1, 0] == pytest.approx(0.0, abs=1e-9)
    bounds = np.concatenate([p.bounds for p in meshes.values()])
    np.testing.assert_allclose(bounds.min(0), merged.bounds[0], atol=1e-9)
    np.testing.assert_allclose(bounds.max(0), merged.bounds[1], atol=1e-9)


def test_a_material_for_each_part_of_a_config(knife):
    config = BodyConfig.model_validate(
        {
            "mesh": {"path": str(knife), "unit": "m", "up": "y"},
            "pitch": 0.005,
            "material": {"parts": {"blade": "copper", "*": "brick"}},
            "temperature": 300,
        }
    )
    body = config.build()
    material = body.material
    number = material.of_nodes(body.structure)
    x = body.structure.nodes().centre[:, 0]
    copper = [m == jt.materials["copper"] for m in material.materials]
    assert (np.array(copper)[number] == (x > 0)).all()
    assert len(number) == 16 * 2 * 4


def test_groups_of_an_obj_that_are_patches_of_one_surface(tmp_path):
    path = tmp_path / "prism.obj"
    path.write_text(OBJ)
    meshes = jt.load_parts(path, height=0.2)
    assert list(meshes) == ["foot", "head left"]
    assert [len(p.faces) for p in meshes.values()] == [10, 10]
    assert not any(p.is_watertight for p in meshes.values())
    merged = jt.load_mesh(path, height=0.2)
    assert merged.is_watertight
    areas = sum(p.area for p in meshes.values())
    assert areas == pytest.approx(merged.area, rel=1e-9)
    grid = jt.voxelize(merged, 0.02)
    material = jt.materials_by_part(grid, meshes, {"foot": CLAY, "head left": STEEL})
    assert material.labels.shape == grid.solid.shape
    assert (material.labels[..., :5] == 0).all() and (
        material.labels[..., 5:] == 1
    ).all()


def test_parts_that_do_not_fit():
    box = shapes.box(0.04)
    grid = jt.voxelize(box, 0.01)
    meshes = {"a": box, "b": box.moved((1.0, 0.0, 0.0))}
    with pytest.raises(InputError, match="there is no part 'c'; there are a, b"):
        jt.materials_by_part(grid, meshes, {"c": CLAY})
    with pytest.raises(InputError, match="the part 'b' has none"):
        jt.materials_by_part(grid, meshes, {"a": CLAY})
    with pytest.raises(InputError, match="no part has any surface"):
        jt.materials_by_part(grid, {"b": meshes["b"]}, {"b": CLAY})


def test_files_without_parts(tmp_path):
    path = tmp_path / "box.stl"
    box = shapes.box(1.0)
    trimesh.Trimesh(box.vertices, box.faces).export(path)
    with pytest.raises(InputError, match=r"\.stl files have no named parts"):
        jt.load_parts(path, unit="mm")
    with pytest.raises(ValueError, match="only a `mesh` file has parts"):
        BodyConfig.model_validate(
            {
                "shape": {"kind": "box", "size": [1, 1, 1]},
                "pitch": 0.1,
                "material": {"parts": {"a": "copper"}},
                "temperature": 300,
            }
        )
