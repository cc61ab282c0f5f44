"""Selections of fragments and of space: the values of `on` and `within`."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.voxels.elsewhere import Elsewhere
from jaxthermo.voxels.fragment_mask import FragmentMask
from jaxthermo.voxels.selection import (
    AbstractSpace,
    Everything,
    Face,
    FragmentCentres,
    Region,
    Side,
)


POSITION = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
NORMAL = np.tile([0.0, 0.0, 1.0], (3, 1))
FRAGMENTS = FragmentCentres(POSITION, NORMAL)


@pytest.mark.parametrize("mask", [[True, False, True], [False] * 3, [True] * 3])
def test_a_mask_chooses_what_it_marks(mask):
    on = FragmentMask(np.array(mask), body=2)
    np.testing.assert_array_equal(on.select(FRAGMENTS), mask)
    np.testing.assert_array_equal(on.mask, mask)
    assert on.body == 2
    assert repr(on) == f"FragmentMask({sum(mask)} of 3 fragments, body=2)"


def test_masks_can_be_compared_and_hashed():
    """Static parts of a compiled program must be comparable and hashable."""
    odd = np.arange(100) % 2 == 1
    assert FragmentMask(odd) == FragmentMask(odd.copy())
    assert FragmentMask(odd) != FragmentMask(~odd)
    assert hash(FragmentMask(odd)) == hash(FragmentMask(odd.tolist()))


def test_a_mask_of_another_body_is_told():
    with pytest.raises(InputError, match="has 5 values and body 0 has 3 fragments"):
        FragmentMask(np.ones(5, bool)).select(FRAGMENTS)


@pytest.mark.parametrize("mask", [[1, 0, 1], np.ones((3, 1), bool), "all", []])
def test_only_truth_values_make_a_mask(mask):
    with pytest.raises(InputError, match="one True or False for each fragment"):
        FragmentMask(mask)


def test_everything_is_all_of_a_body():
    everything = Everything(body=1)
    assert everything.body == 1
    assert everything.select(FRAGMENTS).all()
    assert everything.contains(POSITION).shape == (3,)


def test_a_region_chooses_the_surface_in_it():
    region = Region(lower=(0.5, -1.0, -1.0), upper=(5.0, 1.0, 1.0))
    np.testing.assert_array_equal(region.select(FRAGMENTS), [False, True, True])


FACES = np.concatenate([np.eye(3), -np.eye(3)])
UPPER = Region(lower=(-9.0, -9.0, 0.5), upper=(9.0, 9.0, 9.0))
ODD = FragmentMask(np.arange(6) % 2 == 1)
TOP = Side((0.0, 0.0, 1.0))


def flags(on) -> list[bool]:
    return on.select(FragmentCentres(FACES, FACES)).tolist()


def test_selections_combine_like_sets():
    top, odd, upper = (np.array(flags(on)) for on in (TOP, ODD, UPPER))
    assert flags(TOP | ODD) == (top | odd).tolist()
    assert flags(ODD & UPPER) == (odd & upper).tolist() != odd.tolist()
    assert flags(~ODD) == (~odd).tolist()
    # De Morgan's laws, and a combination of combinations.
    assert flags(~(ODD | UPPER)) == flags(~ODD & ~UPPER)
    assert flags(~(TOP & ODD)) == flags(~TOP | ~ODD)
    assert flags((TOP | ODD) & ~UPPER) == ((top | odd) & ~upper).tolist()
    assert hash(TOP | ~ODD) == hash(TOP | ~ODD)
    assert repr(~UPPER & ODD).startswith("(~Region(lower=")


def test_combined_parts_of_space_are_one():
    inner = Region(lower=(-1.0, -1.0, -1.0), upper=(1.0, 1.0, 0.75))
    between = UPPER & ~inner
    assert isinstance(between, AbstractSpace)
    points = np.array([[0, 0, 0.6], [0, 0, 0.8], [0, 0, 0.4]])
    np.testing.assert_array_equal(between.contains(points), [False, True, False])
    assert not isinstance(UPPER & TOP, AbstractSpace)


def test_a_combination_is_on_the_bodies_of_its_parts():
    either = Everything(0) | ~Side((0.0, 0.0, 1.0), body=2)
    assert either.bodies == (0, 2)
    assert either.on_body(1) is None
    assert flags(either.on_body(0)) == [True] * 6
    assert flags(either.on_body(2)) == flags(~TOP)
    narrowed = either & Side((1.0, 0.0, 0.0), body=2)
    assert narrowed.bodies == (2,)
    assert flags(narrowed.on_body(2)) == flags(Side((1.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="on different bodies and have nothing in co"):
        _ = TOP & Everything(1)
    with pytest.raises(InputError, match="combine selections only"):
        _ = TOP | 3  # pyright: ignore[reportOperatorIssue]


def test_a_face_is_a_side_of_a_sheet():
    both = FragmentCentres(FACES, FACES, face=np.repeat([0, 1], 3))
    front = Face("front", body=1)
    assert front.select(both).tolist() == [True] * 3 + [False] * 3
    assert (~front).select(both).tolist() == Face("back").select(both).tolist()
    assert (front & Side((0.0, 0.0, 1.0), body=1)).select(both).sum() == 1
    assert front.bodies == (1,)
    with pytest.raises(InputError, match=r"body 1 is solid and has no face of"):
        front.select(FRAGMENTS)
    with pytest.raises(InputError, match=r'Face\(\'top\'\): give "front" or "back"'):
        Face("top")  # type: ignore


def test_elsewhere_is_all_of_the_other_bodies_too():
    other = Elsewhere(TOP | Everything(2))
    assert flags(other.on_body(0)) == flags(~TOP)
    assert flags(other.on_body(1)) == [True] * 6
    # Nothing is left of a whole body.
    assert other.on_body(2) is None
    assert flags(Elsewhere(TOP)) == flags(~TOP)
