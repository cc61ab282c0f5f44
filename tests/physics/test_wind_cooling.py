"""C21 and the whole way of the wind: cylinders that cool in it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.physics.convection.air import kinematic_viscosity
from jaxthermo.physics.convection.cross_flow import _mean_coefficient, local_nusselt
from jaxthermo.physics.convection.nusselt import churchill_bernstein
from jaxthermo.physics.convection.wake import WakeDeficit
from jaxthermo.physics.convection.wind import Wind
from tests.bodies import joined
from tests.slopes import check_gradient


AIR = 300.0
HOT = 340.0
DIAMETER = 0.1
HEIGHT = 0.0125
SPEED = 5.0
CERAMIC = jt.Material(conductivity=8.0, density=1800.0, specific_heat=900.0)
COPPER = jt.Material(conductivity=400.0, density=8900.0, specific_heat=385.0)
WIND = Wind((SPEED, 0.0, 0.0), AIR)


@pytest.fixture(scope="module")
def grid():
    """32 voxels across, 4 high."""
    return jt.voxelize(jt.shapes.cylinder(DIAMETER / 2, HEIGHT), DIAMETER / 32)


def body(grid, material):
    return jt.Body(jt.FullVolume(grid), material, temperature=HOT)


def simulate(bodies, end, *terms):
    scene = jt.Scene(bodies, terms, dtype="float64")
    return jt.simulate(scene, end)


def _rank(values):
    return np.argsort(np.argsort(values))


@pytest.mark.slow
def test_the_order_of_side_temperatures_follows_the_local_number(grid):
    """In sectors of 15 degrees from the front to the rear, both sides together."""
    solution = simulate((body(grid, CERAMIC),), 60.0, WIND)
    side = np.abs(grid.fragment_normal[:, 2]) < 0.5
    angle = np.degrees(np.arccos(np.clip(-grid.fragment_normal[side, 0], -1, 1)))
    sector = np.minimum((angle / 15).astype(int), 11)
    temperature = np.asarray(solution.surface_temperature)[0, side]
    mean = np.bincount(sector, temperature) / np.bincount(sector)
    middle = jnp.cos(jnp.radians(jnp.asarray(7.5 + 15.0 * np.arange(12))))
    reynolds = SPEED * DIAMETER / float(kinematic_viscosity(jnp.array(AIR)))

    def constant(value):
        return jnp.full(12, value)

    local = local_nusselt(
        middle,
        reynolds=constant(reynolds),
        prandtl_number=constant(0.707),
        average=churchill_bernstein,
    )
    by_value = np.corrcoef(mean, local)[0, 1]
    by_rank = np.corrcoef(_rank(mean), _rank(local))[0, 1]
    assert by_value < -0.95 and by_rank < -0.9
    assert mean[0] < mean[11] < mean[5]


# By default the mean coefficient is that of its correlation, in unit tests; runs in
# wind are in the slice, below.
@pytest.mark.slow
def test_a_good_conductor_cools_as_the_mean_coefficient_says(grid):
    """C dT/dt = -A h(T) (T - T_air), within the fragments' quadrature."""
    end = 150.0
    solution = simulate((body(grid, COPPER),), end, WIND)
    mean = float(solution.mean_temperature[0, 0])
    area = grid.fragment_area.sum()
    capacity = COPPER.volumetric_heat_capacity * np.pi / 4 * DIAMETER**2 * HEIGHT
    speed = jnp.array(SPEED)
    diameter = jnp.array(DIAMETER)
    h = jax.jit(
        lambda t: _mean_coefficient(
            speed, diameter=diameter, film=t, average=churchill_bernstein
        )
    )
    temperature = HOT
    dt = 1.5
    for _ in range(100):

        def rate(t):
            return -area * float(h((t + AIR) / 2)) * (t - AIR) / capacity

        temperature += dt * rate(temperature + dt / 2 * rate(temperature))
    assert mean - HOT == pytest.approx(temperature - HOT, rel=0.02)
    assert temperature < HOT - 4.0


@pytest.mark.slow
def test_gradients_by_the_speed_go_through_a_run(grid):
    block = body(grid, CERAMIC)

    def mean(speed):
        wind = Wind((1.0, 0.0, 0.0), AIR, speed=speed)
        scene = jt.Scene((block,), (wind,), dtype="float64")
        solution = jt.simulate(scene, 5.0, solver=jt.ForwardEuler(dt=0.25))
        return solution.mean_temperature[0, 0]

    value_and_slope = check_gradient(mean, 2.0, step=1e-3, rtol=1e-5)
    assert float(value_and_slope(2.0)[1]) < 0


@pytest.mark.slow
def test_one_in_the_wake_of_another_cools_less_and_the_ledger_closes():
    """Two cylinders in one mesh, in gusts."""
    upstream = jt.shapes.cylinder(DIAMETER / 2, HEIGHT)
    bodies = joined(upstream, upstream.moved((3 * DIAMETER, 0.0, 0.0)))
    grid = jt.voxelize(bodies, DIAMETER / 16)
    gusts = jt.Table([0.0, 15.0, 30.0], [1.0, 9.0, 0.0])
    wind = Wind((1.0, 0.0, 0.0), AIR, speed=gusts, wake=WakeDeficit())
    solution = simulate((body(grid, CERAMIC),), 30.0, wind)
    assert abs(float(solution.energy.residual_relative[0])) < 1e-12
    rear = grid.fragment_position[:, 0] > 1.5 * DIAMETER
    loss = HOT - np.asarray(solution.surface_temperature)[0]
    first, second = (
        np.average(loss[selection], weights=grid.fragment_area[selection])
        for selection in (~rear, rear)
    )
    # Such a disc is as wide as it is high: u / U = 0.61 at x / D = 16 behind its rear,
    # and h goes with the root of that or a little more.
    assert first > 1.0 and 0.7 < second / first < 0.61**0.5 + 0.02
