"""Vertices of a sheet go to the nearest node that a neighbour belongs to."""

from itertools import combinations

import numpy as np

from jaxthermo.geometry.mesh import edges_of
from jaxthermo.geometry.vectors import triangle_normals
from jaxthermo.sheets.partition import _SWEEPS, _TINY, _nearest, _without_small
from jaxthermo.sheets.rings import _triples
from jaxthermo.sheets.split import _Chain, _zipped, split_long_edges
from jaxthermo.sheets.surface import Surface
from tests.sheets import grid_plate, rotation, turned, uneven_strip


def surface_of(mesh, longest):
    vertices, faces, piece = split_long_edges(mesh.vertices, mesh.faces, longest)
    return Surface(
        vertices=vertices,
        faces=faces,
        area=np.linalg.norm(triangle_normals(vertices[faces]), axis=1) / 2,
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


def test_flat_nodes_between_two_others_join_one():
    """Their two triangles would lie on each other; at the border they have others."""
    plate = grid_plate(np.arange(13.0), np.arange(13.0))
    surface = surface_of(plate, 2.0)
    x, y, _ = plate.vertices.T
    halves = (x > 6).astype(int)
    inside = np.where((abs(x - 6) < 2) & (abs(y - 6) < 2), 2, halves)
    joined = np.where(inside == 2, 0, halves)
    np.testing.assert_array_equal(_without_small(surface, inside, _TINY), joined)
    at_border = np.where((abs(x - 6) < 2) & (y < 3), 2, halves)
    np.testing.assert_array_equal(_without_small(surface, at_border, _TINY), at_border)


def test_neighbours_are_those_of_the_edges():
    surface = surface_of(uneven_strip(1.0, 0.5), 0.1)
    ends = np.stack([surface.edges.start, surface.edges.end], axis=1)
    both = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    np.testing.assert_array_equal(
        surface.joined_vertices, both[both[:, 0] < both[:, 1]]
    )
    start, end = surface.edges_from(np.array([7, 3]))
    assert set(start.tolist()) == {3, 7}
    expected = [both[both[:, 0] == vertex, 1] for vertex in (7, 3)]
    np.testing.assert_array_equal(end, np.concatenate(expected))
    label = np.arange(len(surface.vertices)) % 3
    start, end = surface.edges_across(label)
    # Sorted by their starts, those of one start in their order.
    order = np.argsort(start, kind="stable")
    across = both[label[both[:, 0]] != label[both[:, 1]]]
    np.testing.assert_array_equal(np.stack([start, end], axis=1)[order], across)


def merged(first, second):
    """Steps of two edges one by one, by where they end; those at the corner first."""
    ends = [(0.0 if i == 0 else (i + 1) / first, 0, i) for i in range(first)]
    ends += [(0.0 if j == 0 else (j + 1) / second, 1, j) for j in range(second)]
    i = j = 0
    rows = []
    for _, edge, _ in sorted(ends):
        if edge == 0 and i > 0:
            rows.append([i, i + 1, 100 + j])
        elif edge == 1:
            rows.append([i, 101 + j, 100 + j])
        i += edge == 0
        j += edge == 1
    return rows


def test_triangles_between_two_edges_are_those_of_their_merged_steps():
    pieces = np.array([[i, j] for i in range(1, 13) for j in range(1, 13)])
    count = len(pieces)
    chains = [
        _Chain(
            # The corner at both starts has a number for each edge.
            start=np.full(count, first_point - 1),
            end=first_point - 1 + number,
            pieces=number,
            first_point=np.full(count, first_point),
        )
        for first_point, number in zip((1, 101), pieces.T, strict=True)
    ]
    corners, triangle = _zipped(*chains)
    for face, (first, second) in enumerate(pieces):
        assert corners[triangle == face].tolist() == merged(first, second)


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


def test_triples_are_those_of_three_pairs():
    count = 12
    every = np.array(list(combinations(range(count), 2)))
    pairs = every[np.random.default_rng(3).random(len(every)) < 0.5]
    known = set(map(tuple, pairs.tolist()))
    expected = [
        triple
        for triple in combinations(range(count), 3)
        if set(combinations(triple, 2)) <= known
    ]
    assert len(expected) > 10
    assert _triples(pairs, count).tolist() == [list(triple) for triple in expected]
    assert _triples(pairs[:0], count).shape == (0, 3)
