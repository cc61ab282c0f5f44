"""Refined triangles: the same surface, short edges, and no gaps."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry.refine import refine_edges


def edges(faces):
    pairs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    return np.sort(pairs, axis=1)


def area_vectors(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


@pytest.mark.parametrize("longest", [0.5, 0.03, 0.011])
def test_every_edge_is_short_and_has_two_faces(longest):
    mesh = jt.shapes.box((0.1, 0.02, 0.05))
    vertices, faces, parent = refine_edges(mesh.vertices, mesh.faces, longest)
    pairs, count = np.unique(edges(faces), axis=0, return_counts=True)
    assert (count == 2).all()
    length = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    assert length.max() <= longest
    if longest == 0.5:
        np.testing.assert_array_equal(faces, mesh.faces)
    # Each piece lies in its face, with its direction, and together they cover it.
    small = area_vectors(vertices, faces)
    large = area_vectors(mesh.vertices, mesh.faces)
    for axis in range(3):
        summed = np.bincount(parent, small[:, axis], len(large))
        np.testing.assert_allclose(summed, large[:, axis], atol=1e-15)
    assert (np.einsum("fi,fi->f", small, large[parent]) > 0).all()


def test_other_columns_are_interpolated():
    mesh = jt.shapes.box((0.1, 0.02, 0.05))
    slope = np.array([[3.0], [-2.0], [1.0]])
    columns = np.concatenate([mesh.vertices, mesh.vertices @ slope], axis=1)
    refined = refine_edges(columns, mesh.faces, 0.01).vertices
    np.testing.assert_allclose(refined[:, 3:], refined[:, :3] @ slope, atol=1e-14)
