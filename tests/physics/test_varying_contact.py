"""Contacts of bodies with k(T): steady heat by Kirchhoff's transform, and derivatives.

Through two walls of length L that touch with a conductance h_c flow

    q'' = (F_a(T_hot) - F_a(T_1)) / L = h_c (T_1 - T_2) = (F_b(T_2) - F_b(T_cold)) / L.

Source: Carslaw and Jaeger, Conduction of Heat in Solids (1959), section 1.6.
"""

import functools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.integrate.heat_rates import pair_conductance, pair_nodes
from jaxthermo.material.material import Property
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import blocks, body_at
from tests.slopes import check_gradient


COLD = 300.0
HOT = 400.0
PITCH = 0.01
AREA = PITCH**2
LEFT = jt.Side((-1.0, 0.0, 0.0), body=0)
RIGHT = jt.Side((1.0, 0.0, 0.0), body=1)
RISING = (1.0, 20.0)
FALLING = (20.0, 1.0)
CONSTANT = (5.0, 5.0)
ENDS = (jt.FixedTemperature(HOT, on=LEFT), jt.FixedTemperature(COLD, on=RIGHT))


def _material(values):
    k = Property([COLD, HOT], values)
    return jt.Material(k, density=2000.0, specific_heat=500.0)


def _integral(values, kelvin):
    """F = integral of k(T) from 300 K [W/m]."""
    above = kelvin - COLD
    return values[0] * above + (values[1] - values[0]) / (HOT - COLD) * above**2 / 2


def _flux(values, length, h_c):
    """Heat flux [W/m^2] and temperatures of both faces [K], by bisection."""

    def temperature(values, integral):
        low, high = COLD, HOT
        for _ in range(200):
            middle = (low + high) / 2
            is_low = _integral(values, middle) < integral
            low, high = (middle, high) if is_low else (low, middle)
        return (low + high) / 2

    low = 0.0
    high = max(_integral(side, HOT) for side in values) / length
    for _ in range(200):
        flux = (low + high) / 2
        first = temperature(values[0], _integral(values[0], HOT) - flux * length)
        second = temperature(values[1], flux * length)
        low, high = (flux, high) if flux / h_c < first - second else (low, flux)
    return flux, first, second


@functools.cache
def _grid(cells):
    return blocks(np.ones((cells, 1, 1), bool), PITCH)


def _scene(
    materials, h_c, terms=ENDS, cells=1, starts=(350.0, 330.0), dtype: Dtype = "float64"
):
    """Two bars of some cells, end to end."""
    bodies = tuple(
        body_at(_grid(cells), material, start, at=(x, 0.0, 0.0))
        for material, start, x in zip(
            materials, starts, (0.0, cells * PITCH), strict=True
        )
    )
    return jt.Scene(bodies, (jt.Contact(h_c), *terms), dtype=dtype)


def _face(solution, body, sign):
    normal = solution.surfaces[body].geometry.fragment_normal
    return float(solution.of_body(body)[-1][normal[:, 0] * sign > 0.9][0])


def _axes(values):
    """An orthotropic material of which x is normal to the contact."""
    return jt.Material((Property([COLD, HOT], values), 3.0, 7.0), 2000.0, 500.0)


def _check_steady(values, h_c, materials):
    flux, first, second = _flux(values, PITCH, h_c)
    solution = jt.steady(_scene(materials, h_c), tolerance=1e-10)
    rate = float(solution.heat_rates.contacts["contact 0-1"])
    assert_allclose(rate, flux * AREA, rtol=1e-9)
    assert_allclose(_face(solution, 0, 1.0), first, atol=1e-6)
    assert_allclose(_face(solution, 1, -1.0), second, atol=1e-6)
    assert abs(float(solution.heat_rates.residual_relative)) < 1e-9
    # Newton's method with the exact Jacobian.
    effort = solution.run.statistics
    assert effort is not None
    assert effort.newton_iterations <= 7


@pytest.mark.parametrize("values", [(RISING, RISING), (RISING, FALLING)])
@pytest.mark.parametrize("h_c", [1500.0, 30.0])
def test_steady_heat_through_a_contact_is_exact_with_one_cell_a_body(values, h_c):
    _check_steady(values, h_c, [_material(k) for k in values])


@pytest.mark.slow
def test_a_bonded_body_with_constant_conductivity_conducts_exactly():
    constant = jt.Material(CONSTANT[0], density=2000.0, specific_heat=500.0)
    _check_steady((FALLING, CONSTANT), np.inf, [_material(FALLING), constant])


@pytest.mark.slow
def test_contacts_conduct_along_their_axis_of_an_orthotropic_body():
    _check_steady((RISING, FALLING), 1500.0, [_axes(RISING), _material(FALLING)])


def _compiled(values, h_c, dtype: Dtype = "float64"):
    scene = _scene([_material(k) for k in values], h_c, terms=(), dtype=dtype)
    return compile_scene(scene, 1, 1.0, save_times=(1.0,))


def _rows(compiled, count=200):
    """The contact, its nodes, and rows of temperatures above the references [K]."""
    (links,) = compiled.program.contacts
    nodes = pair_nodes(compiled.program, links, compiled.state)
    kelvin = np.random.default_rng(3).uniform(COLD - 40, HOT + 40, (count, 2, 1))
    # Also equal and nearly equal temperatures.
    kelvin[:4, 1] = kelvin[:4, 0] + np.array([0.0, 1e-3, -1e-5, 1.0])[:, None]
    above = kelvin - np.reshape(nodes.references, (1, 2, 1))
    return links, nodes, jnp.asarray(above, links.area.dtype)


def _heat(links, nodes, theta):
    time = jnp.zeros((), links.area.dtype)
    return links.heat(time, nodes._replace(theta=tuple(theta)))


def _rate(links, nodes, theta):
    return _heat(links, nodes, theta).rate.sum()


# One program for all contacts of one type of numbers.
@eqx.filter_jit
def _heats(links, nodes, rows):
    return jax.vmap(lambda theta: _heat(links, nodes, theta))(rows)


@eqx.filter_jit
def _slopes(links, nodes, rows):
    return jax.vmap(jax.grad(lambda theta: _rate(links, nodes, theta)))(rows)


@eqx.filter_jit
def _tangent_slopes(links, nodes, rows):
    def slopes(theta):
        time = jnp.zeros(())
        tangent = links.tangent(time, nodes._replace(theta=tuple(theta)))
        conductance = pair_conductance(tangent.links, time)
        first, second = tangent.ratio
        return jnp.stack([conductance * first, -conductance * second])

    return jax.vmap(slopes)(rows)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("h_c", [1e-3, 1500.0, 1e7, np.inf])
def test_one_heat_rate_passes_both_half_cells_and_the_contact(h_c, dtype):
    links, nodes, rows = _rows(_compiled((RISING, FALLING), h_c, dtype))
    assert nodes.varying is not None
    heat = _heats(links, nodes, rows)
    rate = np.asarray(heat.rate)
    flat = nodes._replace(theta=(rows[:, 0, 0], rows[:, 1, 0]))
    difference = np.asarray(flat.difference)[:, None]
    assert (rate[difference == 0] == 0).all()
    assert (rate * difference >= 0).all()
    rounding = 50 * np.finfo(dtype).eps
    for side, sign in ((0, -1), (1, 1)):
        excess = heat.excess[side]
        mean = jax.vmap(nodes.varying[side].mean)(rows[:, side], rows[:, side] + excess)
        half_cell = float(links.ends[side].half_cell[0])
        through = sign * half_cell * mean * excess
        # A face is known to the rounding of its temperature.
        off = half_cell * 20 * rounding * 100
        assert_allclose(through, rate, rtol=rounding * 100, atol=off)
    gap = difference + np.asarray(heat.excess[0] - heat.excess[1])
    assert_allclose(gap, rate / (h_c * AREA), rtol=0, atol=400 * rounding)


@pytest.mark.parametrize("h_c", [0.0, 1500.0, np.inf])
def test_derivatives_of_a_contact_are_those_of_its_linear_links(h_c):
    links, nodes, rows = _rows(_compiled((RISING, FALLING), 1.0))
    # A scene would leave out an insulating contact.
    links = replace(links, conductance=jnp.asarray(h_c))
    exact = _tangent_slopes(links, nodes, rows)
    gradients = _slopes(links, nodes, rows)
    assert_allclose(gradients, exact, rtol=1e-9, atol=1e-12)
    step = 1e-4
    for side in range(2):
        move = step * np.eye(2)[side][None, :, None]
        differences = (
            _heats(links, nodes, rows + move).rate
            - _heats(links, nodes, rows - move).rate
        ) / (2 * step)
        assert_allclose(exact[:, side], differences, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("values", [(RISING, FALLING), (FALLING, RISING)])
@pytest.mark.parametrize("h_c", [300.0, np.inf])
def test_the_stable_step_bounds_every_slope_of_a_contact(values, h_c):
    compiled = _compiled(values, h_c)
    links, nodes, rows = _rows(compiled)
    slopes = _slopes(links, nodes, rows)
    capacity = 2000.0 * 500.0 * PITCH**3
    stable = capacity / np.abs(np.asarray(slopes)).max()
    step = float(compiled.stable_step)
    assert step <= stable
    # The ratio of k at the node and at its face is bounded by that of its extremes.
    assert step >= stable / 6


@pytest.mark.parametrize(
    ("solver", "dtype"),
    [
        ("explicit", "float32"),
        pytest.param("explicit", "float64", marks=pytest.mark.slow),
        pytest.param("implicit", "float32", marks=pytest.mark.slow),
        pytest.param("implicit", "float64", marks=pytest.mark.slow),
    ],
)
def test_no_heat_is_lost_and_no_temperature_leaves_its_bounds(solver, dtype):
    materials = [_material(RISING), _material(FALLING)]
    scene = _scene(
        materials, np.inf, terms=(), cells=3, starts=(HOT, COLD), dtype=dtype
    )
    compiled = compile_scene(scene, 1, 400.0, save_times=(400.0,))
    solvers = {
        "explicit": jt.ForwardEuler(dt=float(compiled.stable_step)),
        "implicit": jt.BackwardEuler(dt=20.0),
    }
    times = [20.0, 100.0, 400.0]
    solution = jt.simulate(scene, 400.0, times, solver=solvers[solver])
    surface = np.asarray(solution.surface_temperature)
    assert surface.min() >= COLD - 1e-3
    assert surface.max() <= HOT + 1e-3
    energy = solution.energy
    first, second = (np.asarray(body.stored_J) for body in energy.bodies)
    passed = np.asarray(energy.contacts["contact 0-1"])
    exact = 1e-12 if dtype == "float64" else 1e-5
    assert_allclose(first, -passed, rtol=exact)
    assert_allclose(second, passed, rtol=exact)


def test_an_insulating_contact_has_the_slope_of_its_conductance():
    links, nodes, rows = _rows(_compiled((RISING, FALLING), 1.0))

    def rate(h_c):
        return _rate(replace(links, conductance=h_c), nodes, rows[10])

    value, slope = jax.value_and_grad(rate)(jnp.zeros(()))
    assert value == 0
    difference = float(nodes._replace(theta=tuple(rows[10])).difference[0])
    assert_allclose(slope, AREA * difference, rtol=1e-12)


@pytest.mark.slow
def test_derivatives_of_a_run_by_conductivity_contact_and_start():
    def mean(values):
        k, h_c, start = values
        rising = jt.Material(
            Property([COLD, HOT], jnp.stack([k, 20.0 * k])), 2000.0, 500.0
        )
        scene = _scene(
            (rising, _material(FALLING)), h_c, terms=(), starts=(start, COLD)
        )
        solution = jt.simulate(scene, 20.0, solver=jt.ForwardEuler(dt=1.0))
        return (
            solution.surface_temperature[-1].mean() + solution.mean_temperature[-1, 1]
        )

    check_gradient(
        mean, [1.0, 1500.0, HOT], step=[1e-4, 0.1, 1e-3], rtol=1e-6, atol=1e-12
    )
