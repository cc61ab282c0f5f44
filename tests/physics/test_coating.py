"""Emissivity and absorptivity of parts of a surface."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.integrate.heat_rates import evaluate_rates
from jaxthermo.scene.compile.bodies import surface_property
from jaxthermo.scene.compile.compile import compile_scene


RATES = eqx.filter_jit(evaluate_rates)
GRID = jt.voxelize(jt.shapes.box((0.03, 0.04, 0.05)), 0.01)
METAL = jt.Material(1e9, 2000.0, 500.0, emissivity=0.3, absorptivity=0.5)
TOP = jt.Side((0.0, 0.0, 1.0))
TERMS = (jt.Surroundings(300.0), jt.Sun((0.0, 0.0, -1.0), 1000.0))
NET = 5.670374419e-8 * (300.0**4 - 400.0**4)


def body_of(*coatings, material: Any = METAL):
    structure = jt.FullVolume(GRID)
    return jt.Body(structure, material, temperature=400.0, coatings=coatings)


def rates(*coatings):
    """Heat rates of emission and of the sun at the start [W]."""
    scene = jt.Scene((body_of(*coatings),), TERMS, dtype="float64")
    compiled = compile_scene(scene)
    zero = jnp.zeros((), float)
    return RATES(compiled.program, compiled.state, zero)[1]


def test_a_coating_replaces_what_is_below():
    area = GRID.fragment_area.sum()
    lit = 0.03 * 0.04
    painted = rates(jt.Coating(0.95, on=TOP))
    emitting = 0.3 * (area - lit) + 0.95 * lit
    assert painted == pytest.approx([emitting * NET, 0.95 * lit * 1000.0], rel=1e-6)
    # White paint, over all of it; then a mirror on top of the paint.
    mirror = jt.Coating(0.0, absorptivity=0.1, on=TOP | jt.Side((1.0, 0.0, 0.0)))
    white = rates(jt.Coating(0.9, absorptivity=0.2), mirror)
    emitting = 0.9 * (area - lit - 0.04 * 0.05)
    assert white == pytest.approx([emitting * NET, 0.1 * lit * 1000.0], rel=1e-6)
    # An absorptivity alone leaves the emissivity of the material.
    dark = rates(jt.Coating(absorptivity=1.0))
    assert dark == pytest.approx([0.3 * area * NET, lit * 1000.0], rel=1e-6)


def test_a_finish_is_a_coating_with_its_numbers():
    area = GRID.fragment_area.sum()
    lit = 0.03 * 0.04
    silver = rates(jt.Coating.of_finish("car paint, silver", on=TOP))
    emitting = 0.3 * (area - lit) + 0.79 * lit
    assert silver == pytest.approx([emitting * NET, 0.43 * lit * 1000.0], rel=1e-6)


def test_each_fragment_may_have_its_own_and_so_may_materials():
    emissivity = np.linspace(0.0, 1.0, len(GRID.fragment_area))
    coated = rates(jt.Coating(emissivity, absorptivity=0.0))
    assert coated[0] == pytest.approx(
        (emissivity * GRID.fragment_area).sum() * NET, 1e-6
    )
    half = jt.Region((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    materials = jt.MaterialMap(METAL, ((half, jt.Material(1e9, 2000.0, 500.0, 0.7)),))
    top = GRID.fragment_normal[:, 2] > 0.9
    upper = GRID.fragment_position[:, 2] >= 0
    expected = np.where(top, 0.5, np.where(upper, 0.7, 0.3))
    body = body_of(jt.Coating(0.5, on=TOP), material=materials)
    assert_allclose(surface_property(body, "emissivity", float), expected)


def test_the_surface_of_a_solution_has_it():
    body = body_of(jt.Coating(0.9, on=TOP))
    (surface,) = compile_scene(jt.Scene((body,), TERMS)).surfaces
    top = TOP.select(GRID.fragment_centres)
    assert_allclose(surface.emissivity, np.where(top, 0.9, 0.3), rtol=1e-7)
    assert_allclose(surface.absorptivity, np.where(top, 0.9, 0.5), rtol=1e-7)


def test_its_gradient_is_that_of_a_finite_difference():
    # One program for the slope and both ends of the difference.
    heat = jax.jit(
        jax.value_and_grad(lambda value: rates(jt.Coating(value, on=TOP))[0])
    )
    (low, slope) = heat(0.75)
    (high, _) = heat(0.85)
    assert float(slope) == pytest.approx(float(high - low) / 0.1, rel=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: jt.Coating(), "give an emissivity, an absorptivity, or both"),
        (lambda: jt.Coating(1.5), r"Coating\(emissivity=\): give a number from 0 to 1"),
        (lambda: jt.Coating("white"), "give a number from 0 to 1"),
        (lambda: jt.Coating(0.5, [0.2, -0.1]), r"Coating\(absorptivity=\): give"),
        (lambda: rates(jt.Coating([0.5, 0.6])), "2 values for a body of 94 fragments"),
        (
            lambda: rates(jt.Coating(0.5, on=TOP & ~TOP)),
            r"^bodies\[0\]: coatings\[0\]: Coating\(on=.* selects no surface",
        ),
    ],
)
def test_a_mistake_is_one_line(make, message):
    with pytest.raises(jt.InputError, match=message):
        make()
