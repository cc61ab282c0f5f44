"""What `on` and `within` take."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.voxels.selection import Everything, FragmentMask, Region


POSITION = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
NORMAL = np.tile([0.0, 0.0, 1.0], (3, 1))


@pytest.mark.parametrize("mask", [[True, False, True], [False] * 3, [True] * 3])
def test_a_mask_chooses_what_it_marks(mask):
    on = FragmentMask(np.array(mask), body=2)
    np.testing.assert_array_equal(on.select(POSITION, NORMAL), mask)
    np.testing.assert_array_equal(on.mask, mask)
    assert on.body == 2
    assert repr(on) == f"FragmentMask({sum(mask)} of 3 fragments, body=2)"


def test_masks_can_be_compared_and_hashed():
    """As static parts of a compiled program must."""
    odd = np.arange(100) % 2 == 1
    assert FragmentMask(odd) == FragmentMask(odd.copy())
    assert FragmentMask(odd) != FragmentMask(~odd)
    assert hash(FragmentMask(odd)) == hash(FragmentMask(odd.tolist()))


def test_a_mask_of_another_body_is_told():
    with pytest.raises(InputError, match="has 5 values and body 0 has 3 fragments"):
        FragmentMask(np.ones(5, bool)).select(POSITION, NORMAL)


@pytest.mark.parametrize("mask", [[1, 0, 1], np.ones((3, 1), bool), "all", []])
def test_only_truth_values_make_a_mask(mask):
    with pytest.raises(InputError, match="one True or False for each fragment"):
        FragmentMask(mask)


def test_everything_is_all_of_a_body():
    everything = Everything(body=1)
    assert everything.body == 1
    assert everything.select(POSITION, NORMAL).all()
    assert everything.contains(POSITION).shape == (3,)


def test_a_region_chooses_the_surface_in_it():
    region = Region(lower=(0.5, -1.0, -1.0), upper=(5.0, 1.0, 1.0))
    np.testing.assert_array_equal(region.select(POSITION, NORMAL), [False, True, True])
