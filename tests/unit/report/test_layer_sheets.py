"""Sheets of voxels, layers and contact: colours that mean what their legends say."""

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.report import layer_sheets, voxel_sheet as voxel_sheet_module
from jaxthermo.report.layer_sheets import _contact_tiles, _legend, depth_bar
from jaxthermo.report.sheet import Legend, Tile, sheet
from jaxthermo.report.voxel_sheet import _COLOURS, _Faces, voxel_sheet
from jaxthermo.voxels.voxelize import voxelize


GRID = voxelize(shapes.box((6.0, 4.0, 2.0)), 1.0)


def block_and_plate(height):
    """A block of 6 x 6 x 6 voxels beside a plate 0.4 voxel thick at some height."""
    block = shapes.box((6.0, 6.0, 6.0))
    plate = shapes.box((8.0, 8.0, 0.4)).moved((12.0, 0.0, height))
    faces = np.concatenate([block.faces, plate.faces + len(block.vertices)])
    return Mesh(np.concatenate([block.vertices, plate.vertices]), faces)


def test_the_faces_of_a_block_of_voxels():
    faces = _Faces(GRID)
    # Two triangles for each face, and the area of the block.
    assert len(faces.axis) == 2 * (6 * 4 + 4 * 2 + 6 * 2)
    a, b, c = np.moveaxis(faces.triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    assert np.linalg.norm(normal, axis=1).sum() / 2 == pytest.approx(88.0)
    # Outward: they point away from the middle of a convex body.
    assert (np.einsum("ij,ij->i", normal, a) > 0).all()
    assert (faces.kind == 0).all()


@pytest.mark.parametrize(
    ("height", "marking"), [(0.5, 1), pytest.param(0.0, 2, marks=pytest.mark.slow)]
)
def test_thin_and_lost_parts_have_their_colours(height, marking, monkeypatch):
    monkeypatch.setattr(voxel_sheet_module, "_EDGE", 240)
    grid = voxelize(block_and_plate(height), 1.0)
    faces = _Faces(grid)
    centre = faces.triangles.reshape(-1, 6, 3).mean(1)
    # The plate alone is marked, as what it is.
    assert (faces.kind[centre[:, 0] > 7.0] == marking).all()
    assert (faces.kind[centre[:, 0] < 4.0] == 0).all()
    marked = (np.asarray(voxel_sheet(grid)) == _COLOURS[marking]).all(-1)
    # Seen from above in more pixels than the square of the legend has.
    assert marked.sum() > 400


def test_depths_are_labelled_in_millimetres():
    bar = depth_bar(GRID, "x", "depth")
    # The lattice has six voxels of 1 m along x.
    np.testing.assert_allclose([p * 6000 for p, _ in bar.ticks], np.arange(7) * 1000)
    assert bar.ticks[-1][1] == "6000"
    assert bar.colours[0, 0] == 255 and bar.colours[-1, 0] == 65


def test_the_legend_of_normals():
    entries = dict(_legend("normal").entries)
    assert entries["+x"] == (255, 128, 128) and entries["-z"] == (128, 128, 0)


def test_a_legend_shows_all_its_colours():
    colours = ((250, 10, 20), (10, 240, 30), (20, 30, 230))
    legend = Legend(tuple((f"kind {k}", c) for k, c in enumerate(colours)), "title")
    image = sheet([Tile(np.zeros((40, 40, 3), np.uint8), "tile")], legend, "sheet")
    pixels = np.asarray(image)
    places = [np.argwhere((pixels == c).all(-1)).mean(0) for c in colours]
    assert places[0][1] < places[1][1] < places[2][1] < pixels.shape[1]


def test_contact_tiles_are_the_layers_that_touch():
    values = np.where(GRID.fragment_normal[:, 2] > 0.9, 0.5, np.nan)
    tiles = _contact_tiles("block", GRID, values, 0.0, 1.0)
    assert [(t.label, t.note) for t in tiles] == [
        ("block, z layer 1", "24 fragments in contact")
    ]


def test_contact_of_crossings_is_shown_in_the_view_of_the_dominant_axis():
    """On the upper half of a ball: once for each piece of surface."""
    ball = voxelize(shapes.sphere(1.0), 0.2)
    up = ball.fragment_normal[:, 2]
    values = np.where(up > 0.9, 0.5, np.nan)
    (tile,) = _contact_tiles("ball", ball, values, 0.0, 1.0)
    assert tile.label == "ball, z layer 1"
    touching = np.count_nonzero((up > 0.9) & (ball.fragment_axis == 2))
    assert tile.note == f"{touching} fragments in contact"
    assert touching < np.count_nonzero(up > 0.9)


def test_every_kind_of_layer_has_a_sheet(tmp_path):
    paths = layer_sheets.write_layer_sheets(GRID, tmp_path)
    contents = ("depth", "normal", "dominant", "packed")
    assert {p.name for p in paths} == {
        f"layers_{a}_{k}.png" for a in "xyz" for k in contents
    }
