"""Insides of sheets: which side of which triangle the outside does not reach."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import jaxthermo as jt
from jaxthermo.geometry.mesh import Pose, joined
from jaxthermo.physics.surface import enclosing_bodies
from jaxthermo.sheets.insides import find_insides
from tests.radiating import shell


STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0)
LAYERS = (jt.Layer(STEEL, 1e-3),)
BOX = jt.shapes.box((1.0, 0.6, 0.5))
HERE = jt.Pose()


def sheet_of(*meshes, pitch=0.1):
    vertices, faces = joined([(mesh.vertices, mesh.faces) for mesh in meshes])
    return jt.Sheet(jt.Mesh(vertices, faces), LAYERS, pitch).grid


def turned_inward(mesh):
    return jt.Mesh(mesh.vertices, mesh.faces[:, ::-1])


def cavity_by_face(grid):
    """Numbers of the cavities in front of the front and of the back."""
    cavity = grid.fragment_cavity
    return [set(cavity[grid.fragment_face == face].tolist()) for face in (0, 1)]


def test_points_are_inside_a_box_if_they_are_between_its_faces():
    insides = find_insides(BOX.vertices, BOX.faces)
    assert insides is not None
    points = np.random.default_rng(1).uniform(-0.8, 0.8, (20_000, 3))
    lower, upper = BOX.bounds
    expected = ((points > lower) & (points < upper)).all(axis=1)
    assert_array_equal(insides.at(points) == 1, expected)
    # Rays through edges and corners of the mesh.
    middle = (lower + upper) / 2
    on_lines = middle + 0.499 * np.ptp([lower, upper], axis=0) * [[0, 0, 1], [1, 1, 1]]
    assert_array_equal(insides.at(on_lines), [1, 1])


def test_the_back_of_a_closed_sheet_is_inside():
    assert cavity_by_face(sheet_of(BOX)) == [{0}, {1}]


def test_an_inward_mesh_has_its_front_inside():
    grid = sheet_of(turned_inward(BOX))
    assert cavity_by_face(grid) == [{1}, {0}]
    assert_array_equal(np.unique(grid.face_space, axis=0), [[2, 1]])


def test_triangles_of_any_winding_have_one_side_inside():
    faces = BOX.faces.copy()
    faces[::3] = faces[::3, ::-1]
    grid = sheet_of(jt.Mesh(BOX.vertices, faces))
    # Where a front is inside, the normal points to the middle of the box.
    outward = np.einsum(
        "si,si->s", grid.fragment_normal, grid.fragment_position - BOX.bounds.mean(0)
    )
    assert_array_equal(grid.fragment_cavity > 0, outward < 0)


def test_nested_sheets_have_insides_of_their_own():
    small = jt.shapes.box((0.2, 0.2, 0.2)).moved((0.1, 0.0, 0.0))
    beside = jt.shapes.box((0.3, 0.3, 0.3)).moved((2.0, 0.0, 0.0))
    grid = sheet_of(small, BOX, beside)
    x = grid.fragment_position[:, 0]
    is_beside = x > 1.5
    is_small = np.abs(grid.fragment_position - [0.1, 0, 0]).max(axis=1) < 0.11
    for group, expected in [
        (is_beside, [{0}, {2}]),
        (is_small, [{1}, {3}]),
        (~is_beside & ~is_small, [{0}, {1}]),
    ]:
        for face in (0, 1):
            chosen = group & (grid.fragment_face == face)
            assert set(grid.fragment_cavity[chosen].tolist()) == expected[face]


def test_an_open_sheet_has_no_inside():
    open_box = jt.Mesh(BOX.vertices, BOX.faces[:-1])
    grid = sheet_of(open_box)
    assert grid.cavities is None
    assert cavity_by_face(grid) == [{0}, {0}]
    assert grid.cells.border > 0


def test_bodies_within_a_closed_sheet_are_enclosed():
    block = jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1)
    seat = jt.Sheet(jt.shapes.rectangle(0.2, 0.1), LAYERS, 0.05).grid
    grids = (sheet_of(BOX), block, seat, block)
    # The last one stands out of the box by half.
    poses = (HERE, HERE, jt.Pose((0.3, 0.0, 0.0)), jt.Pose((0.5, 0.0, 0.0)))
    closed = ("closed",) * 4
    van, inner, panel, half = enclosing_bodies(grids, poses, closed)
    assert_array_equal(van, np.where(grids[0].fragment_cavity > 0, 0, -1))
    assert (inner == 0).all() and (panel == 0).all()
    x = block.fragment_position[:, 0]
    assert half is not None
    assert_array_equal(half[x < -0.01], np.zeros((x < -0.01).sum()))
    assert_array_equal(half[x > 0.01], np.full((x > 0.01).sum(), -1))
    open_van = ("open", *closed[1:])
    assert enclosing_bodies(grids, poses, open_van) == [None] * 4


def test_the_innermost_of_two_sheets_encloses():
    outer = sheet_of(BOX)
    inner = sheet_of(jt.shapes.box((0.3, 0.3, 0.3)))
    block = jt.voxelize(jt.shapes.box((0.1, 0.1, 0.1)), 0.05)
    *_, around_block = enclosing_bodies(
        (inner, outer, block), (HERE,) * 3, ("closed",) * 3
    )
    assert (around_block == 0).all()


@pytest.mark.parametrize(
    ("on", "faces"),
    [
        (None, 1),
        (jt.Side((0.0, 0.0, 1.0), half_angle=np.pi), 1),
        (jt.Face("back"), 1),
        (jt.Face("back") | jt.Face("front"), 2),
    ],
)
def test_a_term_from_outside_acts_inside_if_it_names_the_face(on, faces):
    body = jt.Body(jt.Sheet(BOX, LAYERS, 0.25), temperature=300.0)
    scene = jt.Scene((body,), (jt.Convection(5.0, 290.0, on=on),))
    (part,) = jt.compile_scene(scene).receipt.parts
    assert part.area == pytest.approx(faces * BOX.area, rel=1e-6)


def test_the_receipt_tells_what_is_inside_and_what_has_a_border():
    van = jt.Body(jt.Sheet(BOX, LAYERS, 0.25), temperature=300.0)
    block = jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1)
    engine = jt.Body(jt.FullVolume(block), STEEL, temperature=300.0)
    roof = jt.Sheet(jt.shapes.rectangle(0.5, 0.5), LAYERS, 0.25)
    rack = jt.Body(roof, temperature=300.0, pose=Pose((0.0, 0.0, 1.0)))
    scene = jt.Scene((van, engine, rack), (jt.Convection(5.0, 290.0),))
    receipt = jt.compile_scene(scene).receipt
    text = "\n".join(receipt.notes)
    assert "50 % of the surface of body 0 faces closed cavities:" in text
    assert "100 % of the surface of body 1 faces closed cavities of body 0" in text
    assert "body 2 is a sheet with a border of 2 m:" in text
    assert {part.bodies for part in receipt.parts} == {(0,), (2,)}


def test_the_receipt_tells_that_a_partition_hides_an_inside():
    """A wall across the middle of a box, whose edges have three faces there."""
    left = jt.shapes.box((0.5, 0.6, 0.5)).moved((-0.25, 0.0, 0.0))
    right = jt.shapes.box((0.5, 0.6, 0.5)).moved((0.25, 0.0, 0.0))
    # Both boxes have the wall between them: of equal faces one is left.
    vertices, faces = joined([(box.vertices, box.faces) for box in (left, right)])
    sheet = jt.Sheet(jt.Mesh(vertices, faces), LAYERS, 0.1)
    assert sheet.grid.cells.border == 0
    assert sheet.grid.cells.partitions == pytest.approx(2 * (0.6 + 0.5), rel=1e-9)
    scene = jt.Scene(
        (jt.Body(sheet, temperature=300.0),), (jt.Convection(10.0, 290.0),)
    )
    text = "\n".join(jt.compile_scene(scene).receipt.notes)
    assert "body 0 is a sheet with partitions joined along 2.2 m:" in text


def test_the_receipt_tells_that_a_sheet_is_in_the_cavity_of_a_solid():
    case = jt.FullVolume(jt.voxelize(shell(0.06, 0.1, 2), 0.02))
    plate = jt.Sheet(jt.shapes.rectangle(0.04, 0.04), LAYERS, 0.02)
    bodies = (
        jt.Body(case, STEEL, temperature=300.0),
        jt.Body(plate, temperature=300.0),
    )
    scene = jt.Scene(bodies, (jt.Convection(5.0, 290.0),))
    receipt = jt.compile_scene(scene).receipt
    assert {part.bodies for part in receipt.parts} == {(0,)}
    (line,) = (note for note in receipt.notes if "surface of body 1" in note)
    assert line.startswith("100 % of the surface of body 1 faces closed cavities of")
    assert "air, sun and surroundings act there only with `inside: open`" in line
