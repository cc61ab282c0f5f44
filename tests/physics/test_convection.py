"""Newton's law: the lumped body (Bi -> 0), and the slab series (V04) at order 2."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.reference.slab import slab_convection
from tests.bodies import bar, depth, on_top, single_body_scene
from tests.shallow import SHALLOW


CONDUCTIVITY = 1.0
SOLID = jt.Material(conductivity=CONDUCTIVITY, density=1000.0, specific_heat=1000.0)
NO_RESISTANCE = jt.Material(conductivity=1e9, density=1000.0, specific_heat=1000.0)
HALF_THICKNESS = 0.1
FRONT = jt.Side(normal=(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def voxel():
    return bar(1, 0.1)


def _cooled_voxel(voxel, material, t1, dt):
    term = jt.Convection(50.0, 300.0)
    scene = single_body_scene(voxel, material, 400.0, term)
    solution = jt.simulate(scene, t1, solver=jt.ForwardEuler(dt=dt))
    return float(solution.mean_temperature[0, 0])


def test_lumped_body_cools_exponentially(voxel):
    time_constant = 1e6 * 1e-3 / (50.0 * 0.06)
    exact = 300.0 + 100.0 * np.exp(-1.0)
    errors = [
        _cooled_voxel(
            voxel, material=NO_RESISTANCE, t1=time_constant, dt=time_constant / n
        )
        - exact
        for n in (100, 200)
    ]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.02)
    assert 2 * errors[1] - errors[0] == pytest.approx(0.0, abs=2e-3)


@SHALLOW
def test_half_a_cell_is_in_series_with_the_fluid(voxel):
    coefficient = 1 / (1 / 50.0 + 0.05 / 1.0)
    dt = 10.0
    exact = 300.0 + 100.0 * (1 - dt * coefficient * 0.06 / 1e3) ** 100
    assert _cooled_voxel(voxel, material=SOLID, t1=1000.0, dt=dt) == pytest.approx(
        exact, abs=1e-10
    )


def _slab(cells, biot=1.0, fourier=0.2):
    grid = bar(cells, HALF_THICKNESS / cells)
    h = biot * CONDUCTIVITY / HALF_THICKNESS
    # From 1 to 0, the temperatures of the closed form.
    scene = single_body_scene(
        grid,
        SOLID,
        1.0,
        jt.Convection(h, 0.0, on=FRONT),
        allow_extreme_temperatures=True,
    )
    end = float(fourier * HALF_THICKNESS**2 / SOLID.diffusivity)
    # At a cell Fourier number of 1/8 the error in time falls with that in space.
    step = (HALF_THICKNESS / cells) ** 2 / (8 * SOLID.diffusivity)
    solution = jt.simulate(scene, end, solver=jt.ForwardEuler(dt=step))
    temperature = np.asarray(solution.surface_temperature)[0, on_top(grid)]
    exact = slab_convection(depth(grid) / HALF_THICKNESS, fourier, biot)
    return np.abs(temperature - exact).max()


@pytest.fixture(scope="module")
def slab_errors():
    return [_slab(cells) for cells in (10, 20, 40)]


def test_slab_follows_its_series(slab_errors):
    assert slab_errors[1] < 2e-3


def test_slab_converges_at_second_order(slab_errors):
    orders = np.log2(np.array(slab_errors[:-1]) / slab_errors[1:])
    assert_allclose(orders, 2.0, atol=0.1)


# By default half cells conduct at any Biot number: test_linear_load.
@pytest.mark.slow
def test_large_biot_is_a_fixed_surface_temperature():
    grid = bar(10, 0.01)
    body = jt.Body(jt.FullVolume(grid), SOLID, temperature=400.0)
    means = [
        jt.simulate(
            jt.Scene((body,), (term,), dtype="float64"),
            2000.0,
            solver=jt.ForwardEuler(),
        )
        for term in (
            jt.Convection(1e8 * CONDUCTIVITY / 0.1, 300.0, on=FRONT),
            jt.FixedTemperature(300.0, on=FRONT),
        )
    ]
    assert_allclose(
        means[0].surface_temperature, means[1].surface_temperature, atol=1e-5
    )
    assert float(means[0].mean_temperature[0, 0]) < 390.0


def test_coefficient_that_depends_on_time(voxel):
    ramp = jt.Table([0.0, 1000.0], [0.0, 100.0])
    scene = single_body_scene(voxel, NO_RESISTANCE, 400.0, jt.Convection(ramp, 300.0))
    dt = 5.0
    steps = 200
    solution = jt.simulate(scene, 1000.0, solver=jt.ForwardEuler(dt=dt))
    # The coefficient is taken at the middle of each step.
    h = 0.1 * dt * (np.arange(steps) + 0.5)
    exact = 300.0 + 100.0 * np.prod(1 - dt * h * 0.06 / 1e3)
    assert float(solution.mean_temperature[0, 0]) == pytest.approx(exact, rel=1e-9)
