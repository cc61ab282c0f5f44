"""Procedural bodies and surfaces match their closed forms; bodies point outward."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Pose, describe_mesh
from jaxthermo.geometry.repair import repair_mesh


ALL = [
    shapes.box(0.3),
    shapes.box((1, 2.0, 3.0)),
    shapes.slab(0.01, 0.2, 0.3),
    shapes.sphere(0.5),
    shapes.cylinder(0.2, 0.7),
    shapes.tube(0.2, 0.15, 0.7),
    shapes.cone(0.2, 0.7),
    shapes.cone(0.2, 0.7, top_radius=0.1),
    shapes.hemisphere(0.2),
    shapes.capsule(0.2, 0.7),
    shapes.capsule(0.2, 0.4),
    shapes.prism([(-1, -1), (1, -1), (0, 1)], 0.5),
    shapes.prism([(-1, -1), (-1, 1), (1, 1), (1, -1)], 0.5),
]
L_OUTLINE = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3)]


@pytest.mark.parametrize("mesh", ALL)
def test_closed_outward_centred(mesh):
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    assert mesh.bounds.mean(0) == pytest.approx(np.zeros(3), abs=1e-2 * mesh.area**0.5)
    assert repair_mesh(mesh).repairs == {}


def test_box_and_slab():
    assert shapes.box((1.0, 2.0, 3.0)).volume == pytest.approx(6.0)
    assert shapes.box((1.0, 2.0, 3.0)).area == pytest.approx(22.0)
    assert shapes.box(2).volume == pytest.approx(8.0)
    size = np.ptp(shapes.slab(0.01, 0.2, 0.3).bounds, axis=0)
    assert size == pytest.approx([0.01, 0.2, 0.3])


def test_prism_of_a_concave_outline():
    mesh = shapes.prism(L_OUTLINE, 0.5)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4.0 * 0.5)
    assert mesh.area == pytest.approx(2 * 4.0 + 10.0 * 0.5)
    assert shapes.prism(L_OUTLINE[::-1], 0.5).volume == pytest.approx(mesh.volume)
    np.testing.assert_allclose(mesh.bounds, [[0, 0, -0.25], [2, 3, 0.25]])


SURFACES = {
    "rectangle": (shapes.rectangle(2.0, 3.0), 6.0, 10.0, (0, 0, 1)),
    "disc": (shapes.disc(0.5), np.pi / 4, 64 * 2 * 0.5 * np.sin(np.pi / 64), (0, 0, 1)),
    "pipe": (shapes.pipe(0.5, 3.0), np.pi * 3.0, 2 * np.pi, (0, 0, 0)),
    "tray": (shapes.tray((1.0, 2.0, 3.0)), 22.0 - 2.0, 6.0, (0, 0, -1)),
    "polygon": (
        shapes.polygon([(0.0, y, z) for y, z in L_OUTLINE]), 4.0, 10.0, (1, 0, 0)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(SURFACES))
def test_surfaces_have_their_areas_borders_and_fronts(name):
    mesh, area, border, front = SURFACES[name]
    assert mesh.name == name
    assert mesh.area == pytest.approx(area, rel=1e-12)
    edges = np.concatenate([mesh.faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    unique, inverse = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    is_border = np.bincount(inverse.ravel()) == 1
    ends = mesh.vertices[unique[is_border]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
    assert length == pytest.approx(border, rel=1e-3)
    assert mesh.open_edges == is_border.sum()
    total = mesh.area_vectors.sum(axis=0)
    if name == "tray":
        total = total / (1.0 * 2.0) * area
    assert total == pytest.approx(area * np.array(front), abs=1e-12)


def test_joined_meshes_keep_their_triangles():
    tray = shapes.tray((1.0, 2.0, 3.0))
    lid = shapes.rectangle(1.0, 2.0).moved((0.0, 0.0, 1.5))
    mesh = shapes.joined(tray, lid)
    assert mesh.area == pytest.approx(22.0)
    assert len(mesh.faces) == 12
    assert not mesh.is_watertight
    assert repair_mesh(mesh).is_watertight
    assert shapes.joined(lid).area == lid.area
    with pytest.raises(InputError, match="at least one mesh"):
        shapes.joined()


def test_the_front_of_a_pipe_is_outside():
    mesh = shapes.pipe(0.5, 3.0)
    centres = mesh.triangles.mean(axis=1)
    outward = (centres[:, :2] * mesh.area_vectors[:, :2]).sum(axis=1)
    assert (outward > 0).all()
    assert np.ptp(mesh.bounds[:, 2]) == pytest.approx(3.0)


def test_surfaces_that_cannot_be():
    with pytest.raises(InputError, match="width=-1"):
        shapes.rectangle(-1.0, 2.0)
    with pytest.raises(InputError, match="sections=2 make no disc"):
        shapes.disc(1.0, sections=2)
    with pytest.raises(InputError, match="sections=2 make no pipe"):
        shapes.pipe(1.0, 1.0, sections=2)
    with pytest.raises(InputError, match="polygon.*three or more points of 3"):
        shapes.polygon([(0, 0, 0), (1, 0, 0)])
    with pytest.raises(InputError, match="polygon.*three or more points of 3"):
        shapes.polygon([(0, 0), (1, 0), (1, 1)])
    with pytest.raises(InputError, match="prism.*three or more points of 2"):
        shapes.prism([(0, 0), (1, 0), (1, float("nan"))], 1.0)
    with pytest.raises(InputError, match="lie on a line"):
        shapes.polygon([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    with pytest.raises(InputError, match="differ by 0.0990148 m from a plane"):
        shapes.polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0.2), (0, 1, 0)])
    with pytest.raises(InputError, match="crosses itself"):
        shapes.polygon([(0, 0, 0), (2, 0, 0), (0, 2, 0), (1, 3, 0)])


def test_sphere_converges():
    exact = 4.0 * np.pi * 0.25
    errors = []
    for subdivisions in (2, 3, 4):
        mesh = shapes.sphere(0.5, subdivisions)
        assert len(mesh.faces) == 20 * 4**subdivisions
        assert mesh.volume == pytest.approx(np.pi / 6.0, rel=1e-12)
        errors.append(mesh.area / exact - 1.0)
    assert 0.0 < errors[2] < 5e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.1)


def test_cylinder():
    mesh = shapes.cylinder(0.2, 0.7)
    assert mesh.volume == pytest.approx(np.pi * 0.04 * 0.7, rel=1e-12)
    exact = 2.0 * np.pi * 0.2 * (0.2 + 0.7)
    assert mesh.area == pytest.approx(exact, rel=1e-3)
    assert np.ptp(mesh.bounds[:, 2]) == pytest.approx(0.7)


SLANT = np.hypot(0.2, 0.7)
CUT_SLANT = np.hypot(0.1, 0.7)
ROUND = {
    "tube": (
        shapes.tube(0.2, 0.15, 0.7),
        np.pi * (0.2**2 - 0.15**2) * 0.7,
        2.0 * np.pi * ((0.2 + 0.15) * 0.7 + 0.2**2 - 0.15**2),
    ),
    "cone": (
        shapes.cone(0.2, 0.7),
        np.pi * 0.2**2 * 0.7 / 3.0,
        np.pi * 0.2 * (0.2 + SLANT),
    ),
    "cut cone": (
        shapes.cone(0.2, 0.7, top_radius=0.1),
        np.pi * 0.7 / 3.0 * (0.2**2 + 0.2 * 0.1 + 0.1**2),
        np.pi * (0.2**2 + 0.1**2 + 0.3 * CUT_SLANT),
    ),
    "hemisphere": (
        shapes.hemisphere(0.2),
        2.0 / 3.0 * np.pi * 0.2**3,
        3.0 * np.pi * 0.2**2,
    ),
    "capsule": (
        shapes.capsule(0.2, 0.7),
        np.pi * 0.2**2 * 0.3 + 4.0 / 3.0 * np.pi * 0.2**3,
        2.0 * np.pi * 0.2 * 0.3 + 4.0 * np.pi * 0.2**2,
    ),
    "ball": (
        shapes.capsule(0.2, 0.4),
        4.0 / 3.0 * np.pi * 0.2**3,
        4.0 * np.pi * 0.2**2,
    ),
}


@pytest.mark.parametrize("name", ROUND)
def test_bodies_of_revolution_have_their_closed_forms(name):
    mesh, volume, area = ROUND[name]
    assert mesh.volume == pytest.approx(volume, rel=1e-12)
    assert mesh.area == pytest.approx(area, rel=2e-3)
    assert mesh.area > area * (1.0 - 1e-12)
    height = 0.2 if name == "hemisphere" else 0.4 if name == "ball" else 0.7
    assert np.ptp(mesh.bounds[:, 2]) == pytest.approx(height, rel=1e-12)
    # Vertices of a round side lie just outside the given radius.
    radius = np.hypot(*mesh.vertices[:, :2].T).max()
    assert 0.2 < radius < 0.2 * 1.003


def test_bodies_of_revolution_that_cannot_be():
    with pytest.raises(InputError, match="inner_radius=0.2 leaves no wall"):
        shapes.tube(0.2, 0.2, 1.0)
    with pytest.raises(InputError, match="height=0.3 is less than the diameter"):
        shapes.capsule(0.2, 0.3)
    with pytest.raises(InputError, match="top_radius=-1"):
        shapes.cone(0.2, 0.3, top_radius=-1)
    with pytest.raises(InputError, match="sections=2 make no cone"):
        shapes.cone(0.2, 0.3, sections=2)


def test_a_mesh_is_placed_by_a_pose():
    turned = Pose((0.0, 0.0, 1.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    placed = shapes.box((1.0, 2.0, 3.0)).placed(turned)
    assert placed.bounds == pytest.approx(np.array([[-1, -0.5, -0.5], [1, 0.5, 2.5]]))
    assert placed.volume == pytest.approx(6.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan")])
def test_bad_sizes(bad):
    with pytest.raises(InputError, match="size"):
        shapes.box(bad)
    with pytest.raises(InputError, match="radius"):
        shapes.sphere(bad)
    with pytest.raises(InputError, match="height"):
        shapes.cylinder(1.0, bad)


def test_bad_resolutions():
    with pytest.raises(InputError, match="sections=2"):
        shapes.cylinder(1.0, 1.0, sections=2)
    with pytest.raises(InputError, match="resolution=10"):
        shapes.figurine(0.3, resolution=10)


def test_figurine_is_a_hollow_closed_body():
    mesh = shapes.figurine(0.3)
    facts = describe_mesh(mesh)
    assert facts["watertight"]
    assert (facts["bodies"], facts["cavities"]) == (1, 1)
    assert 30_000 < len(mesh.faces) < 60_000
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-12)
    assert mesh.bounds[1, 2] == pytest.approx(0.3)
    assert repair_mesh(mesh).repairs == {}
    # It looks along -y: the feet and the hands are in front of its middle.
    assert -mesh.bounds[0, 1] > mesh.bounds[1, 1]


def test_figurine_is_the_same_each_time_and_scales():
    small = shapes.figurine(0.1, 60)
    large = shapes.figurine(0.2, 60)
    assert np.array_equal(small.faces, large.faces)
    assert large.vertices == pytest.approx(2.0 * small.vertices)
    assert describe_mesh(small)["watertight"]
