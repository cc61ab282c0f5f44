"""Conductances of triangles: borders are cut a few times, and feet store no heat."""

import numpy as np
import pytest

from jaxthermo.sheets.tufted import (
    triangle_weights,
    vertex_laplacian,
    with_cut_borders,
)


# A triangle that lies on its reverse, and one or two more at an edge of them [mm].
_FOLDED = {
    "one neighbour": (
        [[0, 1, 2], [0, 2, 1], [0, 3, 1]],
        [[12.9, 57.4, 0.0], [3.3, 13.4, 26.6], [0.0, 0.0, 11.4], [12.5, 59.2, 18.9]],
    ),
    "two neighbours": (
        [[0, 1, 2], [0, 2, 1], [0, 3, 2], [2, 3, 4]],
        [
            [60.8, 19.0, 0.0],
            [0.0, 41.1, 4.7],
            [20.1, 34.4, 18.1],
            [80.3, 0.0, 12.9],
            [58.4, 22.3, 20.2],
        ],
    ),
}


@pytest.mark.parametrize("name", _FOLDED)
def test_borders_of_folded_triangles_are_cut_a_few_times(name):
    faces = np.array(_FOLDED[name][0])
    vertices = np.array(_FOLDED[name][1]) / 1e3
    part = np.zeros(len(faces), int)
    cut = with_cut_borders(vertices, faces=faces, part=part)
    assert len(cut.faces) <= 20 * len(faces)
    edges = cut.vertices[cut.faces] - np.roll(cut.vertices[cut.faces], 1, axis=1)
    # No foot is at a place of another one.
    assert np.linalg.norm(edges, axis=2).min() > 1e-7


@pytest.mark.parametrize("name", _FOLDED)
def test_conductances_are_those_of_the_schur_complement(name):
    faces = np.array(_FOLDED[name][0])
    vertices = np.array(_FOLDED[name][1]) / 1e3
    count = len(vertices)
    pairs = triangle_weights(vertices, faces)
    conductance = np.zeros((count, count))
    conductance[pairs.src, pairs.dst] = pairs.weight
    part = np.zeros(len(faces), int)
    cut = with_cut_borders(vertices, faces=faces, part=part)
    laplacian = vertex_laplacian(cut.vertices, cut.faces).toarray()
    coupling = laplacian[:count, count:]
    of_feet = laplacian[count:, count:]
    schur = laplacian[:count, :count] - coupling @ np.linalg.solve(of_feet, coupling.T)
    np.testing.assert_allclose(conductance, -np.triu(schur, k=1), atol=1e-10)
