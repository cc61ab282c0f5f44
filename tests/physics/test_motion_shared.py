"""Snapshots of a motion search for what moved, and find what full searches do."""

import functools
from collections import Counter

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.memo.found import forget_findings, searches_recorded
from jaxthermo.physics.contact.search import ContactPairs
from jaxthermo.physics.radiation.visibility import sky_view
from jaxthermo.scene.compile.bodies import prepare
from jaxthermo.scene.compile.groups import body_groups
from jaxthermo.scene.compile.snapshots import take_snapshots
from jaxthermo.scene.motion import moving_together


METAL = jt.Material(200.0, density=2000.0, specific_heat=500.0, emissivity=0.5)
DIRECTIONS = 16
SUN = jt.Sun((0.4, 0.3, -0.5), 800.0)
LAMP = jt.PointSource((0.1, -0.6, 0.9), 10.0)
PANEL = jt.AreaSource((0.0, 0.8, 0.6), (0, -1, -0.3), (0.3, 0.2), 50.0, patches=2)
SKY = jt.DiffuseSky(100.0, occlusion=DIRECTIONS)
STARTS = (0.0, 1.0, 2.0, 3.0)
END = 4.0

# Halves of a car, parked ones, and the ground.
CAR = ((-0.5, 0.0, 0.115), (-0.5, 0.0, 0.238))
PARKED = ((0.3, 0.3, 0.11), (0.3, -0.3, 0.11))
GROUND = (0.0, 0.0, 0.0)


def body(grid, pose):
    return jt.Body(jt.FullVolume(grid), METAL, temperature=300.0, pose=pose)


def driving(place, turn):
    """Over the ground, and about the vertical by an angle [rad]."""
    first = jt.Pose(place)
    way = jt.Pose.about((0.0, 0.0, 1.0), turn, (0.7, 0.11, 0.0))
    return jt.Motion(jt.PoseTable((0.0, END), (first, way.after(first))), every=1.0)


@functools.cache
def grids():
    """Half a car without any symmetry, and the ground."""
    mesh = jt.shapes.box((0.3, 0.18, 0.12))
    bump = np.zeros((len(mesh.vertices), 3))
    bump[0] = 0.04, 0.03, 0.005
    dented = jt.Mesh(mesh.vertices + bump, mesh.faces)
    ground = jt.shapes.box((1.41, 1.02, 0.1))
    return jt.voxelize(dented, 0.06), jt.voxelize(ground, 0.1)


def street(*terms, turn=0.0):
    car, ground = grids()
    return jt.Scene(
        (
            *(body(car, driving(place, turn)) for place in CAR),
            *(body(car, jt.Pose(place)) for place in PARKED),
            body(ground, jt.Pose(GROUND)),
        ),
        terms,
        dtype="float64",
    )


@functools.cache
def prepared_bodies():
    """They depend on neither terms nor poses."""
    dtype = jnp.dtype("float64")
    groups = body_groups(street())
    return tuple(prepare(n, group, dtype) for n, group in enumerate(groups))


def snapshots_of(scene, starts=STARTS):
    with searches_recorded() as searches:
        snapshots = take_snapshots(
            scene,
            prepared_bodies(),
            starts=starts,
            end=END,
            temperatures=None,
            prune=True,
        )
    return snapshots, Counter(searches)


def full_search(term, seen):
    """Factors of a body's fragments by one search through the whole scene."""
    if term is SKY:
        return sky_view(
            seen.scene_triangles,
            position=seen.position,
            normal=seen.normal,
            pitch=seen.pitch,
            directions=DIRECTIONS,
        ).sky
    return term.exposure(seen.scene_triangles, seen.position, seen.normal, seen.pitch)


@pytest.mark.parametrize(
    ("term", "turn"),
    [(SUN, 0.0), (SUN, 0.8), (LAMP, 0.8), (PANEL, 0.8), (SKY, 0.0), (SKY, 0.8)],
    ids=lambda value: getattr(value, "name", value),
)
def test_all_that_blocks_together_blocks_what_the_scene_does(term, turn):
    snapshots, _ = snapshots_of(street(term, turn=turn))
    shaded = []
    for snapshot in snapshots:
        (_, irradiation), *_ = snapshot.irradiation
        bodies = snapshot.surface.bodies
        assert len(bodies[0].occluders) == 2
        exact = np.concatenate([full_search(term, seen) for seen in bodies])
        # A part that rounding moves to the next pixel would be off by a fourth.
        assert_allclose(irradiation.factor, exact, atol=1e-9)
        shaded.append(exact)
    on_ground = np.stack(shaded)[:, -snapshots[0].surface.counts[-1] :]
    assert np.ptp(on_ground, axis=0).max() > 0.2 * on_ground.max()


def test_only_what_moved_is_searched_for():
    forget_findings()
    still, searches = snapshots_of(street(SUN, SKY), STARTS[:1])
    # As one occluder: each of five bodies looks once for each term.
    assert searches["shadows of sun on body 4"] == 1
    assert len(still[0].surface.bodies[0].occluders) == 1
    snapshots, searches = snapshots_of(street(SUN, SKY))
    steps = len(STARTS)
    for number in range(5):
        # Both occluders at first, then the one that moved in the body's frame.
        for task in ("shadows of sun on", "view of sky and ground from"):
            assert searches[f"{task} body {number}"] == 1 + steps
    forget_findings()
    _, searches = snapshots_of(street(SUN, SKY, turn=0.8))
    # A car that turns sees another sun.
    assert searches["shadows of sun on body 0"] == 2 * steps
    assert searches["shadows of sun on body 4"] == 1 + steps
    # What stands still has the same array at all snapshots.
    lit = [snapshot.surface.bodies[2].position for snapshot in snapshots]
    assert all(positions is lit[0] for positions in lit)


def test_contacts_of_bodies_that_move_together_are_searched_for_once():
    forget_findings()
    snapshots, searches = snapshots_of(street(jt.Contact(500.0), turn=0.8))
    pairs_near = searches["contacts of bodies"]
    contacts = [snapshot.pairs[0, 0, 1] for snapshot in snapshots]
    assert isinstance(contacts[0], ContactPairs)
    assert contacts[0].area.sum() > 0.2 * 0.15
    assert all(contact is contacts[0] for contact in contacts)
    assert len({id(snapshot.pairs[0, 0, 4]) for snapshot in snapshots}) > 1
    _, again = snapshots_of(street(jt.Contact(400.0), turn=0.8))
    assert pairs_near > len(STARTS) and not again["contacts of bodies"]


def test_bodies_move_together_if_they_keep_their_places():
    car = [driving(place, 0.8) for place in CAR]
    alone = driving((0.0, 0.0, 1.0), 0.5)
    still = jt.Pose((1e3, 2e3, 0.1))
    poses = [
        tuple(pose.at(time) for pose in (car[0], alone, still, car[1], jt.Pose()))
        for time in (0.0, 1.1, 2.3)
    ]
    assert moving_together(poses, 0.01) == ((0, 3), (1,), (2, 4))
    assert moving_together(poses[:1], 0.01) == (tuple(range(5)),)
