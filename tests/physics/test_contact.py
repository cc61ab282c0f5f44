"""Bodies in contact: closed forms of half-spaces (V11, V12), a swap that is one."""

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.reference.semi_infinite import contact_surfaces, perfect_contact
from tests.bodies import bar, body_at
from tests.slopes import check_gradient


COPPER = jt.Material(conductivity=401.0, density=8933.0, specific_heat=385.0)
STEEL = jt.Material(conductivity=15.1, density=8055.0, specific_heat=480.0)
COLD = 273.15
STEPS = jt.ForwardEuler(dt=1e-3)


_bar = functools.cache(bar)


def _scene(contact, pitch=1e-3, cells=(165, 35), dtype: Dtype = "float64"):
    """A hot copper bar and a cold steel one, end to end at x = 0."""
    bodies = tuple(
        body_at(
            _bar(count, pitch),
            material,
            COLD + start,
            at=(side * count * pitch / 2, 0.0, 0.0),
        )
        for count, material, start, side in zip(
            cells, (COPPER, STEEL), (100.0, 0.0), (-1.0, 1.0), strict=True
        )
    )
    return jt.Scene(bodies, (contact,), dtype=dtype)


def _ends(solution, scene):
    """Surface temperatures at the faces that touch, above 273.15 K."""
    interface = []
    for index, sign in ((0, 1.0), (1, -1.0)):
        normal = scene.bodies[index].structure.grid.fragment_normal
        face = np.flatnonzero(normal[:, 0] * sign > 0.9)
        interface.append(
            np.asarray(solution.of_body(index))[:, face].mean(axis=1) - COLD
        )
    return interface


def test_bonded_half_spaces_meet_between():
    scene = _scene(jt.bonded)
    end = float((5e-3) ** 2 / STEEL.diffusivity)
    solution = jt.simulate(scene, end, [end / 2, end], solver=jt.ForwardEuler())
    first, second = (float(side[-1]) for side in _ends(solution, scene))
    exact = perfect_contact(
        100.0,
        temperature_b=0.0,
        effusivity_a=COPPER.effusivity,
        effusivity_b=STEEL.effusivity,
    )
    assert first == pytest.approx(exact, abs=0.05)
    assert second == pytest.approx(first, abs=1e-9)


def test_a_contact_conductance_holds_two_half_spaces_apart():
    scene = _scene(jt.Contact(1000.0))
    times = [1.0, 6.0]
    solution = jt.simulate(scene, times[-1], times, solver=jt.ForwardEuler())
    first, second = _ends(solution, scene)
    *exact, _ = contact_surfaces(
        np.array(times),
        temperature_a=100.0,
        temperature_b=0.0,
        effusivity_a=COPPER.effusivity,
        effusivity_b=STEEL.effusivity,
        contact_conductance=1000.0,
    )
    assert_allclose(first, exact[0], atol=0.2)
    assert_allclose(second, exact[1], atol=0.2)


@pytest.mark.parametrize(
    ("dtype", "tolerance"),
    [("float64", 1e-12), pytest.param("float32", 1e-5, marks=pytest.mark.slow)],
)
def test_what_one_loses_the_other_gains(dtype, tolerance):
    scene = _scene(jt.Contact(1000.0), cells=(10, 8), dtype=dtype)
    energy = jt.simulate(scene, 2.0, [1.0, 2.0], solver=STEPS).energy
    swapped = np.asarray(energy.contacts["contact 0-1"])
    assert swapped[-1] > 0.1
    assert_array_equal(energy.bodies[0].contacts["contact 0-1"], -swapped)
    assert_array_equal(energy.bodies[1].contacts["contact 0-1"], swapped)
    for body in energy.bodies:
        assert np.abs(body.residual_relative).max() < tolerance
    assert np.abs(energy.residual_relative).max() < tolerance


def test_no_conductance_parts_and_more_of_it_bonds():
    """S11: the limits are the thing itself."""

    def run(contact):
        return jt.simulate(
            _scene(contact, cells=(10, 8)), 2.0, [1.0, 2.0], solver=STEPS
        )

    apart, bonded, nearly = map(run, (jt.Contact(0.0), jt.bonded, jt.Contact(1e16)))
    assert_allclose(apart.mean_temperature, 2 * [[COLD + 100.0, COLD]], atol=0)
    assert_allclose(nearly.surface_temperature, bonded.surface_temperature, rtol=1e-10)
    assert float(bonded.mean_temperature[-1, 0]) < COLD + 99.0


def test_the_gradient_with_respect_to_the_conductance():
    def cold_end(conductance):
        scene = _scene(jt.Contact(conductance), cells=(10, 8))
        solution = jt.simulate(scene, 1.0, solver=jt.ForwardEuler(dt=2e-3))
        return solution.mean_temperature[0, 1]

    _scene(jt.bonded, cells=(10, 8))
    value_and_slope = check_gradient(cold_end, 1000.0, step=1e-2, rtol=1e-6)
    assert float(value_and_slope(1000.0)[0]) > COLD
    assert np.isfinite(value_and_slope(0.0)[1])


def test_boxes_in_contact_move_toward_each_other_and_apart_stay():
    """A19: two boxes of 6 cm, +80 K and -80 K about 22 C, k 200, rho 2000, c 1."""
    stuff = jt.Material(200.0, density=2000.0, specific_heat=1.0)
    grid = jt.voxelize(jt.shapes.box((0.06, 0.06, 0.06)), 0.01)

    def means(distance):
        bodies = tuple(
            body_at(
                grid, stuff, 295.15 + side * 80.0, at=(side * distance / 2, 0.0, 0.0)
            )
            for side in (1, -1)
        )
        scene = jt.Scene(bodies, (jt.Contact(1000.0),), dtype="float64")
        run = jt.simulate(scene, 0.05, solver=jt.ForwardEuler())
        return np.asarray(run.mean_temperature)[0] - 295.15

    hot, cold = means(0.06)
    assert hot < 79.0
    assert cold > -79.0
    assert_allclose(means(0.5), [80.0, -80.0], atol=0.05)
