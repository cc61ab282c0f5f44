"""Triangles are cut until no edge is long, and stay joined along their edges."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry.mesh import edges_of
from jaxthermo.geometry.refine import cut_faces
from jaxthermo.sheets.split import SplitMesh, split_long_edges


LONGEST = 0.02


def wide_triangles_cut(vertices, faces) -> SplitMesh:
    """Cut all wide triangles in each round, with the edges of all triangles."""
    origin = np.arange(len(faces))
    while True:
        edges = edges_of(faces)
        side = edges.edge.reshape(-1, 3)
        ends = vertices[faces]
        length = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2)
        wide = np.flatnonzero(length.min(axis=1) > LONGEST)
        if not len(wide):
            return SplitMesh(vertices, faces, origin)
        preference = length[wide] * (1 + 1e-9 * (side[wide] % 997) / 997)
        cut = np.unique(side[wide, preference.argmax(axis=1)])
        middle = np.full(len(edges.uses), -1)
        middle[cut] = len(vertices) + np.arange(len(cut))
        new = (vertices[edges.low[cut]] + vertices[edges.high[cut]]) / 2
        vertices = np.concatenate([vertices, new])
        faces, origin = cut_faces(faces, middle[side], origin)


def needles() -> jt.Mesh:
    """A sphere, and a fan of narrow triangles that share edges with a wide one."""
    ball = jt.shapes.sphere(0.2, 2)
    apex = np.array([[1.0, 0.0, 0.0], [1.0, 0.5, 0.0], [1.3, 0.2, 0.1]])
    base = np.array([[1.5, 0.5 + 0.004 * n, 0.0] for n in range(6)])
    fan = [[1, 3 + n, 4 + n] for n in range(5)]
    faces = np.array([[0, 1, 2], [1, 3, 2], *fan]) + len(ball.vertices)
    vertices = np.concatenate([ball.vertices, apex, base])
    return jt.Mesh(vertices, np.concatenate([ball.faces, faces]))


@pytest.fixture(scope="module")
def mesh():
    return needles()


@pytest.mark.parametrize(
    "mesh",
    [
        jt.shapes.rectangle(4 * LONGEST, 2 * LONGEST),
        jt.shapes.box((3 * LONGEST, 3 * LONGEST, 3 * LONGEST)),
        jt.Mesh(LONGEST * np.eye(3) / 2**0.5, np.array([[0, 1, 2]])),
    ],
    ids=["whole pieces along the border", "equal edges", "edges of one piece"],
)
def test_rounding_does_not_choose_the_pieces(mesh):
    exact = split_long_edges(mesh.vertices, mesh.faces, LONGEST)
    noise = np.random.default_rng(3)
    for _ in range(10):
        rounding = 1e-17 * noise.standard_normal(mesh.vertices.shape)
        split = split_long_edges(mesh.vertices + rounding, mesh.faces, LONGEST)
        np.testing.assert_array_equal(split.faces, exact.faces)


def test_pieces_are_those_of_rounds_over_all_triangles(mesh):
    simple = wide_triangles_cut(mesh.vertices, mesh.faces)
    assert len(simple.faces) > 10 * len(mesh.faces)
    # No wide triangle is left: what remains divides edges alone.
    rest = split_long_edges(simple.vertices, simple.faces, LONGEST)
    split = split_long_edges(mesh.vertices, mesh.faces, LONGEST)
    np.testing.assert_array_equal(split.vertices, rest.vertices)
    np.testing.assert_array_equal(split.faces, rest.faces)
    np.testing.assert_array_equal(split.origin, simple.origin[rest.origin])


def test_edges_are_short_and_areas_and_borders_stay(mesh):
    split = split_long_edges(mesh.vertices, mesh.faces, LONGEST)
    ends = split.vertices[split.faces]
    length = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2)
    # An edge across a triangle joins points whose places differ by a piece at most.
    assert length.max() <= 2 * LONGEST
    assert length.min(axis=1).max() <= LONGEST
    pieces = jt.Mesh(split.vertices, split.faces)
    area = np.bincount(split.origin, np.linalg.norm(pieces.area_vectors, axis=1))
    given = np.linalg.norm(mesh.area_vectors, axis=1)
    np.testing.assert_allclose(area, given, rtol=1e-12)

    def border_pieces(vertices, faces):
        edges = edges_of(faces)
        along = vertices[edges.start] - vertices[edges.end]
        return np.linalg.norm(along[edges.border], axis=1)

    free = border_pieces(split.vertices, split.faces)
    assert free.max() <= LONGEST
    # A point on an edge that only one of its triangles had would add to the border.
    assert free.sum() == pytest.approx(
        border_pieces(mesh.vertices, mesh.faces).sum(), rel=1e-12
    )
