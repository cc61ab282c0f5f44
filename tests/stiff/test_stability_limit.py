"""The stable step is sharp: within bounds at the limit, out of them just above."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.explicit import EulerStepper
from jaxthermo.integrate.ledger import empty_ledger
from jaxthermo.integrate.run.step_loop import Span, advance
from jaxthermo.integrate.stepper import RunState
from jaxthermo.physics.windows import Window
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import blocks


_advance = eqx.filter_jit(advance)
"""With no check of the step; one program for any number of steps."""

METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
OTHER = jt.Material(200.0, density=8000.0, specific_heat=500.0)
PITCH = 0.01
TERMS = {
    "insulated": (),
    "convection": (jt.Convection(5000.0, 300.0),),
    "fixed": (jt.FixedTemperature(300.0, on=jt.Side((1.0, 0.0, 0.0))),),
    "emission": (jt.Surroundings(300.0),),
}


def _checkerboard(points):
    cell = np.floor(points / PITCH).astype(int)
    return 300.0 + 100.0 * (cell.sum(axis=1) % 2)


@functools.cache
def _compiled(mechanism, painted, dtype):
    structure = jt.FullVolume(blocks(np.ones((6, 5, 4), bool), PITCH))
    region = jt.Region((0.03, -1.0, -1.0), (1.0, 1.0, 1.0))
    material = jt.MaterialMap(METAL, ((region, OTHER),)) if painted else METAL
    body = jt.Body(structure, material, temperature=_checkerboard)
    scene = jt.Scene((body,), TERMS[mechanism], dtype=dtype)
    return structure, compile_scene(scene, end=1.0)


def _range_after(mechanism, share, painted, dtype, steps):
    """Lowest and highest temperature after some steps of a share of the limit."""
    structure, compiled = _compiled(mechanism, painted, dtype)
    program = compiled.program
    float_type = jnp.dtype(dtype)
    dt = (compiled.stable_step * share).astype(float_type)
    state = RunState(compiled.state, empty_ledger(len(program.entries), float_type))
    window = Window(jnp.zeros(2, float_type), steps * dt)
    span = Span(window, dt=dt, steps=jnp.asarray(steps))
    state = _advance(EulerStepper(), program, state, span)
    nodes = np.asarray(state.theta[0], float)[structure.node_address()]
    reference = float(program.bodies[0].reference)
    return nodes.min() + reference, nodes.max() + reference


# Painted bodies with other mechanisms are slow: what loads add is the same in both.
BOTH = ("insulated", "convection")


@pytest.mark.parametrize(
    ("mechanism", "painted"),
    [
        *((name, False) for name in TERMS),
        *(
            pytest.param(name, True, marks=[pytest.mark.slow] * (name not in BOTH))
            for name in TERMS
        ),
    ],
)
def test_bounds_hold_at_the_limit(mechanism, painted):
    for steps in (1, 50):
        low, high = _range_after(
            mechanism, share=1.0, painted=painted, dtype="float64", steps=steps
        )
        assert low >= 300.0 - 1e-9
        assert high <= 400.0 + 1e-9


def test_bounds_hold_in_float32():
    low, high = _range_after(
        "convection", share=1.0, painted=False, dtype="float32", steps=50
    )
    assert low >= 300.0 - 3e-5
    assert high <= 400.0 + 3e-5


@pytest.mark.parametrize(
    ("mechanism", "painted"),
    [
        *((name, painted) for name in BOTH for painted in (False, True)),
        ("fixed", False),
        pytest.param("fixed", True, marks=pytest.mark.slow),
    ],
)
def test_bounds_break_just_above_the_limit(mechanism, painted):
    low, high = _range_after(
        mechanism, share=1.05, painted=painted, dtype="float64", steps=1
    )
    print(mechanism, painted, "overshoot", 300.0 - low, high - 400.0)
    assert max(300.0 - low, high - 400.0) > 1.0


def test_far_above_the_limit_it_blows_up():
    low, high = _range_after(
        "insulated", share=1.3, painted=False, dtype="float64", steps=100
    )
    assert high - low > 1e6
