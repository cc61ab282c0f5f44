"""The edge table and the connected parts of triangles against slow searches."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxthermo.geometry.mesh import connected_labels, edges_of
from jaxthermo.geometry.vectors import row_length


def test_the_edge_table_is_that_of_a_search_edge_by_edge():
    faces = np.random.default_rng(0).integers(0, 9, (30, 3))
    edges = edges_of(faces)
    sides = [
        tuple(sorted((int(face[i]), int(face[(i + 1) % 3]))))
        for face in faces
        for i in range(3)
    ]
    names = sorted(set(sides))
    users = [[h for h, side in enumerate(sides) if side == name] for name in names]
    assert [names[number] for number in edges.edge] == sides
    assert edges.uses.tolist() == [len(halves) for halves in users]
    assert list(zip(edges.low, edges.high, strict=True)) == names
    assert edges.first.tolist() == [halves[0] for halves in users]
    assert edges.order.tolist() == sum(users, [])
    assert edges.pairs.tolist() == [halves for halves in users if len(halves) == 2]
    lone = sorted(halves[0] for halves in users if len(halves) == 1)
    assert edges.border.tolist() == lone
    ways = [[np.sign(edges.end[h] - edges.start[h]) for h in half] for half in users]
    # An edge from a vertex to itself counts as one downward.
    balance = [sum(1 if way > 0 else -1 for way in of_edge) for of_edge in ways]
    assert edges.balance.tolist() == balance
    asked = np.array([[i, j] for i in range(10) for j in range(10)])
    expected = [tuple(sorted(pair)) in names for pair in asked.tolist()]
    assert edges.joins(asked).tolist() == expected


def test_lengths_of_rows_have_the_bits_of_numpy():
    rows = np.random.default_rng(0).normal(size=(1000, 3))
    np.testing.assert_array_equal(row_length(rows), np.linalg.norm(rows, axis=1))


@pytest.mark.parametrize("links", [0, 30, 99, 300])
def test_parts_are_labelled_with_their_lowest_node(links):
    rng = np.random.default_rng(links)
    pairs = rng.integers(0, 100, (links, 2))
    if links == 99:
        # A chain in any order, which takes more than one round.
        order = rng.permutation(100)
        pairs = np.stack([order[:-1], order[1:]], axis=1)
    graph = coo_array((np.ones(links), tuple(pairs.T)), shape=(100, 100))
    _, part = connected_components(graph, directed=False)
    lowest = [np.flatnonzero(part == number)[0] for number in part]
    np.testing.assert_array_equal(connected_labels(100, pairs), lowest)
