"""Snapshots share what does not move: bound, combined and bounded once for a scene."""

from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.physics.convection.film import FilmExchange
from jaxthermo.physics.convection.wind import Wind
from jaxthermo.physics.radiation import global_lines
from jaxthermo.physics.radiation.radiative_exchange import RadiativeExchange
from jaxthermo.physics.radiation.source import Sun
from jaxthermo.scene.compile import stable_step
from jaxthermo.scene.compile.bodies import prepare
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.compile.groups import body_groups
from jaxthermo.scene.compile.snapshots import take_snapshots
from jaxthermo.scene.compile.surface_load import SurfaceLoad


METAL = jt.Material(200.0, density=2000.0, specific_heat=500.0, emissivity=0.5)
END = 4.0
STARTS = (0.0, 1.0, 2.0, 3.0)
RAYS = ((0.1, 0.2, -1.0), (0.8, 0.2, -1.0))
SUN = jt.Sun(jt.DirectionTable((0.0, END), RAYS, snapshots=STARTS[1:]), 800.0)
GUST = jt.Table([0.0, END], [2.0, 5.0])
WIND = jt.Wind((1.0, 0.0, 0.0), 290.0, speed=GUST)
STILL_AIR = jt.FreeConvection(295.0)
SKY = jt.RadiativeExchange(280.0, directions=64)
HELD = jt.FixedTemperature(310.0, on=jt.Side((0.0, 0.0, -1.0), body=1))
TERMS = (SUN, WIND, STILL_AIR, SKY, HELD)


@pytest.fixture(scope="module")
def grid():
    return jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1)


def scene_of(grid, *terms, pose=None):
    """Two boxes, of which the first may move."""
    poses = (pose or jt.Pose((0.0, 0.0, 0.5)), jt.Pose())
    bodies = tuple(
        jt.Body(jt.FullVolume(grid), METAL, temperature=300.0, pose=pose)
        for pose in poses
    )
    return jt.Scene(bodies, terms, dtype="float64")


@pytest.fixture
def calls(monkeypatch):
    """Counts calls of the steps of binding."""
    counts = Counter()

    def count(owner, name):
        step = getattr(owner, name)

        def counted(*args, **kwargs):
            counts[owner.__name__, name] += 1
            return step(*args, **kwargs)

        monkeypatch.setattr(owner, name, counted)

    count(Wind, "bind")
    count(jt.FreeConvection, "bind")
    count(jt.FixedTemperature, "bind")
    count(RadiativeExchange, "irradiation")
    count(RadiativeExchange, "enclosure")
    count(Sun, "irradiation")
    count(FilmExchange, "coarsened")
    count(FilmExchange, "curvature")
    return counts


def moving(turn):
    """Upwards, and about the vertical by an angle [rad]."""
    first = jt.Pose((0.0, 0.0, 0.5))
    last = jt.Pose.about((0.0, 0.0, 1.0), turn, (0.0, 0.0, 0.9))
    return jt.Motion(jt.PoseTable((0.0, END), (first, last)), every=1.0)


def snapshots_of(scene, starts=STARTS):
    dtype = jnp.dtype(scene.dtype)
    groups = body_groups(scene)
    return take_snapshots(
        scene,
        prepared=tuple(prepare(n, group, dtype) for n, group in enumerate(groups)),
        starts=starts,
        end=END,
        temperatures=None,
        prune=True,
    )


def test_what_stands_still_is_bound_once(grid, calls):
    snapshots = snapshots_of(scene_of(grid, *TERMS))
    assert len(snapshots) == calls["Sun", "irradiation"] == len(STARTS)
    for name in ("Wind", "FreeConvection", "FixedTemperature"):
        assert calls[name, "bind"] == 1
    assert calls["RadiativeExchange", "irradiation"] == 1
    assert len({id(snapshot.surface) for snapshot in snapshots}) == 1


def test_bodies_that_move_are_bound_wherever_they_are(grid, calls):
    snapshots = snapshots_of(scene_of(grid, *TERMS, pose=moving(0.5)))
    assert len(snapshots) == calls["Wind", "bind"] == len(STARTS)


def test_what_stands_still_is_combined_and_bounded_once(grid, calls):
    compiled = jt.compile_scene(scene_of(grid, SUN, WIND, SKY), end=END)
    assert len(compiled.programs) == len(STARTS)
    assert calls["Wind", "bind"] == calls["RadiativeExchange", "enclosure"] == 1
    # Once on the cells of all bodies; and on those of each body for its bounds, and for
    # the stable step, which is one program for all snapshots.
    assert calls["FilmExchange", "coarsened"] == 1 + 2 + 2
    assert calls["FilmExchange", "curvature"] == 2
    loads = []
    for program in compiled.programs:
        assert isinstance(program.surface, SurfaceLoad)
        loads.append(dict(program.surface.terms.natural))
    sun, wind, _ = loads[0].values()
    for load in loads[1:]:
        later_sun, later_wind, _ = load.values()
        assert later_wind.law.coefficients.table is wind.law.coefficients.table
        assert later_wind.effective_area is wind.effective_area
        assert later_sun.effective_area is not sun.effective_area


@pytest.mark.parametrize("turn", [None, 0.5])
def test_every_snapshot_is_that_of_its_scene_alone(grid, turn):
    pose = None if turn is None else moving(turn)
    scene = scene_of(grid, *TERMS, pose=pose)
    for snapshot, start in zip(snapshots_of(scene), STARTS, strict=True):
        terms = [term.at(start + 0.5) for term in TERMS]
        alone = scene_of(grid, *terms, pose=scene.bodies[0].pose.at(start + 0.5))
        (expected,) = snapshots_of(alone, STARTS[:1])
        numbers = jax.tree.leaves([snapshot.bindings, snapshot.irradiation])
        expected_numbers = jax.tree.leaves([expected.bindings, expected.irradiation])
        assert len(numbers) > 20
        for number, alone_number in zip(numbers, expected_numbers, strict=True):
            assert_array_equal(number, alone_number)


def test_rates_that_limit_the_step_are_those_of_one_snapshot(grid, monkeypatch):
    rates_of = stable_step._rates_of
    evaluated = []

    def counted(program, highest, end):
        evaluated.append(program)
        return rates_of(program, highest, end)

    monkeypatch.setattr(stable_step, "_rates_of", counted)
    compiled = compile_scene(scene_of(grid, SUN, STILL_AIR), end=END)
    assert len(compiled.programs) == len(STARTS)
    assert len(evaluated) == 1
    highest = compiled.temperatures.highest
    for program in compiled.programs:
        rates = rates_of(program, highest, END)
        assert_array_equal(rates.at_nodes, compiled.stable_rates.at_nodes)
    # Contact while one of the bodies moves differs from snapshot to snapshot.
    evaluated.clear()
    contact = jt.Contact(bodies=(0, 1), conductance=100.0, gap_length=0.5)
    moved = compile_scene(scene_of(grid, contact, pose=moving(0.0)), end=END)
    assert len(evaluated) == len(moved.programs) > 1
    shortest = min(
        float(rates_of(program, moved.temperatures.highest, END).step((0, 1)))
        for program in moved.programs
    )
    assert float(moved.stable_step) == shortest


def test_exchange_at_every_snapshot_is_that_of_its_scene_alone(monkeypatch):
    """A cube moves between two slabs, so that all lines are the same in each scene."""
    # As in large scenes, whose views are drawn one by one.
    monkeypatch.setattr(global_lines, "_MAX_TRIANGLES", 1)
    slab = jt.FullVolume(jt.voxelize(jt.shapes.box((1.0, 1.0, 0.2)), 0.1))
    cube = jt.FullVolume(jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1))
    first, last = (jt.Pose((x, 0.1, 0.5)) for x in (-0.3, 0.3))
    motion = jt.Motion(jt.PoseTable((0.0, END), (first, last)), every=1.0)

    def scene_with(pose):
        placed = ((slab, jt.Pose()), (cube, pose), (slab, jt.Pose((0.0, 0.0, 1.0))))
        bodies = tuple(
            jt.Body(structure, METAL, temperature=300.0, pose=place)
            for structure, place in placed
        )
        return jt.Scene(bodies, (SKY,), dtype="float64")

    def factors(snapshot):
        enclosure, _ = SKY.enclosure(snapshot.surface)
        return jax.tree.leaves(enclosure)

    scenes = snapshots_of(scene_with(motion))
    for snapshot, start in zip(scenes, STARTS, strict=True):
        alone = scene_with(motion.at(start + 0.5))
        (expected,) = snapshots_of(alone, STARTS[:1])
        for value, reference in zip(factors(snapshot), factors(expected), strict=True):
            assert_allclose(value, reference, rtol=1e-9, atol=1e-12)
    moved = zip(factors(scenes[0]), factors(scenes[-1]), strict=True)
    assert any(
        first.shape != last.shape or np.abs(np.subtract(first, last)).max() > 1e-3
        for first, last in moved
        if first.size
    )
