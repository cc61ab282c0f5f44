"""Bodies that overlap: how deeply and where, and a body inside another one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.memo.found import searches_recorded
from jaxthermo.physics.contact.overlap import Overlap, find_overlaps
from jaxthermo.physics.contact.rays import PlacedGrid
from tests.bodies import blocks


CUBE = blocks(np.ones((10, 10, 10), bool), 0.01)
FINE = blocks(np.ones((20, 20, 20), bool), 0.002)
_HOLLOW = np.ones((10, 10, 10), bool)
_HOLLOW[2:8, 2:8, 2:8] = False
HOLLOW = blocks(_HOLLOW, 0.01)
C = float(np.cos(0.6))
S = float(np.sin(0.6))
TURN = ((C, -S, 0.0), (S, C, 0.0), (0.0, 0.0, 1.0))
STRAIGHT = Pose().rotation


def overlaps(a, b, translation, rotation=STRAIGHT):
    x, y, z = (float(length) for length in translation)
    moved = Pose((x, y, z), rotation)
    return find_overlaps((PlacedGrid(a, Pose()), PlacedGrid(b, moved)))


@pytest.mark.parametrize("depth", [0.02, 0.035])
@pytest.mark.parametrize("turned", [False, True])
def test_two_boxes_overlap_by_a_slab(depth, turned):
    """10 cm cubes, side by side along x but for the depth, together at any angle."""
    frame = Pose(rotation=TURN) if turned else Pose()
    x, y, z = frame.rotate(np.array([0.1 - depth, 0.0, 0.0])).tolist()
    neighbour = Pose((x, y, z), frame.rotation)
    placed = (PlacedGrid(CUBE, frame), PlacedGrid(CUBE, neighbour))
    (overlap,) = find_overlaps(placed).values()
    assert isinstance(overlap, Overlap)
    assert overlap.depth == pytest.approx(depth, rel=1e-9)
    # Counted by the centres of voxels.
    assert overlap.volume == pytest.approx(0.01 * depth, abs=0.51 * 0.01 * 0.01)
    assert overlap.fraction == pytest.approx(overlap.volume / 1e-3)
    inside = frame.to_body(overlap.position)
    assert 0.1 - depth <= inside[0] <= 0.1
    line = overlap.described((0, 1))
    assert line.startswith(f"bodies 0 and 1 overlap by {1e3 * depth:.3g} mm around (")


@pytest.mark.parametrize("share", [-0.5, 0.0, 0.5, 1.0])
@pytest.mark.parametrize("cube", [CUBE, FINE], ids=["equal", "finer"])
def test_up_to_a_voxel_is_contact(share, cube):
    for offset in (0.0, 0.0033):
        where = (0.1 - share * 0.01, offset, -offset)
        assert overlaps(CUBE, cube, where) == {}
        assert overlaps(cube, CUBE, [-x for x in where]) == {} or cube is FINE


def test_a_turned_box_that_touches_does_not_overlap():
    """Its edge along z touches the face at x = 0.1; 2 mm deeper is contact still."""
    # Rotated about its corner, all of it is at x >= 0 and y may be anything.
    corner = np.array([[x, y, 0.0] for x in (0, 0.04) for y in (0, 0.04)])
    lowest = Pose(rotation=TURN).rotate(corner)[:, 0].min()
    for deeper in (0.0, 0.002):
        touching = (0.1 - lowest - deeper, 0.03, 0.03)
        assert overlaps(CUBE, FINE, touching, rotation=TURN) == {}
    sunk = (0.1 - lowest - 0.03, 0.03, 0.03)
    (overlap,) = overlaps(CUBE, FINE, sunk, rotation=TURN).values()
    assert 0.01 < overlap.depth <= 0.03 + 1e-9


def test_a_body_inside_the_solid_of_another_is_refused():
    inside = (0.03, 0.03, 0.03)
    with pytest.raises(InputError, match="body 1 lies wholly in the solid of body 0"):
        overlaps(CUBE, FINE, inside)
    with pytest.raises(InputError, match="body 0 lies wholly in the solid of body 1"):
        overlaps(FINE, CUBE, [-x for x in inside])
    with pytest.raises(InputError, match="lies wholly in the solid"):
        overlaps(CUBE, CUBE, (0.0, 0.0, 0.0))


def test_thin_plates_too():
    """One voxel thick: flush with a face, and one upon the other, are inside."""
    plate = blocks(np.ones((1, 5, 5), bool), 0.01)
    for x, y in ((0.09, 0.02), (0.0, 0.02), (0.04, 0.05)):
        with pytest.raises(InputError, match="body 1 lies wholly"):
            overlaps(CUBE, plate, (x, y, 0.02))
    with pytest.raises(InputError, match="body 0 lies wholly"):
        overlaps(plate, plate, (0.0, 0.0, 0.0))
    # Sunk by 6 mm, less than a voxel, its centres are inside; by contact.
    assert overlaps(CUBE, plate, (0.094, 0.02, 0.02)) == {}


def test_a_body_in_a_cavity_is_not():
    """6 cm wide: the cube of 4 cm is free, touches a wall, or is partly in it."""
    assert overlaps(HOLLOW, FINE, (0.03, 0.03, 0.03)) == {}
    assert overlaps(HOLLOW, FINE, (0.02, 0.02, 0.03)) == {}
    (overlap,) = overlaps(HOLLOW, FINE, (0.005, 0.03, 0.03)).values()
    assert isinstance(overlap, Overlap)
    assert overlap.depth == pytest.approx(0.015, rel=1e-9)
    assert overlap.smaller == 1 and overlap.fraction == pytest.approx(0.4, abs=0.06)


def test_bodies_that_move_together_are_searched_for_once():
    def overlap_searches(*poses):
        placed = tuple(PlacedGrid(CUBE, pose) for pose in poses)
        with searches_recorded() as searches:
            overlaps = find_overlaps(placed)
        return overlaps, len(searches)

    turned = Pose.about((1.0, 2.0, 3.0), 0.7, (5.0, -3.0, 0.1))
    second = Pose((0.05, 0.0, 0.0))
    first, count = overlap_searches(Pose(), second)
    assert count == 1
    together, count = overlap_searches(turned, turned.after(second))
    assert count == 0
    assert together[0, 1].depth == first[0, 1].depth
    assert_allclose(
        together[0, 1].position, turned.to_world(first[0, 1].position), atol=1e-12
    )
    _, count = overlap_searches(Pose(), Pose((0.04, 0.0, 0.0)))
    assert count == 1
    assert overlap_searches(Pose(), Pose((1.0, 0.0, 0.0))) == ({}, 0)
