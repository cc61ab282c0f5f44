"""`steady`: closed forms, the end of long runs, islands, bad scenes and derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.material.material import Property
from tests.bodies import blocks


PITCH = 0.01
METAL = jt.Material(20.0, density=2000.0, specific_heat=500.0, emissivity=0.8)
VARYING = jt.Material(
    Property([250.0, 450.0], [10.0, 30.0]),
    2000.0,
    Property([250.0, 450.0], [400.0, 900.0]),
    emissivity=0.8,
)
LEFT = jt.Side((-1.0, 0.0, 0.0))
RIGHT = jt.Side((1.0, 0.0, 0.0))
AIR = jt.Convection(20.0, 290.0)
SKY = jt.Surroundings(280.0)
EXACT = {"float64": 1e-9, "float32": 2e-3}


@functools.cache
def _grid(*shape):
    return blocks(np.ones(shape, bool), PITCH)


def _body(start=300.0, material=METAL, x=0.0, shape=(6, 3, 3), structure=jt.FullVolume):
    pose = jt.Pose(translation=(x, 0.0, 0.0))
    return jt.Body(structure(_grid(*shape)), material, temperature=start, pose=pose)


def _along(solution, body=0):
    """Temperature of a body's side +z, by x [m], [K]."""
    grid = solution.surfaces[body].geometry
    top = np.flatnonzero(grid.fragment_normal[:, 2] > 0.9)
    x = grid.fragment_position[top, 0]
    return x, np.asarray(solution.of_body(body)[0])[top]


# By default a wall of two layers is exact in test_probes, one in reference/.
@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(
    "structure", [jt.FullVolume, functools.partial(jt.FullVolume, stencil=False)]
)
def test_a_bar_between_two_temperatures_is_a_straight_line(structure, dtype):
    terms = (jt.FixedTemperature(400.0, on=LEFT), jt.FixedTemperature(300.0, on=RIGHT))
    solution = jt.steady(jt.Scene((_body(structure=structure),), terms, dtype=dtype))
    x, theta = _along(solution)
    exact = 400.0 - 100.0 * x / (6 * PITCH)
    assert np.abs(theta - exact).max() < EXACT[dtype]
    # k A / L times the difference comes in on the one side, and goes out again.
    through = 20.0 * (3 * PITCH) ** 2 / (6 * PITCH) * 100.0
    sides = [float(rate) for rate in solution.heat_rates.mechanisms.values()]
    np.testing.assert_allclose(sides, [through, -through], rtol=1e-5)
    assert abs(float(solution.heat_rates.residual_relative)) < 1e-5
    assert solution.result == jt.RESULTS.successful
    assert solution.isolated_components == 0


def test_conductivity_that_varies_makes_its_integral_a_straight_line():
    terms = (jt.FixedTemperature(440.0, on=LEFT), jt.FixedTemperature(260.0, on=RIGHT))
    solution = jt.steady(jt.Scene((_body(material=VARYING),), terms, dtype="float64"))
    x, theta = _along(solution)

    def phi(t):
        return 10.0 * (t - 250.0) + 0.05 * (t - 250.0) ** 2

    exact = phi(440.0) + (phi(260.0) - phi(440.0)) * x / (6 * PITCH)
    np.testing.assert_allclose(phi(theta), exact, rtol=0, atol=1e-9 * np.ptp(exact))


PEAK = Property([310.0, 320.0, 330.0], [1.0, 20.0, 1.0])
DIP = Property([310.0, 320.0, 330.0], [20.0, 1.0, 20.0])
# Table of oxygen-free copper, residual resistance ratio 100.
COPPER = jt.Material(
    Property([4, 10, 20, 40, 80, 150, 300], [630, 1540, 2430, 1470, 560, 428, 398]),
    8960.0,
    Property(
        [4, 10, 20, 40, 80, 150, 300], [0.09, 0.9, 7.3, 59.0, 203.0, 313.0, 386.0]
    ),
)


def _integral(prop, kelvin):
    """Integral of a property from 0 K, by trapezoids on a fine grid."""
    fine = np.linspace(0.0, 500.0, 500_001)
    values = np.interp(fine, prop.temperatures, prop.values)
    integrals = np.concatenate(
        [[0.0], np.cumsum(np.diff(fine) * (values[1:] + values[:-1]) / 2)]
    )
    return np.interp(kelvin, fine, integrals)


@pytest.mark.parametrize(
    ("material", "ends"),
    [
        (jt.Material(PEAK, 2000.0, 500.0), (300.0, 400.0)),
        pytest.param(COPPER, (4.0, 300.0), marks=pytest.mark.slow),
        pytest.param(
            jt.Material((PEAK, DIP, 1.0), 2000.0, 500.0),
            (300.0, 400.0),
            marks=pytest.mark.slow,
        ),
    ],
)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_peak_of_the_conductivity_is_passed_from_any_start(material, ends, dtype):
    low, high = ends
    fixed = jt.FixedTemperature(low, on=LEFT), jt.FixedTemperature(high, on=RIGHT)
    k = material.conductivity
    k = k[0] if isinstance(k, tuple) else k
    flows = _integral(k, high) - _integral(k, low)
    for start in np.linspace(low, high, 3):
        body = _body(start, material)
        scene = jt.Scene(
            (body,), fixed, dtype=dtype, allow_extreme_temperatures=low < 150
        )
        solution = jt.steady(scene)
        x, theta = _along(solution)
        expected = flows * x / (6 * PITCH)
        actual = _integral(k, theta) - _integral(k, low)
        accuracy = {"float64": 1e-7, "float32": 1e-3}[dtype]
        np.testing.assert_allclose(actual, expected, rtol=0, atol=accuracy * flows)
        rate = float(solution.heat_rates.residual_relative)
        assert abs(rate) < {"float64": 1e-9, "float32": 1e-4}[dtype]


def test_half_a_cell_has_the_mean_conductivity_between_node_and_surface():
    """Two cells in which k changes twentyfold: fixed below, air and flux above."""
    k = Property([300.0, 400.0], [1.0, 20.0])
    body = _body(350.0, jt.Material(k, 2000.0, 500.0), shape=(2, 1, 1))
    h = 50.0
    terms = (
        jt.FixedTemperature(300.0, on=LEFT),
        jt.Convection(h, 420.0, on=RIGHT),
        jt.HeatFlux(2000.0, on=RIGHT),
    )
    solution = jt.steady(jt.Scene((body,), terms, dtype="float64"))
    grid = solution.surfaces[0].geometry
    side = np.flatnonzero(grid.fragment_normal[:, 0] > 0.9)
    surface = float(solution.of_body(0)[0][side[0]])
    flux = h * (420.0 - surface) + 2000.0
    conducted = (_integral(k, surface) - _integral(k, 300.0)) / (2 * PITCH)
    assert flux == pytest.approx(conducted, rel=1e-6)
    heat = float(solution.heat_rates.mechanisms["fixed_temperature"])
    assert heat == pytest.approx(-flux * PITCH**2, rel=1e-9)


@pytest.mark.slow
def test_derivatives_through_a_peak_of_the_conductivity():
    def middle(values):
        peak, left = values
        k = Property([310.0, 320.0, 330.0], jnp.stack([1.0, peak, 1.0]))
        body = _body(350.0, jt.Material(k, 2000.0, 500.0), shape=(5, 2, 2))
        fixed = jt.FixedTemperature(left, on=LEFT)
        terms = (fixed, jt.Convection(100.0, 400.0, on=RIGHT))
        solution = jt.steady(jt.Scene((body,), terms, dtype="float64"), tolerance=1e-10)
        return solution.surface_temperature.mean()

    start = jnp.array([20.0, 300.0])
    gradient = jax.jit(jax.grad(middle))(start)
    value = jax.jit(middle)
    numeric = [
        (value(start + step) - value(start - step)) / (2 * step.sum())
        for step in jnp.diag(1e-4 * start)
    ]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6)


SCENES = {
    "air, sky and sun": ((_body(400.0),), (AIR, SKY, jt.Sun((0.0, 0, -1), 900.0))),
    "varying properties": ((_body(400.0, VARYING),), (AIR, SKY)),
    "contact": (
        (_body(400.0), _body(300.0, x=6 * PITCH)),
        (jt.Contact(2000.0), jt.FixedTemperature(350.0, on=LEFT), SKY),
    ),
    "wind": ((_body(400.0),), (jt.Wind((3.0, 0.0, 0.0), 280.0), jt.HeatSource(2e5))),
    "exchange": (
        (_body(500.0), _body(300.0, x=8 * PITCH)),
        (
            jt.RadiativeExchange(300.0, max_patches=24, directions=32),
            jt.HeatSource(2e5, within=jt.Region((0.0, 0.0, 0.0), (0.02, 0.03, 0.03))),
        ),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_it_is_where_a_long_run_ends(name):
    bodies, terms = SCENES[name]
    scene = jt.Scene(bodies, terms, dtype="float64")
    solution = jt.steady(scene)
    run = jt.simulate(scene, 1e7, solver=jt.BackwardEuler(dt=5e5), throw=False)
    off = np.abs(solution.surface_temperature - run.surface_temperature[-1:]).max()
    effort = solution.run.statistics
    assert effort is not None
    print(name, "off", off, "newton", int(effort.newton_iterations))
    assert off < 1e-5
    assert abs(float(solution.heat_rates.residual_relative)) < 1e-9
    bodies = solution.heat_rates.bodies
    rates_by_body = [
        [*body.mechanisms.values(), *body.contacts.values()] for body in bodies
    ]
    passes = max(abs(float(rate)) for body in rates_by_body for rate in body)
    assert all(abs(float(sum(body))) < 1e-8 * passes for body in rates_by_body)


@pytest.mark.parametrize("start", [1e-3, pytest.param(5800.0, marks=pytest.mark.slow)])
def test_it_settles_from_any_start(start):
    options: dict = {"dtype": "float64", "allow_extreme_temperatures": True}
    solution = jt.steady(jt.Scene((_body(start),), (SKY,), **options))
    effort = solution.run.statistics
    assert effort is not None
    print(start, "newton", int(effort.newton_iterations))
    assert effort.newton_iterations <= 20
    np.testing.assert_allclose(solution.surface_temperature, 280.0, rtol=0, atol=1e-6)


def _split():
    """A block and a speck apart from it."""
    solid = np.zeros((6, 2, 2), bool)
    solid[:3] = True
    solid[5, 0, 0] = True
    return blocks(solid, PITCH)


@pytest.mark.parametrize(
    "structure",
    [
        jt.FullVolume,
        pytest.param(jt.Octree, marks=pytest.mark.slow),
        pytest.param(functools.partial(jt.Aggregate, factor=2), marks=pytest.mark.slow),
    ],
)
def test_an_island_keeps_the_mean_that_it_starts_with(structure):
    def start(points):
        return 300.0 + 1000.0 * points[:, 0]

    body = jt.Body(structure(_split()), METAL, temperature=start)
    hold = jt.Region((-1.0, -1.0, -1.0), (1e-4, 1.0, 1.0))
    scene = jt.Scene((body,), (jt.FixedTemperature(350.0, on=hold),), dtype="float64")
    solution = jt.steady(scene)
    apart = body.structure.grid.fragment_position[:, 0] > 4.5 * PITCH
    theta = np.asarray(solution.surface_temperature[0])
    assert solution.isolated_components == 1
    np.testing.assert_allclose(theta[~apart], 350.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(theta[apart], 355.0, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_two_bodies_that_only_touch_even_out():
    bodies = (_body(400.0), _body(300.0, VARYING, x=6 * PITCH))
    scene = jt.Scene(bodies, (jt.Contact(500.0),), dtype="float64")
    solution = jt.steady(scene)
    run = jt.simulate(scene, 1e7, solver=jt.BackwardEuler(dt=1e5))
    assert solution.isolated_components == 1
    theta = np.asarray(solution.surface_temperature)
    assert np.ptp(theta) < 1e-6
    np.testing.assert_allclose(theta, run.surface_temperature[-1:], rtol=0, atol=1e-5)


# By default an island keeps its mean, above.
@pytest.mark.slow
def test_heat_in_and_out_of_an_island_leaves_a_slope_about_its_mean():
    terms = (jt.HeatFlux(1000.0, on=LEFT), jt.HeatFlux(-1000.0, on=RIGHT))
    solution = jt.steady(jt.Scene((_body(320.0),), terms, dtype="float64"))
    x, theta = _along(solution)
    exact = 320.0 - 1000.0 / 20.0 * (x - 3 * PITCH)
    np.testing.assert_allclose(theta, exact, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    "dtype", ["float64", pytest.param("float32", marks=pytest.mark.slow)]
)
def test_heat_that_nothing_carries_off_is_refused(dtype):
    scene = jt.Scene((_body(),), (jt.Sun((0.0, 0, -1), 900.0),), dtype=dtype)
    with pytest.raises(jt.InputError, match=r"1\.3 W enters body 0") as caught:
        jt.steady(scene)
    assert "\n" not in str(caught.value)
    speck = jt.HeatSource(1e5, within=jt.Region((0.05, 0.0, 0.0), (0.06, 0.01, 0.01)))
    body = jt.Body(jt.FullVolume(_split()), METAL, temperature=300.0)
    start = jt.Region((-1.0, -1.0, -1.0), (1e-4, 1.0, 1.0))
    hold = jt.FixedTemperature(350.0, on=start)
    with pytest.raises(jt.InputError, match=r"7\.69 % of its capacity"):
        jt.steady(jt.Scene((body,), (hold, speck), dtype=dtype))


@pytest.mark.slow
def test_what_varies_with_time_is_held_at_a_moment():
    terms = (AIR, jt.HeatFlux(jt.Until(500.0, 30.0), on=LEFT))
    scene = jt.Scene((_body(),), terms, dtype="float64")
    with pytest.raises(jt.InputError, match="give the time whose values last"):
        jt.steady(scene)
    on, off = (jt.steady(scene, at=at) for at in (10.0, 40.0))
    constant = jt.Scene((_body(),), (AIR, jt.HeatFlux(500.0, on=LEFT)), dtype="float64")
    same = jt.steady(constant)
    np.testing.assert_array_equal(on.surface_temperature, same.surface_temperature)
    np.testing.assert_allclose(off.surface_temperature, 290.0, rtol=0, atol=1e-8)
    assert on.times.tolist() == [10.0]


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan")])
def test_a_tolerance_that_is_none_is_refused(tolerance):
    scene = jt.Scene((_body(),), (AIR,), dtype="float64")
    with pytest.raises(jt.InputError, match="give a positive one"):
        jt.steady(scene, tolerance=tolerance)


def test_what_cannot_be_reached_is_said():
    body = _body(400.0, shape=(3, 2, 2))
    scene = jt.Scene((body,), (AIR, jt.HeatFlux(1e3, on=LEFT)))
    solution = jt.steady(scene, tolerance=1e-9, throw=False)
    assert solution.result == jt.RESULTS.steady_not_converged
    assert np.isfinite(solution.surface_temperature).all()
    with pytest.raises(RuntimeError, match="give steady.. a larger tolerance"):
        jt.steady(scene, tolerance=1e-9)


START = jnp.array([1.0, 10.0, 0.9, 900.0])
"""k, h, emissivity and sun."""


def _loss(values):
    k, h, emissivity, sun = values
    material = jt.Material(
        k, density=2000.0, specific_heat=800.0, emissivity=emissivity
    )
    body = _body(300.0, material, shape=(3, 2, 2))
    terms = (jt.Sun((1.0, 0.0, 0.0), sun), jt.Convection(h, 290.0), SKY)
    solution = jt.steady(jt.Scene((body,), terms, dtype="float64"), throw=False)
    return (solution.surface_temperature**2).mean() / 1e4


@pytest.mark.slow
@pytest.mark.slice
def test_derivatives_are_those_of_the_steady_state():
    step = 1e-4
    loss = jax.jit(_loss)

    def at(i, sign):
        return loss(START.at[i].multiply(1 + sign * step))

    numeric = [
        (at(i, 1) - at(i, -1)) / (2 * step * START[i]) for i in range(len(START))
    ]
    reverse = jax.jit(jax.grad(_loss))(START)
    forward = jax.jit(jax.jacfwd(_loss))(START)
    print("reverse", reverse, "off", reverse / np.array(numeric) - 1)
    np.testing.assert_allclose(reverse, numeric, rtol=1e-6)
    np.testing.assert_allclose(forward, numeric, rtol=1e-6)


@pytest.mark.slow
def test_it_makes_a_picture():
    solution = jt.steady(jt.Scene((_body(320.0),), (AIR,)))
    centre = (0.03, 0.015, 0.015)
    camera = jt.OrthographicCamera(
        (0.03, -1.0, 0.015), centre, view_height=0.05, width=24, height=16
    )
    image = jt.render(solution, camera)
    is_body = np.asarray(image.object_id) == 0
    assert is_body.any()
    np.testing.assert_allclose(np.asarray(image.temperature)[is_body], 290.0, atol=1e-2)


@pytest.mark.slow
def test_derivatives_through_a_contact_of_bodies_whose_conductivity_varies():
    def mean(values):
        k, h = values
        bodies = [
            _body(
                t,
                jt.Material(
                    Property([250.0, 450.0], jnp.stack([a * k, 3 * k])), 2000.0, 500.0
                ),
                x,
                shape=(2, 2, 2),
            )
            for t, a, x in ((400.0, 1.0, 0.0), (300.0, 2.0, 2 * PITCH))
        ]
        hot = jt.FixedTemperature(400.0, on=jt.Side((-1.0, 0.0, 0.0), body=0))
        terms = (jt.Contact(2000.0), hot, jt.Convection(h, 290.0))
        scene = jt.Scene(tuple(bodies), terms, dtype="float64")
        return jt.steady(scene, tolerance=1e-10).surface_temperature.mean()

    start = jnp.array([1.0, 20.0])
    value = jax.jit(mean)
    numeric = [
        (value(start + step) - value(start - step)) / (2 * step.sum())
        for step in jnp.diag(1e-4 * start)
    ]
    np.testing.assert_allclose(jax.jit(jax.grad(mean))(start), numeric, rtol=1e-6)
