"""Derivatives of a run: forward, reverse, finite differences, Taylor; jit and vmap."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import blocks


AT = {
    "conductivity": 16.0,
    "specific_heat": 500.0,
    "coefficient": 25.0,
    "emissivity": 0.7,
    "irradiance": 900.0,
    "start": 330.0,
    "prescribed": 350.0,
    "table": 2000.0,
}
SOLVER = jt.ForwardEuler(dt=0.5)


@pytest.fixture(scope="module")
def structure():
    return jt.FullVolume(blocks(np.ones((3, 2, 2), bool), 0.01))


@pytest.fixture(scope="module")
def outcome(structure):
    """A number that depends on all parameters, jitted once for all tests."""

    def run(p):
        material = jt.Material(
            p["conductivity"],
            density=8000.0,
            specific_heat=p["specific_heat"],
            emissivity=p["emissivity"],
        )
        body = jt.Body(structure, material, temperature=p["start"])
        terms = (
            jt.Convection(p["coefficient"], 280.0),
            jt.Surroundings(290.0),
            jt.Sun((0.3, 0.0, -1.0), jt.Until(p["irradiance"], 5.0)),
            jt.FixedTemperature(p["prescribed"], on=jt.Side((1.0, 0.0, 0.0))),
            jt.HeatFlux(
                jt.Table([0.0, 5.0], jnp.stack([0.5 * p["table"], p["table"]])),
                on=jt.Side((0.0, 1.0, 0.0)),
            ),
        )
        scene = jt.Scene((body,), terms, dtype="float64")
        solution = jt.simulate(scene, 10.0, save_at=[5.0, 10.0], solver=SOLVER)
        surface = solution.surface_temperature
        return jnp.mean(surface**2) / 300.0 + surface[0, 0]

    return jax.jit(run)


@pytest.fixture(scope="module")
def point():
    return {name: jnp.array(value) for name, value in AT.items()}


@pytest.fixture(scope="module")
def gradient(outcome, point):
    return jax.jit(jax.grad(outcome))(point)


def _moved(point, name, by):
    return {**point, name: point[name] + by}


@pytest.mark.parametrize("name", AT)
def test_reverse_mode_is_the_central_difference(outcome, point, gradient, name):
    step = 1e-4 * AT[name]
    above, below = (outcome(_moved(point, name, s)) for s in (step, -step))
    slope = float(above - below) / (2 * step)
    assert abs(slope) > 1e-9
    assert float(gradient[name]) == pytest.approx(slope, rel=1e-6)


# By default forward mode is compared with differences in test_linear_load.
@pytest.mark.slow
def test_forward_mode_is_reverse_mode(outcome, point, gradient):
    along = jax.jit(lambda p, v: jax.jvp(outcome, (p,), (v,))[1])
    for name in AT:
        direction = {n: jnp.array(float(n == name)) for n in AT}
        forward = float(along(point, direction))
        assert forward == pytest.approx(float(gradient[name]), rel=1e-10)


def test_what_is_left_of_the_taylor_series_is_of_second_order(outcome, point, gradient):
    direction = {name: 0.02 * value for name, value in AT.items()}
    slope = sum(float(gradient[n]) * direction[n] for n in AT)
    base = float(outcome(point))
    left = []
    for size in (1.0, 0.5, 0.25):
        moved = {n: point[n] + size * direction[n] for n in AT}
        left.append(abs(float(outcome(moved)) - base - size * slope))
    orders = np.log2(np.array(left[:-1]) / left[1:])
    print("Taylor remainders", left, "orders", orders)
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


# By default jit and vmap are compared with single runs in test_compiled_simulation.
@pytest.mark.slow
def test_jit_and_vmap_give_the_same_as_runs_one_by_one(structure):
    def mean(k):
        material = jt.Material(k, density=8000.0, specific_heat=500.0)
        body = jt.Body(structure, material, temperature=300.0)
        term = jt.FixedTemperature(350.0, on=jt.Side((1.0, 0.0, 0.0)))
        scene = jt.Scene((body,), (term,), dtype="float64")
        return jt.simulate(scene, 5.0, solver=SOLVER).mean_temperature[0, 0]

    several = [5.0, 10.0, 20.0]
    alone = [float(mean(k)) for k in several]
    together = jax.jit(jax.vmap(mean))(jnp.array(several))
    np.testing.assert_allclose(together, alone, rtol=1e-14)
    assert alone[0] < alone[1] < alone[2]
    assert float(jax.jit(mean)(10.0)) == pytest.approx(alone[1], rel=1e-14)


def test_a_traced_run_without_a_step_says_what_to_do(structure):
    def mean(k):
        material = jt.Material(k, density=8000.0, specific_heat=500.0)
        body = jt.Body(structure, material, temperature=300.0)
        return jt.simulate(jt.Scene((body,)), 5.0).mean_temperature[0, 0]

    with pytest.raises(jt.InputError, match="give the step.*ForwardEuler"):
        jax.vmap(mean)(jnp.array([1.0, 2.0]))


def test_a_gradient_with_two_bodies_and_a_traced_emissivity(structure):
    def mean(emissivity):
        material = jt.Material(
            16.0, density=8000.0, specific_heat=500.0, emissivity=emissivity
        )
        far_away = jt.Pose(translation=(1.0, 0.0, 0.0))
        bodies = (
            jt.Body(structure, material, temperature=400.0),
            jt.Body(structure, material, temperature=500.0, pose=far_away),
        )
        terms = jt.Surroundings(300.0), jt.HeatFlux(10.0)
        scene = jt.Scene(bodies, terms, dtype="float64")
        solution = jt.simulate(scene, 5.0, solver=SOLVER)
        return solution.mean_temperature.sum()

    value_and_slope = jax.jit(jax.value_and_grad(mean))
    difference = float(value_and_slope(0.501)[0] - value_and_slope(0.499)[0]) / 0.002
    assert float(value_and_slope(0.5)[1]) == pytest.approx(difference, rel=1e-6)
