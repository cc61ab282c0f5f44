"""Labels that users bring: what is taken, what is ignored and what is refused."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_volumes import assert_links, ball, solids

from jaxthermo.errors import InputError
from jaxthermo.structures.kinds.aggregate import Aggregate
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import Partition
from tests.bodies import blocks


BALL = ball(4.6)
GRID = blocks(BALL, 0.5)


def by_octant(shape):
    x, y, z = (np.arange(n) * 2 // n for n in shape)
    return x[:, None, None] * 4 + y[:, None] * 2 + z


@settings(deadline=None, max_examples=40)
@given(solids(5), st.randoms(use_true_random=False))
def test_volume_is_kept_whatever_the_labels(solid, random):
    labels = np.array([random.randrange(9) for _ in range(solid.size)])
    structure = Partition(blocks(solid, 0.5), labels.reshape(solid.shape))
    assert structure.capacity_ratio == pytest.approx(1, rel=1e-13)
    assert structure.node_count == len(np.unique(labels.reshape(solid.shape)[solid]))
    assert (structure.nodes().level == 0).all()


def test_names_of_labels_do_not_matter():
    labels = by_octant(BALL.shape)
    plain = Partition(GRID, labels)
    names = np.array([17, 5, 2**62, 0, 10**9, 3, 99, 1])
    renamed = Partition(GRID, names[labels])
    assert_links(plain, renamed)
    np.testing.assert_array_equal(plain.fragment_node(), renamed.fragment_node())


@pytest.mark.parametrize("dtype", [np.int8, np.uint16, np.int32, np.uint64])
def test_any_integers_do(dtype):
    structure = Partition(GRID, by_octant(BALL.shape).astype(dtype))
    assert structure.node_count == 8
    assert structure.fragment_node().dtype == np.int32


def test_lists_and_device_arrays_do():
    labels = by_octant(BALL.shape)
    assert Partition(GRID, labels.tolist()).node_count == 8
    assert Partition(GRID, jax.numpy.asarray(labels)).node_count == 8


def test_labels_on_empty_voxels_are_ignored():
    labels = by_octant(BALL.shape)
    labels[~BALL] = 1234
    assert Partition(GRID, labels).node_count == 8


def test_one_label_is_one_node_even_in_two_places():
    solid = np.ones((5, 1, 1), bool)
    structure = Partition(blocks(solid), np.array([7, 7, 3, 7, 7]).reshape(5, 1, 1))
    np.testing.assert_array_equal(structure.nodes().volume, [4, 1])
    assert structure.link_count == 1


def test_labels_of_blocks_give_the_aggregate():
    """No block of this body has two parts."""
    solid = np.ones((9, 7, 8), bool)
    block = np.indices(solid.shape) // 4
    labels = block[0] * 100 + block[1] * 10 + block[2]
    grid = blocks(solid, 0.5)
    partition = Partition(grid, labels)
    aggregate = Aggregate(grid, 4, alignment=0.0)
    assert_links(partition, aggregate)


def test_a_label_a_voxel_is_the_full_volume():
    structure = Partition(GRID, np.arange(BALL.size).reshape(BALL.shape)[::-1])
    full = FullVolume(GRID)
    assert_links(structure, full)


def test_voxels_without_a_label_are_hollow():
    labels = np.zeros(BALL.shape, int)
    labels[5:7, 5:7, 5:7] = -1
    structure = Partition(GRID, labels)
    labelled_count = np.count_nonzero(BALL & (labels >= 0))
    assert structure.capacity_ratio == pytest.approx(labelled_count / BALL.sum())


@pytest.mark.parametrize(
    "labels, message",
    [
        (np.zeros(BALL.shape), "float64 values cannot name nodes: give integers"),
        (BALL, "bool values"),
        (None, "object values"),
        ([[1], [1, 2]], "give an array of integers"),
        (np.zeros(BALL.shape[:2], int), r"shape \(12, 12\) is not .*\(12, 12, 13\)"),
        (np.full(BALL.shape, -1), "no solid voxel has a label"),
        (np.full(BALL.shape, 2**63, np.uint64), "below 2"),
        (np.where(np.indices(BALL.shape)[2] < 4, -5, 1), "without a node, .* at"),
    ],
)
def test_labels_that_do_not_fit_are_refused(labels, message):
    with pytest.raises(InputError, match=message) as error:
        Partition(GRID, labels)
    assert "\n" not in str(error.value)
