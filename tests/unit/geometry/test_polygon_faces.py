"""Faces of any number of corners are the polygon that they bound, in every format."""

import re

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry.files import file_mesh
from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.rotation import Turn
from tests.mesh_files import GIVEN, polygon_file, prism_polygons


U_PROFILE = np.array(
    [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], float
)
SUFFIXES = ["obj", "off", "ply", "ply_little", "ply_big"]


def loaded(folder, suffix, vertices, faces):
    path = folder / f"polygons.{suffix.split('_')[0]}"
    path.write_bytes(polygon_file(suffix, vertices, faces))
    return load_mesh(path, unit="m", repair=False)


def shoelace_area(outline):
    x, y = outline.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


@pytest.mark.parametrize("name", ["u_profile.obj", "u_profile.off"])
def test_given_files_of_a_concave_profile(name):
    mesh = load_mesh(GIVEN / name, unit="m", repair=False)
    assert mesh.is_watertight
    assert mesh.area == pytest.approx(30.0, rel=1e-12)
    assert mesh.volume == pytest.approx(7.0, rel=1e-12)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_concave_profile_in_every_format_with_polygons(tmp_path, suffix):
    mesh = loaded(tmp_path, suffix, *prism_polygons(U_PROFILE, 1.0))
    assert mesh.is_watertight
    assert mesh.area == pytest.approx(30.0, rel=1e-12)
    assert mesh.volume == pytest.approx(7.0, rel=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_prisms_over_random_outlines_in_random_directions(tmp_path, seed):
    """Volume is the shoelace area times the height, wherever the prism points."""
    random = np.random.default_rng(seed)
    count = int(random.integers(4, 25))
    # Sorted angles around a point within: such an outline does not cross itself.
    steps = random.uniform(0.5, 1.5, count)
    angle = 2.0 * np.pi * np.cumsum(steps) / steps.sum()
    radius = random.uniform(0.15, 1.0, count)
    outline = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices, faces = prism_polygons(outline, 0.7)
    axis = random.normal(size=3)
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    rotation = np.array(Turn((x, y, z), float(random.uniform(0, 6))).rotation)
    mesh = loaded(tmp_path, "obj", vertices @ rotation.T + 5.0, faces)
    sides = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum()
    area = shoelace_area(outline)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(0.7 * area, rel=1e-9)
    assert mesh.area == pytest.approx(2.0 * area + 0.7 * sides, rel=1e-9)


def test_corners_on_a_straight_side_leave_no_gap(tmp_path):
    """A neighbour has a vertex there: a triangle that passes it by is not joined."""
    halves = (U_PROFILE + np.roll(U_PROFILE, -1, axis=0)) / 2.0
    outline = np.stack([U_PROFILE, halves], axis=1).reshape(-1, 2)
    mesh = loaded(tmp_path, "obj", *prism_polygons(outline, 1.0))
    assert mesh.is_watertight
    assert mesh.area == pytest.approx(30.0, rel=1e-12)
    assert mesh.volume == pytest.approx(7.0, rel=1e-12)


@pytest.mark.parametrize("first", range(4))
def test_a_concave_quadrilateral_is_split_within(tmp_path, monkeypatch, first):
    """Whichever corner comes first, and without the package for longer polygons."""
    monkeypatch.setattr(file_mesh, "is_installed", lambda name: False)
    arrow = np.array([(0, 0), (2, -1), (0, 3), (-2, -1)], float)
    outline = np.roll(arrow, first, axis=0)
    mesh = loaded(tmp_path, "off", *prism_polygons(outline, 1.0))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(shoelace_area(arrow), rel=1e-12)


def test_a_quadrilateral_that_is_not_plane_is_two_triangles(tmp_path):
    vertices = np.array([(0, 0, 0), (1, 0, 0.3), (1, 1, 0), (0, 1, 0.3)])
    mesh = loaded(tmp_path, "obj", vertices, [[0, 1, 2, 3]])
    triangles = vertices[[[0, 1, 2], [0, 2, 3]]]
    sides = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2.0
    assert mesh.area == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize(
    "face",
    [[0, 2, 1, 3], [0, 1, 3, 2, 4], [0, 3, 1, 4, 2]],
    ids=["bow", "fold", "star"],
)
@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "ply_little"])
def test_a_face_that_crosses_itself_has_no_area(tmp_path, suffix, face):
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    vertices = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    if len(face) == 4:
        vertices = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 1, 0)], float)
        face = [0, 2, 1, 3]
    with pytest.raises(InputError, match=r"face 1, of \d corners, crosses itself"):
        loaded(tmp_path, suffix, vertices, [face])


def test_longer_concave_faces_say_which_package_they_need(tmp_path, monkeypatch):
    monkeypatch.setattr(file_mesh, "is_installed", lambda name: False)
    vertices, faces = prism_polygons(U_PROFILE, 1.0)
    expected = "concave faces, such as face 1, need the package mapbox_earcut"
    with pytest.raises(InputError, match=re.escape(expected)) as caught:
        loaded(tmp_path, "obj", vertices, faces)
    assert "make env EXTRAS=formats" in str(caught.value)
    angle = 2.0 * np.pi * np.arange(6) / 6
    outline = np.column_stack([np.cos(angle), np.sin(angle)])
    mesh = loaded(tmp_path, "obj", *prism_polygons(outline, 1.0))
    assert mesh.volume == pytest.approx(1.5 * np.sqrt(3.0), rel=1e-12)
