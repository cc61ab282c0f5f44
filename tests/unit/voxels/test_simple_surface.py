"""The fast voxelizer against its simple version: cells, volumes, links and areas."""

from dataclasses import replace

import numpy as np
import pytest
import simple_surface as simple
from voxel_bodies import dense_volumes, joined, without

from jaxthermo.geometry import shapes
from jaxthermo.voxels.cell_areas import Patches, _pieces, areas_of_mesh
from jaxthermo.voxels.crossings import Cells, _exposed_faces, find_crossings
from jaxthermo.voxels.cut_geometry import _ALONG, cut_voxels, sides_of, surface_shapes
from jaxthermo.voxels.cut_links import _MIN_OPEN, _SMOOTH, cut_links
from jaxthermo.voxels.cut_voxels import _MIN_STEP, _ROUNDS, MIN_OPEN, limited
from jaxthermo.voxels.fill import fill_by_vote
from jaxthermo.voxels.lattice import Lattice, peel_axes, pixel_axes
from jaxthermo.voxels.surface import attach_to_solid, face_axes
from jaxthermo.voxels.voxel_bits import VoxelBits
from jaxthermo.voxels.voxelize import voxelize


def slanted(mesh):
    """A mesh turned about all axes, so that no face is along the lattice."""
    turn, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    return replace(mesh, vertices=mesh.vertices @ turn.T)


def sheets():
    """A block, a sheet and a gap thinner than a voxel: cells of no face."""
    sheet = shapes.box((8.0, 6.0, 0.4)).moved((7.5, 0.0, 0.5))
    return joined(shapes.box((6.0, 6.0, 6.0)), sheet)


BODIES = {
    "ball": (shapes.sphere(1.0, subdivisions=3), 1 / 5.3),
    "slanted box": (slanted(shapes.box((1.0, 0.7, 0.4))), 0.083),
    "cone": (slanted(shapes.cone(1.0, 2.0)), 0.23),
    "sheets": (sheets(), 1.0),
}


@pytest.fixture(scope="module", params=BODIES)
def body(request):
    mesh, pitch = BODIES[request.param]
    lattice = Lattice.around(mesh, pitch)
    views = peel_axes(mesh, lattice)
    solid = fill_by_vote(views, lattice.shape)
    normals, _ = face_axes(mesh)
    crossings, _ = find_crossings(
        views, solid=solid, normals=normals, is_closed=mesh.is_watertight
    )
    attached = np.flatnonzero(~crossings.lost)
    attached = attached[np.argsort(crossings.number[attached], kind="stable")]
    shared = {name: getattr(crossings, name)[attached] for name in Cells._fields[1:]}
    return Cells(crossings.normals(normals, attached), **shared), solid


def overlapping():
    """Two balls in each other, one of them with a hole, and a wall across them."""
    ball = shapes.sphere(1.0, subdivisions=3)
    wall = slanted(shapes.box((1.5, 0.1, 2.5)))
    torn = without(ball.moved((0.6, 0.3, 0.2)), np.arange(len(ball.faces)) % 97 == 5)
    return joined(ball, torn, wall)


@pytest.mark.parametrize(
    ("mesh", "pitch"),
    [(slanted(shapes.box((1.0, 2.0, 4.0))), 0.033), (overlapping(), 0.03)],
    ids=["rows of several words", "overlaps and holes"],
)
def test_solid_voxels_are_those_of_all_winding_numbers(mesh, pitch):
    lattice = Lattice.around(mesh, pitch)
    views = peel_axes(mesh, lattice)
    solid = fill_by_vote(views, lattice.shape)
    assert lattice.shape[2] > 64
    np.testing.assert_array_equal(solid, simple.solid_by_vote(views, lattice.shape))


def test_the_nearest_solid_voxel_is_that_of_all_around():
    random = np.random.default_rng(2)
    solid = random.random((9, 8, 7)) > 0.96
    position = random.uniform(0, 1, (300, 3)) * solid.shape
    cell = np.floor(position).astype(int)
    voxels, lost = attach_to_solid(solid, position, cell)
    start_points = zip(position, cell, strict=True)
    nearest = [
        simple.nearest_solid(solid, *start_point) for start_point in start_points
    ]
    inside = solid[tuple(cell.T)]
    np.testing.assert_array_equal(lost, [v is None for v in nearest])
    assert 0 < lost.sum() < 200 and 0 < inside.sum() < 100
    for voxel, near, is_inside, start in zip(
        voxels, nearest, inside, cell, strict=True
    ):
        expected = start if is_inside or near is None else near
        np.testing.assert_array_equal(voxel, expected)


def test_faces_are_those_of_all_rays(body):
    _, solid = body
    for axis in range(3):
        faces = _exposed_faces(VoxelBits.of(solid), axis)
        expected_faces = simple.exposed_faces(solid, axis, *pixel_axes(axis))
        for fast, slow in zip(faces, expected_faces, strict=True):
            np.testing.assert_array_equal(fast, slow)


def test_volumes_sections_and_cells_are_those_of_all_sides(body):
    cells, solid = body
    key, owner = np.unique(cells.number, return_inverse=True)
    sides = simple.dense_sides(cells, owner, len(key))
    _, excess, normal = sides
    weight = excess * np.square(np.einsum("maia->mai", normal))
    volume = simple.volumes(weight, normal)
    squared = np.square(cells.normal[np.arange(len(owner)), cells.axis])
    volume += np.bincount(owner, np.where(cells.on_face, 0, cells.excess * squared))
    section = simple.sections(weight, normal, _ALONG)
    voxel_shapes, of_cells = surface_shapes(cells)
    np.testing.assert_array_equal(voxel_shapes.number, key)
    assert voxel_shapes.section == pytest.approx(section, abs=1e-14)
    assert voxel_shapes.volume == pytest.approx(volume, abs=1e-14)
    factor, shift = simple.cell_shapes(cells, owner, weight, normal)
    assert of_cells.factor == pytest.approx(np.maximum(factor, MIN_OPEN), abs=1e-14)
    assert of_cells.shift == pytest.approx(shift, abs=1e-14)
    voxel = VoxelBits.of(solid).voxels(key)
    expected_links = simple.links(voxel, section, sides, solid, _MIN_OPEN, _SMOOTH)
    links = cut_links(
        voxel_shapes.number,
        section=voxel_shapes.section,
        sides=sides_of(cells),
        solid=solid,
    )
    first = links.voxel.tolist()
    second = (links.voxel + links.step).tolist()
    ends = [(tuple(p), tuple(q)) for p, q in zip(first, second, strict=True)]
    assert ends == sorted(expected_links)
    assert links.extra == pytest.approx([expected_links[e] for e in ends], abs=1e-14)
    cut = cut_voxels(voxel_shapes, links, solid.shape)
    changed = np.abs(np.column_stack([volume, section]) - 1).max(axis=1) > 1e-12
    np.testing.assert_array_equal(cut.voxel, voxel[changed])
    # Every fourth one so small that it has to take from its neighbours.
    cut.volume[::4] *= 0.3
    volumes = dense_volumes(limited(cut, solid), solid.shape)
    expected = simple.limited(
        dense_volumes(cut, solid.shape),
        solid=solid,
        links=links,
        step=_MIN_STEP,
        least_of_all=MIN_OPEN,
        rounds=_ROUNDS,
    )
    assert expected[solid].min() >= MIN_OPEN
    assert volumes[solid] == pytest.approx(expected[solid], abs=1e-9)


def test_areas_are_those_of_all_hat_functions():
    mesh = slanted(shapes.box((24.0, 15.0, 9.0))).moved((18.0, 18.0, 18.0))
    grid = voxelize(mesh, 1.0, "dominant_axis")
    position = grid.fragment_position
    normal = grid.fragment_normal
    area = np.abs(normal).max(axis=1)
    cells = Patches(position[None], normal, area)
    areas = areas_of_mesh(cells, mesh.triangles, (36, 36, 36))
    pieces = list(_pieces(mesh.triangles, at_once=500))
    slow = simple.areas_of_mesh(area, position, normal, pieces, spacing=4)
    assert areas == pytest.approx(slow, rel=1e-12)
