"""Stiff nodes: steady heat flows and areas stay, and steps become longer."""

import numpy as np
import pytest
from scipy.sparse import coo_array

from jaxthermo.sheets.coarse import SheetLinks
from jaxthermo.sheets.stiff_nodes import without_stiff_nodes


def links_of(rows):
    src, dst, part, weight = zip(*rows, strict=True)
    return SheetLinks(
        src=np.array(src),
        dst=np.array(dst),
        part=np.array(part),
        weight=np.array(weight, float),
    )


def laplacian(links, count):
    matrix = coo_array((links.weight, (links.src, links.dst)), (count, count)).toarray()
    matrix = matrix + matrix.T
    return np.diag(matrix.sum(axis=1)) - matrix


def test_two_nodes_at_one_place_become_one():
    links = links_of([(0, 1, 0, 1.0), (1, 2, 0, 1e6), (2, 3, 0, 1.0)])
    loose = without_stiff_nodes(links, np.array([1.0, 0.5, 0.4, 1.0]), pitch=1.0)
    assert loose.earlier.tolist() == [0, 1, 3]
    assert loose.node.tolist() == [0, 1, 1, 2]
    # In series with the conductance of 1e6.
    np.testing.assert_allclose(loose.links.weight, [1, 1 / (1 + 1e-6)], rtol=1e-12)
    assert (loose.links.src.tolist(), loose.links.dst.tolist()) == ([0, 1], [1, 2])


def test_steady_flows_between_the_remaining_nodes_do_not_change():
    rng = np.random.default_rng(0)
    count = 40
    pairs = [(i, j) for i in range(count) for j in range(i) if rng.uniform() < 0.2]
    links = links_of([(j, i, 0, rng.uniform(0.5, 2)) for i, j in sorted(pairs)])
    area = np.where(np.arange(count) % 4 == 1, 1e-3, 1.0)
    loose = without_stiff_nodes(links, area, pitch=1.0)
    assert loose.earlier.tolist() == np.flatnonzero(area == 1).tolist()
    new_area = np.bincount(loose.node, area)
    assert new_area.sum() == pytest.approx(area.sum(), rel=1e-14)
    full = laplacian(links, count)
    stay = loose.earlier
    gone = np.setdiff1d(np.arange(count), stay)
    rest = np.linalg.solve(full[np.ix_(gone, gone)], full[np.ix_(gone, stay)])
    schur = full[np.ix_(stay, stay)] - full[np.ix_(stay, gone)] @ rest
    matrix = laplacian(loose.links, len(stay))
    np.testing.assert_allclose(matrix, schur, atol=1e-12)
    assert (new_area / np.diag(matrix) >= 1 / 64).all()


def test_a_stiff_node_between_two_parts_stays():
    links = links_of([(0, 1, 0, 1e6), (1, 2, 1, 1e6)])
    loose = without_stiff_nodes(links, np.array([9e6, 1.0, 9e6]), pitch=1.0)
    assert loose.node.tolist() == [0, 1, 2]
    assert all(map(np.array_equal, loose.links, links))


def test_sheets_of_one_node_have_no_links():
    loose = without_stiff_nodes(
        links_of([(0, 1, 0, 1.0)])._replace(
            src=np.zeros(0, int),
            dst=np.zeros(0, int),
            part=np.zeros(0, int),
            weight=np.zeros(0),
        ),
        np.ones(2),
        pitch=1.0,
    )
    assert loose.node.tolist() == [0, 1]
    assert len(loose.links.weight) == 0
