"""Named parts of GLB and OBJ files, and the voxels and materials of each."""

import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import jaxthermo as jt
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.part_names import matching_parts
from tests.mesh_files import box_gltf, box_primitive


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
    assert sorted(meshes) == ["blade/geometry_0/-", "grip/geometry_1/-"]
    for mesh in meshes.values():
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(8e-6, rel=1e-6)
    by_node = {name.split("/")[0]: mesh for name, mesh in meshes.items()}
    assert by_node["blade"].bounds[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert by_node["grip"].bounds[1, 0] == pytest.approx(0.0, abs=1e-9)
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


def test_a_material_for_each_part_of_a_shape():
    head = {"kind": "box", "size": [0.04, 0.04, 0.02]}
    handle = {"kind": "box", "size": [0.02, 0.02, 0.06]}
    config = BodyConfig.model_validate(
        {
            "shape": {
                "kind": "parts",
                "parts": {
                    "head": {"shape": head, "pose": {"translation": [0, 0, 0.04]}},
                    "handle": {"shape": handle},
                },
            },
            "pitch": 0.01,
            "material": {"parts": {"head": "steel", "handle": "timber"}},
            "temperature": 300,
        }
    )
    body = config.build()
    number = body.material.of_nodes(body.structure)
    steel = [m == jt.materials["steel"] for m in body.material.materials]
    centre = body.structure.nodes().centre
    assert (np.array(steel)[number] == (centre[:, 2] > 0.03)).all()
    assert len(number) == 4 * 4 * 2 + 2 * 2 * 6


def test_groups_of_an_obj_that_are_patches_of_one_surface(tmp_path):
    path = tmp_path / "prism.obj"
    path.write_text(OBJ)
    meshes = jt.load_parts(path, height=0.2)
    assert list(meshes) == ["-/foot/-", "-/head left/-"]
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


@pytest.mark.parametrize("is_reversed", [False, True])
def test_the_front_of_an_open_part_is_where_the_file_has_it(tmp_path, is_reversed):
    """A floor and a wall: the same mesh as one of a solid would be turned outward."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 1, 1), (0, 1, 1)]
    faces = [(1, 2, 3), (1, 3, 4), (4, 3, 5), (4, 5, 6)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    order = -1 if is_reversed else 1
    lines += ["f {} {} {}".format(*face[::order]) for face in faces]
    path = tmp_path / "corner.obj"
    path.write_text("\n".join(lines) + "\n")
    (part,) = jt.load_parts(path, unit="m").values()
    assert "flipped_faces" not in part.repairs
    up, _, _ = part.area_vectors[0][::-1]
    assert np.sign(up) == (-1.0 if is_reversed else 1.0)


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


def test_a_file_without_names_is_one_part(tmp_path):
    path = tmp_path / "box.stl"
    box = shapes.box(1.0)
    trimesh.Trimesh(box.vertices, box.faces).export(path)
    meshes = jt.load_parts(path, unit="mm")
    assert list(meshes) == ["-/-/-"]
    assert meshes["-/-/-"].volume == pytest.approx(1e-9)


def test_a_shape_has_no_parts():
    with pytest.raises(
        ValueError, match="only a `mesh` file or a `shape` of kind `parts` has"
    ):
        BodyConfig.model_validate(
            {
                "shape": {"kind": "box", "size": [1, 1, 1]},
                "pitch": 0.1,
                "material": {"parts": {"a": "copper"}},
                "temperature": 300,
            }
        )


OBJ_MATERIALS = """
v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1
o lamp\ng shade\nusemtl brass\nf 1 3 2
usemtl glass\nf 1 2 4
g\nusemtl brass\nf 1 4 3
o lamp\ng shade\nf 2 3 4
"""


def test_objects_groups_and_materials_of_an_obj(tmp_path):
    """A part that goes on further down is one part: 2 of the 4 faces are its own."""
    path = tmp_path / "lamp.obj"
    path.write_text(OBJ_MATERIALS)
    meshes = jt.load_parts(path, unit="m")
    areas = {name: mesh.area for name, mesh in meshes.items()}
    slanted = np.sqrt(3.0) / 2.0
    assert areas == pytest.approx(
        {
            "lamp/shade/brass": 0.5 + slanted,
            "lamp/shade/glass": 0.5,
            "lamp/-/brass": 0.5,
        }
    )


def many_parts():
    """Four nodes, two of one name and mesh, two without; the mesh has two materials."""
    writer = box_gltf(name="wheel")
    writer.document["materials"] = [{"name": "rubber"}, {}]
    mesh = writer.document["meshes"][0]
    mesh["name"] = "tyre/rim"
    mesh["primitives"][0]["material"] = 0
    mesh["primitives"].append(box_primitive(writer) | {"material": 1})
    writer.node(mesh=0, name="wheel", translation=[5.0, 0.0, 0.0])
    writer.node(mesh=writer.mesh(box_primitive(writer)))
    writer.node(mesh=1)
    return writer.glb()


MANY_NAMES = [
    "wheel/tyre_rim/rubber",
    "wheel/tyre_rim/material1",
    "wheel/tyre_rim/rubber#2",
    "wheel/tyre_rim/material1#2",
    "node2/mesh1/-",
    "node3/mesh1/-",
]


def test_equal_names_are_numbered(tmp_path):
    path = tmp_path / "car.glb"
    path.write_bytes(many_parts())
    meshes = jt.load_parts(path, unit="m", up="y")
    assert list(meshes) == MANY_NAMES
    assert meshes["wheel/tyre_rim/rubber#2"].bounds.mean(0)[0] == pytest.approx(5.0)


def test_names_are_the_same_in_another_process(tmp_path):
    path = tmp_path / "car.glb"
    path.write_bytes(many_parts())
    program = "import sys, jaxthermo as jt; print(*jt.load_parts(sys.argv[1], unit=1))"
    printed = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        env=os.environ | {"PYTHONHASHSEED": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert printed.stdout.split() == MANY_NAMES


@pytest.mark.parametrize(
    ("pattern", "numbers"),
    [
        ("wheel", [0, 1, 2, 3]),
        ("tyre_rim", [0, 1, 2, 3]),
        ("rubber", [0, 2]),
        ("node*", [4, 5]),
        ("mesh?", [4, 5]),
        ("-", [4, 5]),
        ("wheel/tyre_rim/rubber", [0]),
        ("wheel/*/rubber*", [0, 2]),
        ("*/material1#2", [3]),
        ("whee", []),
        ("wheel/tyre_rim", []),
        ("*", [0, 1, 2, 3, 4, 5]),
        ("n.de2", []),
    ],
)
def test_patterns_of_names(pattern, numbers):
    expected = [MANY_NAMES[number] for number in numbers]
    assert matching_parts(pattern, MANY_NAMES) == expected


def test_materials_by_patterns():
    box = shapes.box(0.04)
    meshes = {"a/m/steel": box, "b/m/steel": box.moved((0.04, 0.0, 0.0))}
    grid = jt.voxelize(shapes.box((0.08, 0.04, 0.04)).moved((0.02, 0.0, 0.0)), 0.01)
    material = jt.materials_by_part(grid, meshes, {"m": CLAY, "b/m/steel": STEEL})
    assert material.given == (CLAY, STEEL)
    assert material.names == tuple(meshes)
    expected = "both 'm' and 'b' match the part 'b/m/steel': give its whole name"
    with pytest.raises(InputError, match=expected):
        jt.materials_by_part(grid, meshes, {"m": CLAY, "b": STEEL})
    many = {f"n{number}/m/-": box for number in range(40)}
    with pytest.raises(InputError, match=r"n11/m/- and 28 more \(jaxthermo parts"):
        jt.materials_by_part(grid, many, {"c": CLAY})
    with pytest.raises(InputError, match="there is no part 'c'"):
        jt.materials_by_part(grid, meshes, {"c": CLAY, "*": STEEL})


def test_extent_does_not_hang_on_rounding():
    turn = trimesh.transformations.rotation_matrix(0.37, (0.3, 0.1, 1.0))[:3, :3]
    line = np.outer((0.0, 1.0, 3.0), (0.1, 0.03, 0.07)).astype(np.float32)
    triangle = np.array([[0, 1, 2]])
    wire = jt.Mesh(line @ turn.T, triangle)
    assert wire.area > 0.0
    assert not wire.has_extent
    assert not jt.Mesh(0.0 * line, triangle).has_extent
    # A strip a hundred thousand times as long as wide, and a small one.
    strip = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1e-5, 0.0]]
    assert jt.Mesh(np.array(strip), triangle).has_extent
    assert jt.Mesh(1e-6 * np.eye(3), triangle).has_extent


def test_a_flattened_box_encloses_no_volume():
    box = shapes.box((0.05, 0.05, 0.05))
    turn = trimesh.transformations.rotation_matrix(0.37, (0.3, 0.1, 1.0))[:3, :3]
    foil = jt.Mesh(box.vertices * (1.0, 1.0, 1e-4) @ turn.T, box.faces)
    flat = jt.Mesh(box.vertices * (1.0, 1.0, 0.0) @ turn.T, box.faces)
    assert foil.encloses_volume
    assert flat.is_watertight
    assert flat.has_extent
    assert not flat.encloses_volume
