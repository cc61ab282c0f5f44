"""The fast voxelizer against its simple version: cells, volumes, links and areas."""

from dataclasses import replace

import numpy as np
import pytest
import simple_surface as simple
from voxel_bodies import joined, without

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
    found, _ = find_crossings(views, solid, normals, mesh.is_watertight)
    kept = np.flatnonzero(~found.lost)
    kept = kept[np.argsort(found.number[kept], kind="stable")]
    shared = {name: getattr(found, name)[kept] for name in Cells._fields[1:]}
    return Cells(found.normals(normals, kept), **shared), solid


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
    found = fill_by_vote(views, lattice.shape)
    assert lattice.shape[2] > 64
    np.testing.assert_array_equal(found, simple.solid_by_vote(views, lattice.shape))


def test_the_nearest_solid_voxel_is_that_of_all_around():
    random = np.random.default_rng(2)
    solid = random.random((9, 8, 7)) > 0.96
    position = random.uniform(0, 1, (300, 3)) * solid.shape
    cell = np.floor(position).astype(int)
    found, lost = attach_to_solid(solid, position, cell)
    own = zip(position, cell, strict=True)
    every = [simple.nearest_solid(solid, *each) for each in own]
    inside = solid[tuple(cell.T)]
    np.testing.assert_array_equal(lost, [v is None for v in every])
    assert 0 < lost.sum() < 200 and 0 < inside.sum() < 100
    for own, near, is_inside, start in zip(found, every, inside, cell, strict=True):
        expected = start if is_inside or near is None else near
        np.testing.assert_array_equal(own, expected)


def test_faces_are_those_of_all_rays(body):
    _, solid = body
    for axis in range(3):
        own = _exposed_faces(VoxelBits.of(solid), axis)
        every = simple.exposed_faces(solid, axis, *pixel_axes(axis))
        for fast, slow in zip(own, every, strict=True):
            np.testing.assert_array_equal(fast, slow)


def test_volumes_sections_and_cells_are_those_of_all_sides(body):
    cells, solid = body
    key, owner = np.unique(cells.number, return_inverse=True)
    sides = simple.dense_sides(cells, owner, len(key))
    _, excess, normal = sides
    weight = excess * np.square(np.einsum("maia->mai", normal))
    volume = simple.volumes(weight, normal)
    own = np.square(cells.normal[np.arange(len(owner)), cells.axis])
    volume += np.bincount(owner, np.where(cells.on_face, 0, cells.excess * own))
    section = simple.sections(weight, normal, _ALONG)
    found, of_cells = surface_shapes(cells)
    np.testing.assert_array_equal(found.number, key)
    assert found.section == pytest.approx(section, abs=1e-14)
    assert found.volume == pytest.approx(volume, abs=1e-14)
    factor, shift = simple.cell_shapes(cells, owner, weight, normal)
    assert of_cells.factor == pytest.approx(np.maximum(factor, MIN_OPEN), abs=1e-14)
    assert of_cells.shift == pytest.approx(shift, abs=1e-14)
    voxel = VoxelBits.of(solid).voxels(key)
    every = simple.links(voxel, section, sides, solid, _MIN_OPEN, _SMOOTH)
    links = cut_links(found.number, found.section, sides_of(cells), solid)
    first, second = links.voxel.tolist(), (links.voxel + links.step).tolist()
    ends = [(tuple(p), tuple(q)) for p, q in zip(first, second, strict=True)]
    assert ends == sorted(every)
    assert links.extra == pytest.approx([every[e] for e in ends], abs=1e-14)
    cut = cut_voxels(found, links, solid.shape)
    changed = np.abs(np.column_stack([volume, section]) - 1).max(axis=1) > 1e-12
    np.testing.assert_array_equal(cut.voxel, voxel[changed])
    # Every fourth one so small that it has to take from its neighbours.
    cut.volume[::4] *= 0.3
    own = limited(cut, solid).volumes(solid.shape)
    given = cut.volumes(solid.shape), solid, links, _MIN_STEP, MIN_OPEN, _ROUNDS
    expected = simple.limited(*given)
    assert expected[solid].min() >= MIN_OPEN
    assert own[solid] == pytest.approx(expected[solid], abs=1e-9)


def test_areas_are_those_of_all_hat_functions():
    mesh = slanted(shapes.box((24.0, 15.0, 9.0))).moved((18.0, 18.0, 18.0))
    grid = voxelize(mesh, 1.0, "dominant_axis")
    position, normal = grid.fragment_position, grid.fragment_normal
    area = np.abs(normal).max(axis=1)
    cells = Patches(position[None], normal, area)
    found = areas_of_mesh(cells, mesh.triangles, (36, 36, 36))
    pieces = list(_pieces(mesh.triangles, at_once=500))
    slow = simple.areas_of_mesh(area, position, normal, pieces, spacing=4)
    assert found == pytest.approx(slow, rel=1e-12)
