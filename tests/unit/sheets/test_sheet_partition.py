"""Vertices of a sheet go to the nearest node that a neighbour belongs to."""

import numpy as np

from jaxthermo.geometry.mesh import edges_of
from jaxthermo.sheets.partition import _SWEEPS, _nearest
from jaxthermo.sheets.split import split_long_edges
from jaxthermo.sheets.surface import Surface
from tests.sheets import rotation, turned, uneven_strip


def surface_of(mesh, longest):
    vertices, faces, piece = split_long_edges(mesh.vertices, mesh.faces, longest)
    return Surface(
        vertices=vertices,
        faces=faces,
        area=np.ones(len(faces)),
        origin=piece,
        part=np.zeros(len(faces), int),
        normal=np.tile(rotation(0)[2], (len(faces), 1)),
    )


def swept(surface, node, position):
    """All vertices look at all of their neighbours, again and again."""
    for _ in range(_SWEEPS):
        before = node.copy()
        for vertex in range(len(node)):
            offers = before[surface.edges_from(np.array([vertex]))[1]]
            gaps = np.linalg.norm(position[offers] - surface.vertices[vertex], axis=1)
            present = position[before[vertex]] - surface.vertices[vertex]
            if gaps.min() < (1 - 1e-9) * np.linalg.norm(present):
                node[vertex] = offers[gaps.argmin()]
    return node


def test_sweeps_over_what_has_moved_are_sweeps_over_all():
    surface = surface_of(turned(uneven_strip(1.0, 0.5), rotation(0)), 0.06)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(surface.vertices), 20, replace=False)
    # Off the vertices, so that none is as far from two nodes.
    position = surface.vertices[chosen] + rng.normal(size=(20, 3)) * 1e-3
    start = rng.integers(0, 20, len(surface.vertices))
    expected = swept(surface, start.copy(), position)
    np.testing.assert_array_equal(_nearest(surface, start, position), expected)
    # From a few seeds in one node.
    seeds = chosen[1:4]
    start = np.zeros_like(start)
    start[seeds] = [1, 2, 3]
    expected = swept(surface, start.copy(), position)
    grown = _nearest(surface, start, position)
    np.testing.assert_array_equal(grown, expected)
    assert np.bincount(grown)[1:].min() > 10


def test_neighbours_are_those_of_the_edges():
    surface = surface_of(uneven_strip(1.0, 0.5), 0.1)
    ends = np.stack([surface.edges.start, surface.edges.end], axis=1)
    both = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    np.testing.assert_array_equal(surface.neighbours, both)
    np.testing.assert_array_equal(
        surface.joined_vertices, both[both[:, 0] < both[:, 1]]
    )
    start, end = surface.edges_from(np.array([7, 3]))
    assert set(start.tolist()) == {3, 7}
    expected = [both[both[:, 0] == vertex, 1] for vertex in (7, 3)]
    np.testing.assert_array_equal(end, np.concatenate(expected))


def test_cut_borders_have_short_edges_and_no_gaps():
    mesh = uneven_strip(1.0, 0.5)
    for longest in (0.3, 0.05):
        cut = split_long_edges(mesh.vertices, mesh.faces, longest)
        edges = edges_of(cut.faces)
        along = cut.vertices[edges.end] - cut.vertices[edges.start]
        corners = cut.vertices[cut.faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.bincount(cut.origin, np.linalg.norm(area, axis=1) / 2)
        np.testing.assert_allclose(areas, np.linalg.norm(mesh.area_vectors, axis=1))
        # The border is as long as before: no edge has a vertex of one side alone.
        border = np.linalg.norm(along[edges.uses[edges.edge] == 1], axis=1)
        assert border.max() <= (1 + 1e-9) * longest
        assert np.isclose(border.sum(), 3.0, rtol=1e-12)
