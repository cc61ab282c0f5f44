"""Bodies that start at the steady state of their scene."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import bar

import jaxthermo as jt


STEEL = jt.Material(conductivity=16.0, density=8000.0, specific_heat=500.0)
VARYING = jt.Material(
    conductivity=jt.Property([250.0, 400.0], [8.0, 40.0]),
    density=8000.0,
    specific_heat=500.0,
)
LOADS = (
    jt.Convection(10.0, 290.0),
    jt.HeatSource(2e5, within=jt.Region((0.0, -1.0, -1.0), (1.0, 1.0, 1.0))),
)


def scene(*bodies, terms=LOADS):
    return jt.Scene(bodies, terms, dtype="float64")


def block(material=STEEL, temperature=350.0, x=0.0, size=4):
    return jt.Body(
        jt.FullVolume(bar(size, 0.01)),
        material,
        temperature=temperature,
        pose=jt.Pose(translation=(x, 0.0, 0.0)),
    )


def later(start, seconds=400.0):
    """Surface temperatures of a run that begins there [K]."""
    solver = jt.BackwardEuler(dt=100.0)
    return np.asarray(jt.simulate(start, seconds, solver=solver).surface_temperature)[
        -1
    ]


@pytest.mark.parametrize(
    "material",
    [pytest.param(STEEL, marks=pytest.mark.slow), VARYING],
    ids=["constant", "varying"],
)
def test_a_run_stays_where_it_starts(material):
    cold = scene(block(material))
    start = jt.start_steady(cold)
    # Conductivities at the surface are those of the start: so are those of the run.
    expected = np.asarray(jt.steady(start).surface_temperature)[0]
    assert np.ptp(expected) > 1.0
    np.testing.assert_allclose(later(start), expected, rtol=0, atol=1e-6)
    # Another beginning of the search leads to the same start.
    other = jt.start_steady(scene(block(material, temperature=280.0)))
    np.testing.assert_allclose(later(other), later(start), rtol=0, atol=1e-6)


@pytest.mark.slow
def test_air_starts_with_the_density_of_its_steady_state():
    room = jt.Sheet(
        jt.shapes.box((1.0, 1.0, 1.0)),
        layers=[jt.Layer(STEEL, 0.002)],
        pitch=0.5,
        cells=1,
    )
    air = jt.AirVolume.inside(room)
    cold = scene(
        jt.Body(room, temperature=400.0),
        jt.Body(air, temperature=400.0),
        terms=(
            jt.Convection(10.0, 290.0),
            jt.EnclosedAir(5.0, exchange=0.01, temperature=280.0, body=0, air=1),
            jt.HeatFlux(50.0, on=jt.Face("front")),
        ),
    )
    start = jt.start_steady(cold)
    air_temperature: Any = start.bodies[1].temperature
    steady = jt.steady(start)
    # rho of the incoming air is that at the start: 1 / T.
    np.testing.assert_allclose(
        float(air_temperature),
        np.asarray(steady.mean_temperature)[0, 1],
        rtol=0,
        atol=1e-6,
    )
    once = np.asarray(jt.steady(cold).mean_temperature)[0, 1]
    assert abs(once - float(air_temperature)) > 1e-3


def test_a_derivative_passes_through_the_start():
    cold = scene(block())

    def warmth(h):
        terms = (jt.Convection(h, 290.0), LOADS[1])
        start = jt.start_steady(replace(cold, terms=terms))
        run = jt.simulate(start, 20.0, solver=jt.ForwardEuler(dt=1.0))
        return run.surface_temperature[-1].mean()

    slope = jax.jit(jax.grad(warmth))(jnp.asarray(10.0))
    difference = (warmth(10.01) - warmth(9.99)) / 0.02
    np.testing.assert_allclose(slope, difference, rtol=1e-5)


def test_a_body_without_exchange_has_no_steady_state_of_its_own():
    alone = jt.Convection(10.0, 290.0, on=jt.Everything(body=0))
    cold = scene(block(), block(x=0.2), terms=(alone,))
    with pytest.raises(jt.InputError, match="body 1 exchanges heat with nothing"):
        jt.start_steady(cold)
    with pytest.raises(jt.InputError, match="there is no body 2"):
        jt.start_steady(cold, [2])
