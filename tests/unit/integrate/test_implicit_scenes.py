"""Implicit steps of everything that a scene may hold, against small explicit ones."""

import functools
from typing import Any

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.material.material import Property
from tests.bodies import blocks


METAL = jt.Material(20.0, density=2000.0, specific_heat=500.0, emissivity=0.8)
VARYING = jt.Material(
    Property([250.0, 450.0], [10.0, 30.0]),
    2000.0,
    Property([250.0, 450.0], [400.0, 900.0]),
    emissivity=0.8,
)
END = 60.0
LINKS = functools.partial(jt.FullVolume, stencil=False)


@functools.cache
def _grid():
    return blocks(np.ones((4, 3, 3), bool), 0.01)


def _body(start, x=0.0, material=METAL, structure: Any = jt.FullVolume):
    pose = jt.Pose(translation=(x, 0.0, 0.0))
    return jt.Body(structure(_grid()), material, temperature=start, pose=pose)


def _scene(name):
    air = jt.Convection(20.0, 290.0)
    sky = jt.Surroundings(280.0)
    sun = jt.Sun((0.0, 0.0, -1.0), jt.Until(5000.0, 30.0))
    bodies = {
        "contact": (_body(400.0), _body(300.0, 0.04)),
        "varying properties": (_body(400.0, material=VARYING),),
        "links": (
            _body(400.0, structure=functools.partial(jt.FullVolume, stencil=False)),
        ),
        "exchange": (_body(500.0), _body(300.0, 0.06)),
        "wind": (_body(400.0),),
    }[name]
    terms = {
        "contact": (jt.Contact(2000.0), air, sky),
        "varying properties": (air, sky, sun),
        "links": (air, sky, sun),
        "exchange": (jt.RadiativeExchange(300.0, max_patches=24, directions=32),),
        "wind": (jt.Wind((3.0, 0.0, 0.0), 280.0), sun),
    }[name]
    return jt.Scene(bodies, terms, dtype="float64")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "varying properties",
        "contact",
        pytest.param("exchange", marks=pytest.mark.slice),
        "links",
        "wind",
    ],
)
def test_it_is_what_small_explicit_steps_give(name):
    scene = _scene(name)
    exact = jt.simulate(scene, END, [30.0, END], solver=jt.ForwardEuler(dt=0.01))
    run = jt.simulate(scene, END, [30.0, END], solver=jt.TRBDF2(dt=2.0))
    off = np.abs(run.surface_temperature - exact.surface_temperature).max()
    effort = run.run.statistics
    assert effort is not None
    print(name, "off", off, "newton", int(effort.newton_iterations))
    # What the name promises is there.
    mechanisms = exact.receipt.included
    assert name not in ("contact", "wind") or name in mechanisms
    assert off < 0.1
    assert np.abs(run.energy.residual_relative).max() < 1e-11
    for body in run.energy.bodies:
        assert np.abs(body.residual_relative).max() < 1e-11
    # Two stages a step, each settled well before the limit.
    assert run.run.statistics is not None
    assert run.run.statistics.newton_iterations <= 8 * 2 * run.run.steps


@pytest.mark.slow
def test_an_implicit_run_in_segments_is_one_long_run():
    scene = _scene("varying properties")
    solver = jt.BackwardEuler(dt=5.0)
    todo = plan_run(scene, t1=END, save_at=[30.0, END], solver=solver)
    *_, last = run_segments(todo, begin_run(todo))
    pieces = finish_run(todo, last)
    expected = jt.simulate(scene, END, [30.0, END], solver=solver)
    np.testing.assert_allclose(
        pieces.surface_temperature, expected.surface_temperature, rtol=1e-12
    )
    assert pieces.run.statistics is not None and expected.run.statistics is not None
    assert (
        pieces.run.statistics.newton_iterations
        == expected.run.statistics.newton_iterations
    )
