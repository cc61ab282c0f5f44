"""Net emission eps sigma (T_s^4 - T^4): V14, S08, S09, S18."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.physics.flux_law import bound
from jaxthermo.physics.radiation.emission import _Emission
from jaxthermo.physics.surface_energy_balance import SurfaceTerms
from jaxthermo.reference.radiation import radiation_temperature
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import bar, single_body_scene


AREA = 0.06
CAPACITY = 2430.0
ALUMINIUM = jt.Material(
    conductivity=1e9, density=2700.0, specific_heat=900.0, emissivity=0.9
)
"""Without resistance inside: the whole cube has one temperature."""


@pytest.fixture(scope="module")
def voxel():
    return jt.FullVolume(bar(1, 0.1))


def _scene(voxel, start, surroundings, dtype: Dtype = "float64", material=ALUMINIUM):
    return single_body_scene(
        voxel,
        material,
        start,
        jt.Surroundings(surroundings),
        dtype=dtype,
        allow_extreme_temperatures=True,
    )


@pytest.mark.parametrize(
    "dtype", ["float64", pytest.param("float32", marks=pytest.mark.slow)]
)
def test_cube_cools_from_a_thousand_kelvin(voxel, dtype):
    times = [60.0, 300.0, 600.0, 1800.0, 3600.0]
    solution = jt.simulate(
        _scene(voxel, start=1000.0, surroundings=300.0, dtype=dtype),
        3600.0,
        times,
        solver=jt.ForwardEuler(0.25),
    )
    exact = radiation_temperature(
        np.array(times), initial=1000.0, surroundings=300.0, capacity=CAPACITY,
        area=AREA, emissivity=0.9,
    )  # fmt: skip
    mean = np.asarray(solution.mean_temperature)[:, 0]
    listed = [934.667745, 778.764437, 677.388833, 513.013603, 425.566551]
    assert_allclose(exact, listed, atol=1e-6)
    assert_allclose(mean, exact, atol=0.1)


def test_stable_step_is_that_of_the_hottest_surface(voxel):
    solution = jt.simulate(_scene(voxel, 1000.0, 300.0), 0.0)
    slope = 4 * 0.9 * STEFAN_BOLTZMANN * AREA * 1000.0**3
    assert solution.run.stable_step == pytest.approx(CAPACITY / slope, rel=1e-6)


def test_no_heat_flows_between_equals(voxel):
    def heat(surroundings):
        scene = _scene(voxel, 350.0, surroundings)
        energy = jt.simulate(scene, 2.0, solver=jt.ForwardEuler(1.0)).energy
        return energy.mechanisms["emission"][0]

    assert float(heat(350.0)) == 0.0
    _, slope = jax.jit(lambda t: jax.jvp(heat, (t,), (jnp.ones_like(t),)))(350.0)
    rate = 4 * 0.9 * STEFAN_BOLTZMANN * AREA * 350.0**3
    exact = rate + rate * (1 - rate / CAPACITY)
    assert float(slope) == pytest.approx(exact, rel=1e-7)
    assert float(jax.jit(jax.grad(heat))(350.0)) == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize(
    ("dtype", "surroundings"),
    [("float64", 0.0), pytest.param("float32", 300.0, marks=pytest.mark.slow)],
)
def test_zero_kelvin_is_no_singularity(voxel, surroundings, dtype):
    def mean(start):
        scene = _scene(voxel, start=start, surroundings=surroundings, dtype=dtype)
        solution = jt.simulate(scene, 10.0, solver=jt.ForwardEuler(1.0))
        return solution.mean_temperature[0, 0]

    value, slope = jax.jit(lambda t: jax.jvp(mean, (t,), (jnp.ones_like(t),)))(0.0)
    gained = 10 * STEFAN_BOLTZMANN * 0.9 * AREA / CAPACITY * surroundings**4
    assert float(value) == pytest.approx(gained, rel=1e-6)
    assert float(slope) == pytest.approx(1.0, rel=1e-5)
    assert float(jax.jit(jax.grad(mean))(0.0)) == pytest.approx(1.0, rel=1e-5)


def test_a_millikelvin_in_float32(voxel):
    compiled = compile_scene(
        _scene(voxel, start=300.0, surroundings=300.0, dtype="float32")
    )
    terms = compiled.program.fragment_terms
    above = jnp.full(terms.half_cell.shape, 1e-3, jnp.float32)
    ((_, emission),) = terms.natural
    heat = eqx.filter_jit(emission.heat_rate)(jnp.float32(0.0), above).sum()
    exact = 0.9 * STEFAN_BOLTZMANN * AREA * (300.0**4 - 300.001**4)
    assert float(heat) == pytest.approx(exact, rel=3e-6)


@eqx.filter_jit
def _heat(surface, time, theta):
    return surface.heat(time, theta)


@eqx.filter_jit
def _heat_and_excess(surface, time, theta):
    return surface.heat(time, theta), surface.surface_excess(time, theta)


def _radiating_wall(cells):
    """NAFEMS T2 (V20a): the temperature of the end that radiates, in balance [K].

    The other end of the bar is held at 1000 K; the surroundings are at 300 K.
    """
    grid = bar(cells, 0.1 / cells)
    material = jt.Material(55.6, density=1e3, specific_heat=1e2, emissivity=0.98)
    scene = single_body_scene(grid, material, 1000.0, jt.Surroundings(300.0))
    surface = compile_scene(scene).program.fragment_terms
    node = 1000.0
    flux = 0.0
    for _ in range(200):
        theta = np.full(surface.half_cell.shape, node - 1000.0)
        rates, _ = _heat(surface, np.array(0.0), theta)
        flux = float(np.asarray(rates)[0]) / float(grid.fragment_area[0])
        node = 1000.0 + flux / 55.6 * (0.1 - grid.pitch / 2)
    return node + flux * grid.pitch / (2 * 55.6)


def test_a_radiating_wall_is_exact_at_any_pitch():
    """V20a (NAFEMS T2): the surface between node and surroundings is solved for."""
    surface = np.array([_radiating_wall(cells) for cells in (2, 4, 8)])
    assert_allclose(surface, 927.00395, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("k", "ambient"), [(0.05, 600.0), (0.2, 3000.0), (16.0, 5800.0), (0.05, 0.0)]
)
def test_surface_settles_between_node_and_surroundings(k, ambient):
    """A node at 300 K under half a cell of 2.5 mm, against bisection."""
    half = 2 * k / 0.005
    strength = 0.9 * STEFAN_BOLTZMANN
    low = min(300.0, ambient)
    high = max(300.0, ambient)
    for _ in range(200):
        middle = (low + high) / 2
        excess = strength * (ambient**4 - middle**4) - half * (middle - 300.0)
        low, high = (middle, high) if excess > 0 else (low, middle)
    exact = half * (low - 300.0)
    law = _Emission(temperature=jnp.asarray(ambient), reference=jnp.asarray(290.0))
    term = bound(jnp.full(1, 0.9), law)
    surface = SurfaceTerms(
        names=("emission",),
        half_cell=jnp.full(1, half),
        natural=((0, term),),
        prescribed=(),
    )
    above = np.full(1, 10.0)
    (rate, _), excess = _heat_and_excess(surface, np.array(0.0), above)
    assert float(rate[0]) == pytest.approx(exact, rel=1e-6)
    assert float(excess[0]) == pytest.approx(low - 300.0, rel=1e-6)
