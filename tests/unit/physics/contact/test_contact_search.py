"""Boxes on boxes: which fragments touch, over which area, whatever frame or order."""

import jax
import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from placed import ball_grid, box_grid, moved, placed, pose

from jaxthermo.errors import InputError
from jaxthermo.physics.contact.search import contacts_between, find_contacts
from tests.bodies import blocks


# Small enough for one compiled program to make all grids.
PITCH = 0.2
SMALL = box_grid((1.0, 1.0, 0.6), PITCH)
LARGE = box_grid((2.2, 2.2, 0.6), PITCH)
ON_TOP = placed(SMALL, (0.0, 0.0, 0.3), name="lid")
BELOW = placed(LARGE, (0.0, 0.0, -0.3), name="table")


def check_sums(pairs, a, b):
    """Both sides agree on the area, and each pair is there once."""
    for fragment, coverage, grid in (
        (pairs.fragment_a, pairs.coverage_a, a.grid),
        (pairs.fragment_b, pairs.coverage_b, b.grid),
    ):
        covered = np.bincount(fragment, pairs.area, len(grid.fragment_area))
        assert coverage == pytest.approx(np.minimum(covered / grid.fragment_area, 1))
    keys = set(zip(pairs.fragment_a.tolist(), pairs.fragment_b.tolist(), strict=True))
    assert len(keys) == pairs.count == len(pairs.area)
    normals = a.pose.rotate(a.grid.fragment_normal)[pairs.fragment_a]
    facing_normals = b.pose.rotate(b.grid.fragment_normal)[pairs.fragment_b]
    assert ((normals * facing_normals).sum(1) < -0.4).all()


def test_matching_lattices_touch_fragment_by_fragment():
    pairs = find_contacts(ON_TOP, BELOW)
    assert pairs.count == 25
    assert pairs.area == pytest.approx(np.full(25, PITCH**2))
    assert pairs.gap == pytest.approx(np.zeros(25), abs=1e-12)
    points_a = ON_TOP.world_fragments[pairs.fragment_a]
    points_b = BELOW.world_fragments[pairs.fragment_b]
    assert points_a == pytest.approx(points_b, abs=1e-12)
    assert (pairs.coverage_a > 0).sum() == (pairs.coverage_b > 0).sum() == 25
    assert pairs.coverage_a.max() == pytest.approx(1.0)
    check_sums(pairs, ON_TOP, BELOW)


@pytest.mark.parametrize("pitch", [1e-5 * 3**n for n in range(10)])
def test_faces_that_match_are_covered_whole_at_any_scale(pitch):
    """To the last digit: rounding of the pitch leaves no sliver exposed."""
    grid = blocks(np.ones((3, 2, 2), bool), pitch)
    pairs = find_contacts(placed(grid), placed(grid, (3 * pitch, 0.0, 0.0)))
    assert pairs.count == 4
    for coverage in (pairs.coverage_a, pairs.coverage_b):
        assert np.unique(coverage).tolist() == [0.0, 1.0]


def test_swapping_the_bodies_swaps_the_pairs():
    pairs = find_contacts(ON_TOP, BELOW)
    swapped = find_contacts(BELOW, ON_TOP)
    assert sorted(zip(pairs.fragment_a, pairs.fragment_b, strict=True)) == sorted(
        zip(swapped.fragment_b, swapped.fragment_a, strict=True)
    )
    assert swapped.coverage_b == pytest.approx(pairs.coverage_a)
    fine = placed(box_grid((1.0, 1.0, 0.6), 0.15), (0.03, 0.02, 0.3))
    pairs = find_contacts(fine, BELOW)
    swapped = find_contacts(BELOW, fine)
    for mine, theirs in zip(pairs, swapped.swapped(), strict=True):
        assert (mine == theirs).all()


@settings(deadline=None, max_examples=6)
@given(
    shift=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
    turn=st.floats(0, 90),
    pitch=st.sampled_from([0.2, 0.19, 0.17, 0.25]),
    swap=st.booleans(),
)
@example(shift=(0.1953125, 0.1953125), turn=0.0, pitch=0.17, swap=False)
def test_the_area_of_a_box_is_exact_to_a_ray(shift, turn, pitch, swap):
    table = placed(box_grid((2.2, 2.2, 0.6), pitch), (*shift, -0.3), (0, 0, turn))
    first, second = (table, ON_TOP) if swap else (ON_TOP, table)
    # An edge of the finer lattice is known to a quarter of a voxel, four of them.
    pairs = find_contacts(first, second)
    edges = 4 * min(PITCH, pitch) / 8
    assert pairs.area.sum() == pytest.approx(1.0, abs=edges)
    check_sums(pairs, first, second)
    lid = pairs.coverage_b if swap else pairs.coverage_a
    bottom = ON_TOP.grid.fragment_normal[:, 2] < -0.9
    assert not lid[~bottom].any()
    # The lid lies on the table as a whole: its mean coverage is that area.
    assert lid[bottom].mean() == pytest.approx(1.0, abs=edges)
    assert lid[bottom].min() > 0.7


def test_no_fragment_of_another_lattice_is_covered_twice():
    """Rays fall unevenly on cells of another size; their areas are evened out."""
    table = placed(box_grid((2.2, 2.2, 0.6), 0.161), (0.0321, 0.013, -0.3))
    pairs = find_contacts(ON_TOP, table)
    covered = np.bincount(pairs.fragment_b, pairs.area)
    room = table.grid.fragment_area[: len(covered)] / table.voxels.area_ratio
    assert (covered / room).max() < 1.02
    inner = np.abs(table.world_fragments[:, :2]).max(1) < 0.4
    inner &= table.grid.fragment_normal[:, 2] > 0.9
    assert pairs.coverage_b[inner].min() > 0.95


@settings(deadline=None, max_examples=4)
@given(
    turn=st.tuples(*[st.floats(-180, 180)] * 3),
    shift=st.tuples(*[st.floats(-5, 5)] * 3),
)
def test_the_world_may_be_turned(turn, shift):
    world = pose(shift, turn)
    pairs = find_contacts(moved(ON_TOP, world), moved(BELOW, world))
    expected = find_contacts(ON_TOP, BELOW)
    assert pairs.area.sum() == pytest.approx(expected.area.sum(), rel=1e-9)
    assert pairs.coverage_a == pytest.approx(expected.coverage_a, abs=1e-9)


def test_contact_is_found_while_a_scene_is_traced():
    area = jax.jit(lambda h: h * find_contacts(ON_TOP, BELOW).area.sum())(2.0)
    assert float(area) == pytest.approx(2.0)


@pytest.mark.parametrize("gap", [-0.28, -0.1, -1e-9, 1e-9, 0.06, 0.199])
def test_gaps_and_slight_overlaps_are_told(gap):
    lid = placed(SMALL, (0.0, 0.0, 0.3 + gap))
    for first, second in ((lid, BELOW), (BELOW, lid)):
        pairs = find_contacts(first, second)
        faces = pairs.gap < 2 * abs(gap)
        assert pairs.gap[faces] == pytest.approx(gap, abs=1e-9)
        assert pairs.area[faces].sum() == pytest.approx(1.0, rel=1e-9)


def test_beyond_the_threshold_nothing_touches():
    lid = placed(SMALL, (0.0, 0.0, 0.3 + 0.21))
    none = find_contacts(lid, BELOW)
    assert none.count == len(none.area) == 0
    assert not none.coverage_a.any() and not none.coverage_b.any()
    assert len(none.coverage_b) == len(LARGE.fragment_area)
    assert find_contacts(lid, BELOW, 0.25).area.sum() == pytest.approx(1.0)
    assert find_contacts(placed(SMALL, (9.0, 0.0, 0.0)), BELOW).count == 0
    assert contacts_between((lid, BELOW)) == {}


def test_sheets_touch_with_the_sides_that_face():
    """Both sheets and the threshold are thin enough for the outer sides to be near."""
    sheet = box_grid((1.0, 1.0, PITCH), PITCH)
    lower = placed(sheet, (0.0, 0.0, -PITCH / 2))
    upper = placed(sheet, (0.0, 0.0, PITCH / 2))
    pairs = find_contacts(lower, upper, 2.5 * PITCH)
    assert pairs.area.sum() == pytest.approx(1.0)
    assert (sheet.fragment_normal[pairs.fragment_a, 2] > 0.9).all()
    assert (sheet.fragment_normal[pairs.fragment_b, 2] < -0.9).all()


def test_a_body_in_a_slot_touches_both_walls():
    walls = (placed(SMALL, (0, 0, 0.6)), placed(SMALL, (0, 0, -0.6)))
    filling = placed(SMALL)
    contacts = contacts_between((*walls, filling))
    assert sorted(contacts) == [(0, 2), (1, 2)]
    for pairs in contacts.values():
        assert pairs.area.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("angle", [1.0, 5.0])
def test_a_box_tilted_on_its_edge_touches_along_a_strip(angle):
    """Within the threshold lies a strip as wide as threshold / sin(angle)."""
    slope = np.radians(angle)
    lift = 0.5 * np.sin(slope) + 0.3 * np.cos(slope)
    lid = placed(SMALL, (0.0, 0.0, float(lift)), (0.0, angle, 0.0))
    threshold = 0.04 if angle == 5.0 else 0.01
    expected = threshold / np.sin(slope)
    for first, second in ((lid, BELOW), (BELOW, lid)):
        area = find_contacts(first, second, threshold).area.sum()
        assert area == pytest.approx(expected, abs=2 * PITCH / 4)


def test_pairs_are_padded_to_a_fixed_size():
    pairs = find_contacts(ON_TOP, BELOW)
    padded = pairs.padded(100)
    assert all(len(rows) == 100 for rows in padded[:4])
    assert padded.count == 25 and padded.area.sum() == pairs.area.sum()
    assert padded.fragment_a[25:].tolist() == [0] * 75
    assert (padded.coverage_b == pairs.coverage_b).all()
    with pytest.raises(InputError, match="lid and table: 25 pairs and room for 24"):
        pairs.padded(24, "lid and table")


@pytest.mark.parametrize(
    ("grid", "height", "thickness", "depth"),
    [
        (SMALL, -0.3, 0.6, 0.3),
        (ball_grid(0.8, PITCH), 0.0, 2.2, 0.8),
        (box_grid((0.4, 0.4, 2.6), PITCH), -1.1, 2.2, 0.9),
        (box_grid((1.0, 1.0, PITCH), PITCH), -PITCH / 2, PITCH, PITCH / 2),
    ],
    ids=["in one place", "sunk", "stuck through", "thin"],
)
def test_deep_overlap_is_refused_in_one_line(grid, height, thickness, depth):
    body = placed(grid, (0.0, 0.0, height), name="lid")
    table = box_grid((2.2, 2.2, thickness), PITCH)
    below = placed(table, (0.0, 0.0, -thickness / 2), name="table")
    for bodies in ((body, below), (below, body)):
        names = f"{bodies[0].name} and {bodies[1].name} overlap by about"
        with pytest.raises(InputError, match=names) as told:
            contacts_between(bodies, 0.01)
        told_depth = float(str(told.value).split("about ")[1].split(" m")[0])
        assert told_depth == pytest.approx(depth, abs=PITCH)
        assert "\n" not in str(told.value)


@pytest.mark.parametrize("threshold", [0.0, -1.0, np.inf, np.nan])
def test_a_threshold_must_be_a_length(threshold):
    with pytest.raises(InputError, match="threshold"):
        find_contacts(ON_TOP, BELOW, threshold)
