"""Slips of a Python user: an `InputError` with what, where and a remedy, in one line.

The type checks of the tests are off here, as for a user: they would come first.
"""

import warnings
from typing import Any

import jaxtyping
import numpy as np
import pytest
import trimesh
from bodies import bar

import jaxthermo
from jaxthermo.errors import require


# Without types: each mistake here is one that a type checker reports too.
jt: Any = jaxthermo
STEEL = jt.Material(16.0, 8000.0, 500.0)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.fixture(autouse=True)
def as_a_user():
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="module")
def grid():
    return bar(3, 0.01)


def body(grid, **changes):
    values = {"structure": jt.FullVolume(grid), "material": STEEL, "temperature": 300.0}
    values |= changes
    return jt.Body(values.pop("structure"), values.pop("material"), **values)


MISTAKES = {
    "a material's name": (lambda g: body(g, material="copper"), 'materials["copper"]'),
    "a class of material": (lambda g: body(g, material=jt.Material), "class Material"),
    "a grid as structure": (lambda g: body(g, structure=g), "FullVolume(grid)"),
    "a class of structure": (lambda g: body(g, structure=jt.FullVolume), "the class"),
    "a mesh in a structure": (lambda g: jt.FullVolume(g.mesh), "voxelize(mesh, pitch)"),
    "a mesh in an octree": (lambda g: jt.Octree(g.mesh), "voxelize(mesh, pitch)"),
    "a pose of numbers": (lambda g: body(g, pose=(0, 0, 1)), "a Pose or a Motion"),
    "a map's name": (lambda g: body(g, surface_map="linear"), "FluxCorrectedMap()"),
    "a lone body": (lambda g: jt.Scene(body(g)), "a tuple, each a Body"),
    "a class of body": (lambda g: jt.Scene((jt.Body,)), "is the class Body itself"),
    "a lone term": (
        lambda g: jt.Scene((body(g),), jt.Convection(1.0, 300.0)),
        "a tuple, each a term",
    ),
    "the kind of a pair": (
        lambda g: jt.Contact(1.0, bodies="roof"),
        "give two, as in bodies=(0, 1)",
    ),
    "one body of a pair": (lambda g: jt.Seam(1.0, bodies=(0,)), "give two, as in"),
    "half a body": (
        lambda g: jt.Scene((body(g),), (jt.HeatFlux(1.0, on=jt.Everything(0.5)),)),
        "terms[0] is on body 0.5: give a number or a name",
    ),
    "a text as a temperature": (lambda g: body(g, temperature="300"), "give kelvin"),
    "no function in a rule": (lambda g: jt.Rule("*", 3), "give a function from a mesh"),
    "a rule without a name": (lambda g: jt.Rule([], len), "give a pattern of names"),
    "a number as a name": (lambda g: jt.Rule(3, len), "give a pattern of names"),
    "a lone rule": (
        lambda g: jt.assembly({"a": g.mesh}, jt.Rule("*"), temperature=300.0),
        'give rules, as in [Rule("*", structure)]',
    ),
    "meshes without names": (
        lambda g: jt.assembly([g.mesh], [jt.Rule("*")], temperature=300.0),
        "give meshes by their names",
    ),
    "no parts": (
        lambda g: jt.assembly({}, [jt.Rule("*")], temperature=300.0),
        "give meshes by their names",
    ),
    "no pair of a joint": (
        lambda g: jt.joints((body(g),), {"roof": 1.0}),
        "'roof' is no pair: give two patterns of names",
    ),
    "a class of term": (lambda g: jt.Scene((body(g),), (jt.Sun,)), "Scene(terms[0]=S"),
    "a class as a selection": (
        lambda g: jt.Scene((body(g),), (jt.HeatFlux(1.0, on=jt.Side),)),
        "terms[0](on=Side)",
    ),
    "a word as a selection": (
        lambda g: jt.Scene((body(g),), (jt.HeatFlux(1.0, on="top"),)),
        "Side((0.0, 0.0, 1.0))",
    ),
    "a text as a coefficient": (lambda g: jt.Convection("10", 300.0), "got '10'"),
    "nothing as a coefficient": (lambda g: jt.Convection(None, 300.0), "a finite num"),
    "a pitch with a unit": (lambda g: jt.voxelize(g.mesh, "2 mm"), "such as 0.002"),
    "a pitch of nothing": (lambda g: jt.voxelize(g.mesh, None), "such as 0.002"),
    "an unknown surface": (
        lambda g: jt.voxelize(g.mesh, 0.1, "cubes"),
        'choose "crossings" or',
    ),
    "a path as a mesh": (lambda g: jt.voxelize("a.ply", 0.1), "load_mesh(...)"),
    "a class of mesh": (lambda g: jt.voxelize(jt.Mesh, 0.1), "is the class Mesh"),
    "float faces": (lambda g: jt.Mesh(CORNERS, FACES * 1.0), "three whole numbers"),
    "faces from 1": (lambda g: jt.Mesh(CORNERS, FACES + 1), "1 to 4, and there are 4"),
    "quads": (lambda g: jt.Mesh(CORNERS, FACES[:, [0, 1, 2, 0]]), "of shape (4, 4)"),
    "flat vertices": (lambda g: jt.Mesh(CORNERS[:, :2], FACES), "of shape (4, 2)"),
    "ragged faces": (lambda g: jt.Mesh(CORNERS, [[0, 1, 2], [1]]), "three numbers"),
    "no position": (lambda g: jt.Mesh(CORNERS * np.nan, FACES), "NaN or infinite"),
    "a short normal": (lambda g: jt.Side((1.0, 0.0)), "Side(normal=)"),
    "an angle in text": (lambda g: jt.Side((1, 0, 0), half_angle="45 deg"), "radians"),
    "flat corners": (lambda g: jt.Region((0, 0), (1, 1)), "two corners"),
    "corners in text": (lambda g: jt.Region("low", "high"), "two corners"),
    "a short translation": (lambda g: jt.Pose((1.0, 2.0)), "Pose(translation="),
    "an angle as rotation": (lambda g: jt.Pose(rotation=0.5), "3 x 3 rotation matrix"),
    "a body as a scene": (lambda g: jt.simulate(body(g), 1.0), "simulate(scene=Body("),
    "a class of solver": (
        lambda g: jt.simulate(jt.Scene((body(g),)), 1.0, solver=jt.TRBDF2),
        "is the class TRBDF2 itself",
    ),
    "an end with a unit": (lambda g: jt.simulate(jt.Scene((body(g),)), "3 min"), "t1="),
    "a lone save time": (
        lambda g: jt.simulate(jt.Scene((body(g),)), 9.0, 3.0),
        "save_at=3.0: give a list",
    ),
    "a steady body": (lambda g: jt.steady(body(g)), "steady(scene=Body("),
    "a scene to render": (
        lambda g: jt.render(jt.Scene((body(g),)), None),
        "render(solution=Scene(",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_slip_is_one_line_that_says_what_to_do(grid, mistake):
    make, words = MISTAKES[mistake]
    with pytest.raises(jt.InputError) as caught:
        make(grid)
    message = str(caught.value)
    assert words in message
    assert "\n" not in message and len(message) < 250


def test_lists_and_numbers_of_numpy_are_taken_as_they_are(grid):
    mesh = jt.Mesh(CORNERS.tolist(), FACES.tolist())
    assert mesh.volume == pytest.approx(1 / 6)
    of_integers = jt.Mesh(CORNERS.astype(int), FACES.astype(np.int32))
    assert of_integers.vertices.dtype == float
    axis = np.array([0.0, 0.0, 1.0])
    unity = np.float64(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        side = jt.Side(axis, body=np.int64(0), half_angle=np.float32(0.5))
        assert side == jt.Side((0.0, 0.0, 1.0), half_angle=0.5)
        assert jt.Side((np.float64(0), 0.0, unity)) == jt.Side((0.0, 0.0, 1.0))
        box = jt.Region(np.zeros(3), (unity, 2 * unity, np.int32(3)))
        assert box == jt.Region((0.0, 0.0, 0.0), (1.0, 2.0, 3))
        assert jt.Everything(body=np.int32(1)) == jt.Everything(1)
        pose = jt.Pose(axis, np.eye(3))
        assert pose == jt.Pose((0.0, 0.0, 1.0))
        scene = jt.Scene([body(grid, pose=pose)], [jt.HeatFlux(unity, on=side)])
    # Static fields must be hashable.
    assert len({hash(value) for value in (side, box, pose)}) == 3
    assert len(scene.bodies) == 1


def test_a_mesh_of_trimesh_is_voxelized(grid):
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    repaired = jt.voxelize(sphere, pitch=0.01)
    expected = jt.voxelize(
        jt.Mesh(np.array(sphere.vertices), np.array(sphere.faces)), 0.01
    )
    np.testing.assert_array_equal(repaired.solid, expected.solid)
    np.testing.assert_array_equal(repaired.fragment_area, expected.fragment_area)
    assert repaired.fragment_area.sum() == pytest.approx(sphere.area)
    # Turned inside out, as many exporters do: repaired, as a file would be.
    sphere.invert()
    again = jt.voxelize(sphere, pitch=0.01)
    np.testing.assert_array_equal(again.solid, expected.solid)
    assert (again.fragment_normal * again.fragment_position).sum() > 0


def test_a_grid_is_shown_in_one_line(grid):
    assert repr(grid) == (
        f"VoxelGrid('{grid.mesh.name}', 3 x 1 x 1 voxels of 0.01 m, 3 solid, "
        f"{len(grid.fragment_area)} fragments)"
    )
    assert len(repr(jt.FullVolume(grid))) < 500


def test_a_long_value_is_shortened():
    with pytest.raises(jt.InputError) as caught:
        require("x" * 999, classes=float, argument="f(a=)", give="a number")
    assert str(caught.value) == f"f(a='{'x' * 56}...): give a number"
