"""The broad phase drops no pair that touches, and drops those that views separate."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from placed import ball_grid, box_grid, placed
from scipy.spatial import KDTree

from jaxthermo.geometry.mesh import Pose
from jaxthermo.memo.found import searches_recorded
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import (
    broad_phase,
    contacts_between,
    find_contacts,
)


PITCH = 0.2
BOX = box_grid((1.0, 1.0, 0.6), PITCH)
BALL = ball_grid(0.5, PITCH, subdivisions=3)
ROD = box_grid((0.2, 0.2, 2.2), PITCH)
GRIDS = (BOX, BALL, ROD)


def points_of(body):
    """Points closely spread over a body's surface, in the world [m]."""
    triangles = body.grid.mesh.triangles
    steps = np.linspace(0.0, 1.0, 9 if len(triangles) < 100 else 2)
    u, v = (w.reshape(-1)[:, None] for w in np.meshgrid(steps, steps))
    inside = (u + v <= 1)[:, 0]
    u = u[inside]
    v = v[inside]
    a, b, c = (triangles[:, None, i] for i in range(3))
    return body.pose.to_world((a + u * (b - a) + v * (c - a)).reshape(-1, 3))


def closest(first, second):
    """Smallest distance of sampled points of two surfaces, never too small."""
    return float(KDTree(points_of(first)).query(points_of(second))[0].min())


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 9), spread=st.floats(0.8, 3.0))
def test_no_pair_is_lost(seed, count, spread):
    random = np.random.default_rng(seed)
    bodies = tuple(
        placed(
            GRIDS[random.integers(3)],
            spread * random.uniform(-1, 1, 3),
            random.uniform(-180, 180, 3),
        )
        for _ in range(count)
    )
    candidates = broad_phase(bodies)
    pairs = {tuple(pair) for pair in candidates.pairs.tolist()}
    for i in range(count):
        for j in range(i + 1, count):
            if closest(bodies[i], bodies[j]) <= PITCH:
                assert (i, j) in pairs
    assert len(pairs) <= candidates.overlapping_boxes <= candidates.possible
    assert set(candidates.bodies) == {body for pair in pairs for body in pair}


@pytest.mark.slow
@settings(deadline=None, max_examples=5)
@given(seed=st.integers(0, 10**6))
def test_no_contact_is_lost(seed):
    """Boxes that stand on a grid, some a gap apart: every pair searched closely."""
    random = np.random.default_rng(seed)
    places = random.choice(8, 4, replace=False)
    where = np.stack(np.unravel_index(places, (2, 2, 2)), axis=1).astype(float)
    where *= np.array([1.0, 1.0, 0.6]) * random.choice([1.0, 1.1, 1.3])
    bodies = tuple(placed(BOX, spot) for spot in where)
    expected = {
        (i, j)
        for i in range(4)
        for j in range(i + 1, 4)
        if find_contacts(bodies[i], bodies[j]).count
    }
    assert set(contacts_between(bodies)) == expected


def test_a_body_within_another_is_kept():
    """Its surface is far from the other's, and only depth shows that it overlaps."""
    room = placed(box_grid((2.2, 2.2, 2.2), PITCH))
    assert broad_phase((room, placed(BALL))).pairs.tolist() == [[0, 1]]


def test_views_prune_what_boxes_do_not():
    """Rods side by side along a diagonal: boxes overlap, the bodies do not."""
    rods = tuple(
        placed(box_grid((0.1, 0.1, 4.0), 0.05), (1.2 * k, 0.0, 0.0), (0.0, 45.0, 0.0))
        for k in range(4)
    )
    candidates = broad_phase(rods)
    assert (candidates.possible, candidates.overlapping_boxes) == (6, 5)
    assert candidates.pairs.tolist() == [] and candidates.bodies == ()


def test_a_wide_threshold_keeps_more():
    pair = (placed(BALL), placed(BALL, (3.0, 0.0, 0.0)))
    assert broad_phase(pair).pairs.tolist() == []
    assert broad_phase(pair, 2.1).pairs.tolist() == [[0, 1]]


def test_one_body_has_no_pair():
    candidates = broad_phase((placed(BALL),))
    assert (
        candidates.possible
        == candidates.overlapping_boxes
        == len(candidates.pairs)
        == 0
    )


def test_contacts_of_bodies_that_move_together_are_found_once():
    grids = (box_grid((1.0, 1.0, 0.6), PITCH), ROD)
    away = Pose.about((1.0, 2.0, 3.0), 0.7, (5.0, -3.0, 0.1))

    def contacts(first, second):
        poses = (first, second.after(Pose((0.6, 0.1, 0.2))))
        bodies = tuple(map(PlacedGrid, grids, poses))
        with searches_recorded() as searches:
            (pairs,) = contacts_between(bodies).values()
        return bodies, pairs, searches

    _, here, searches = contacts(Pose(), Pose())
    assert searches == ["contacts of bodies"]
    bodies, there, searches = contacts(away, away)
    assert there is here and not searches
    alone = find_contacts(bodies[0], bodies[1])
    assert_array_equal(alone.fragment_a, here.fragment_a)
    assert_array_equal(alone.fragment_b, here.fragment_b)
    assert_allclose(alone.area, here.area, rtol=1e-9)
    assert_allclose(alone.gap, here.gap, atol=1e-12)
    _, _, searches = contacts(Pose(), Pose((0.0, 0.01, 0.0)))
    assert searches == ["contacts of bodies"]
