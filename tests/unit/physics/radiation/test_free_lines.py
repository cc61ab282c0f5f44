"""Lines of sight past several occluders."""

import numpy as np
import pytest

from jaxthermo.physics.radiation.free_lines import _in_all


@pytest.mark.parametrize("count", [2, 5])
def test_a_line_is_free_that_no_occluder_blocks(count):
    random = np.random.default_rng(count)
    sights = tuple(random.integers(0, 256, (count, 3, 40), np.uint8))
    before = [sight.copy() for sight in sights]
    expected = np.bitwise_and.reduce(sights)
    np.testing.assert_array_equal(_in_all(sights), expected)
    np.testing.assert_array_equal(sights, before)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_occluders_that_block_nothing_more_leave_the_same_lines(place):
    """The same array: what followed from it is known."""
    sights = [np.array([[0, 15, 255]], np.uint8), np.full((1, 3), 255, np.uint8)]
    fewest = np.array([[0, 7, 255]], np.uint8)
    sights.insert(place, fewest)
    assert _in_all(tuple(sights)) is fewest
