"""Candidates for joints: parts of a mesh file that touch as joints count it."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.cli.scene_start import scene_start
from jaxthermo.cli.touching_parts import DividedPart, touching_parts
from jaxthermo.config.loader import load_config
from jaxthermo.scene.compile.compile import compile_scene
from tests.mesh_files import GltfWriter, box_primitive


def solid(size, place):
    return DividedPart(jt.shapes.box(size).moved(place), pitch=0.05, is_sheet=False)


def sheet(place, turn=0.0):
    upright = jt.Pose.about((0.0, 1.0, 0.0), np.radians(turn))
    panel = jt.shapes.rectangle(0.4, 0.2).placed(upright).moved(place)
    return DividedPart(panel, pitch=0.1, is_sheet=True)


CUBE = solid((0.2, 0.2, 0.2), (0.0, 0.0, 0.0))
PANEL = sheet((0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("first", "second", "touch"),
    [
        # Solids: a face, within a voxel; apart by more; an edge; one in the other.
        (CUBE, solid((0.2, 0.1, 0.1), (0.2, 0.05, 0.05)), True),
        (CUBE, solid((0.2, 0.1, 0.1), (0.24, 0.05, 0.05)), True),
        (CUBE, solid((0.2, 0.1, 0.1), (0.26, 0.05, 0.05)), False),
        (CUBE, solid((0.2, 0.2, 0.2), (0.2, 0.2, 0.0)), False),
        (CUBE, solid((0.1, 0.1, 0.1), (0.0, 0.0, 0.0)), False),
        # Borders in a line, at an angle, on a face; apart by more than a tenth; a
        # corner.
        (PANEL, sheet((0.4, 0.0, 0.0)), True),
        (PANEL, sheet((0.2, 0.0, 0.2), 90.0), True),
        (PANEL, sheet((0.05, 0.0, 0.2), 90.0), True),
        (PANEL, sheet((0.412, 0.0, 0.0)), False),
        (PANEL, sheet((0.4, 0.2, 0.0)), False),
        # Sheets face to face, a sheet on a solid, and one that ends on it.
        (PANEL, sheet((0.1, 0.05, 0.009)), True),
        (PANEL, sheet((0.1, 0.05, 0.011)), False),
        (CUBE, sheet((0.0, 0.0, 0.1)), True),
        (CUBE, sheet((0.3, 0.0, 0.02)), True),
        (CUBE, sheet((0.31, 0.0, 0.02)), False),
    ],
)
def test_parts_touch_over_faces_and_along_borders(first, second, touch):
    assert bool(touching_parts([first, second])) is touch
    assert bool(touching_parts([second, first])) is touch


def test_candidates_are_the_joints_that_the_scene_finds(tmp_path):
    """A shelf of two boards between posts, with a lamp that touches nothing."""
    writer = GltfWriter()
    post = writer.mesh(box_primitive(writer, (0.1, 0.1, 0.6)), name="post")
    lamp = writer.mesh(box_primitive(writer, (0.1, 0.1, 0.1)), name="lamp")
    corners = [[0, 0, 0], [0.4, 0, 0], [0.4, 0.2, 0], [0, 0.2, 0]]
    faces = writer.accessor([0, 1, 2, 0, 2, 3], "u2")
    attributes = {"POSITION": writer.accessor(corners)}
    board = writer.mesh({"attributes": attributes, "indices": faces})
    places = {
        "post_left": (post, (-0.05, 0.1, 0.3)),
        "post_right": (post, (0.85, 0.1, 0.3)),
        "board_left": (board, (0.0, 0.0, 0.3)),
        "board_right": (board, (0.4, 0.0, 0.3)),
        "lamp": (lamp, (0.4, 0.1, 0.5)),
    }
    for name, (mesh, place) in places.items():
        writer.node(name=name, mesh=mesh, translation=list(place))
    path = tmp_path / "shelf.glb"
    path.write_bytes(writer.glb())
    start = scene_start(
        {"path": str(path), "unit": "m", "up": "z"}, jt.load_parts(path, unit="m")
    )
    (tmp_path / "shelf.yaml").write_text(start)
    config = load_config(
        tmp_path / "shelf.yaml", ["assembly.temperature=20 degC", "assembly.pitch=0.1"]
    )
    names = [body.name for body in config.bodies]
    joined = {
        tuple(sorted(str(names[number]) for number in part.bodies))
        for part in compile_scene(config.build()).receipt.parts
        if part.mechanism.startswith(("contact", "seam"))
    }
    assert joined == {
        ("board_left", "board_right"),
        ("board_left", "post_left"),
        ("board_right", "post_right"),
    }
