"""The fast voxelizer against its simple version: cells, volumes, links and areas."""

from dataclasses import replace

import numpy as np
import pytest
import simple_surface as simple
from voxel_bodies import joined

from jaxthermo.geometry import shapes
from jaxthermo.voxels.cell_areas import Patches, _pieces, areas_of_mesh
from jaxthermo.voxels.crossings import _exposed_faces, find_crossings
from jaxthermo.voxels.cut_geometry import _ALONG, cut_voxels
from jaxthermo.voxels.cut_links import _MIN_OPEN, _SMOOTH, cut_links
from jaxthermo.voxels.cut_voxels import MIN_OPEN
from jaxthermo.voxels.fill import fill_by_vote
from jaxthermo.voxels.lattice import Lattice, peel_axes, pixel_axes
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
    found, _ = find_crossings(views, solid, mesh)
    kept = np.flatnonzero(~found.lost)
    number = np.ravel_multi_index(tuple(found.voxel[kept].T), solid.shape)
    return found.cells(kept[np.argsort(number, kind="stable")]), solid


def test_faces_are_those_of_all_rays(body):
    _, solid = body
    for axis in range(3):
        own = _exposed_faces(solid, axis)
        every = simple.exposed_faces(solid, axis, *pixel_axes(axis))
        for fast, slow in zip(own, every, strict=True):
            np.testing.assert_array_equal(fast, slow)


def test_volumes_sections_and_cells_are_those_of_all_sides(body, monkeypatch):
    cells, solid = body
    flat = np.ravel_multi_index(tuple(cells.voxel.T), solid.shape)
    key, owner = np.unique(flat, return_inverse=True)
    sides = simple.dense_sides(cells, owner, len(key))
    _, excess, normal = sides
    weight = excess * np.square(np.einsum("maia->mai", normal))
    volume = simple.volumes(weight, normal)
    own = np.square(cells.normal[np.arange(len(owner)), cells.axis])
    volume += np.bincount(owner, np.where(cells.on_face, 0, cells.excess * own))
    section = simple.sections(weight, normal, _ALONG)
    kept = {}
    take = lambda voxel, section, sides, solid: (
        kept.update(section=section, links=cut_links(voxel, section, sides, solid))
        or kept["links"]
    )
    monkeypatch.setattr("jaxthermo.voxels.cut_geometry.cut_links", take)
    monkeypatch.setattr("jaxthermo.voxels.cut_geometry.limited", lambda cut, _: cut)
    cut, found = cut_voxels(cells, solid)
    assert kept["section"] == pytest.approx(section, abs=1e-14)
    changed = np.abs(np.column_stack([volume, section]) - 1).max(axis=1) > 1e-12
    voxel = np.stack(np.unravel_index(key, solid.shape), axis=1)
    np.testing.assert_array_equal(cut.voxel, voxel[changed])
    assert cut.volume == pytest.approx(volume[changed], abs=1e-14)
    factor, shift = simple.cell_shapes(cells, owner, weight, normal)
    assert found.factor == pytest.approx(np.maximum(factor, MIN_OPEN), abs=1e-14)
    assert found.shift == pytest.approx(shift, abs=1e-14)
    every = simple.links(voxel, section, sides, solid, _MIN_OPEN, _SMOOTH)
    links = kept["links"]
    first, second = links.voxel.tolist(), (links.voxel + links.step).tolist()
    ends = [(tuple(p), tuple(q)) for p, q in zip(first, second, strict=True)]
    assert ends == sorted(every)
    assert links.extra == pytest.approx([every[e] for e in ends], abs=1e-14)


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
