"""`simulate`: steps refused and accepted, odd times and bodies, failures, precision."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.plan import plan_run
from tests.bodies import bar, blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
TOP = jt.Side((0.0, 0.0, 1.0))
STEPS = jt.ForwardEuler()


@pytest.fixture(scope="module")
def structure():
    return jt.FullVolume(blocks(np.ones((2, 2, 2), bool), 0.01))


def _scene(structure, *terms, dtype: Dtype = "float64", temperature: Any = 300.0):
    body = jt.Body(structure, METAL, temperature=temperature)
    return jt.Scene((body,), terms, dtype=dtype)


LIMIT = 0.01**2 / (3 * float(METAL.diffusivity))
"""Of a voxel with three neighbours [s]."""


def test_a_step_above_the_limit_is_refused_with_the_limit(structure):
    message = f"largest stable step of this scene is {LIMIT:.6g} s"
    with pytest.raises(jt.InputError, match=message):
        jt.simulate(_scene(structure), 10.0, solver=jt.ForwardEuler(dt=1.01 * LIMIT))


@pytest.mark.parametrize(
    "dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
def test_the_limit_itself_is_accepted(structure, dtype):
    scene = _scene(structure, jt.HeatFlux(10.0), dtype=dtype)
    run = jt.simulate(scene, 10 * LIMIT, solver=jt.ForwardEuler(dt=LIMIT)).run
    assert run.stable_step == pytest.approx(LIMIT, rel=1e-6)
    assert run.dt == pytest.approx(LIMIT, rel=1e-12)
    assert run.steps == 10


def test_the_limit_counts_what_is_on_the_surface(structure):
    """Every voxel has three open faces, each through half a cell in series."""
    h = 5000.0
    scene = _scene(structure, jt.Convection(jt.Table([0.0, 5.0], [0.0, h]), 300.0))
    run = plan_run(scene, t1=1.0, save_at=None, solver=STEPS)
    through = 1 / (1 / h + 0.01 / (2 * np.asarray(METAL.conductivity)))
    rate = 3 * METAL.diffusivity / 0.01**2 + 3 * through / (
        METAL.volumetric_heat_capacity * 0.01
    )
    assert run.stable_step == pytest.approx(1 / rate, rel=1e-6)


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan")])
def test_steps_that_are_none_are_refused(structure, dt):
    with pytest.raises(jt.InputError, match="positive time"):
        jt.simulate(_scene(structure), 1.0, solver=jt.ForwardEuler(dt=dt))


def test_bad_save_times_are_refused(structure):
    with pytest.raises(jt.InputError, match=r"must lie in \[0, 1\]"):
        jt.simulate(_scene(structure), 1.0, save_at=[0.5, 2.0])


@pytest.mark.parametrize("terms", [(), (jt.HeatFlux(10.0),)])
def test_no_time_at_all_is_the_start(structure, terms):
    scene = _scene(structure, *terms, temperature=lambda p: 300.0 + 1e3 * p[:, 0])
    solution = jt.simulate(scene, 0.0)
    assert solution.times.tolist() == [0.0]
    assert solution.run.steps == 0
    temperatures = np.unique(np.asarray(solution.surface_temperature).round(9))
    np.testing.assert_allclose(temperatures, [305.0, 315.0])
    assert float(solution.energy.stored_J[0]) == 0.0
    assert solution.result == jt.RESULTS.successful


def test_saving_at_zero_is_the_start_and_changes_nothing_after(structure):
    scene = _scene(structure, jt.HeatFlux(1000.0, on=TOP))
    from_start = jt.simulate(scene, 4.0, save_at=[0.0, 3.0], solver=STEPS)
    late = jt.simulate(scene, 4.0, save_at=[3.0], solver=STEPS)
    assert from_start.times.tolist() == [0.0, 3.0]
    np.testing.assert_array_equal(from_start.surface_temperature[0], 300.0)
    np.testing.assert_array_equal(
        from_start.surface_temperature[1], late.surface_temperature[0]
    )
    joules = float(from_start.energy.mechanisms["heat_flux"][1])
    assert joules == pytest.approx(1000.0 * 4e-4 * 3.0, rel=1e-13)


def test_a_step_that_does_not_divide_the_end_lands_on_it(structure):
    scene = _scene(structure, jt.HeatFlux(1000.0, on=TOP))
    solution = jt.simulate(scene, 1.0, solver=jt.ForwardEuler(dt=0.3))
    assert (solution.run.steps, solution.run.dt) == (4, 0.25)
    joules = float(solution.energy.mechanisms["heat_flux"][0])
    assert joules == pytest.approx(1000.0 * 4e-4, rel=1e-13)


@pytest.mark.parametrize(
    "flux", [pytest.param(float("inf"), marks=pytest.mark.slow), float("nan")]
)
def test_a_flux_that_is_not_finite(structure, flux):
    def late(t):
        return jnp.where(t < 1.0, 10.0, flux)

    scene = _scene(structure, jt.HeatFlux(late))
    with pytest.raises(RuntimeError, match="no longer finite.*check the terms"):
        jt.simulate(scene, 4.0, [0.5, 4.0], solver=jt.ForwardEuler(dt=0.5))
    solution = jt.simulate(
        scene, 4.0, [0.5, 4.0], solver=jt.ForwardEuler(dt=0.5), throw=False
    )
    assert solution.result == jt.RESULTS.nonfinite
    assert np.isfinite(solution.surface_temperature[0]).all()


@pytest.mark.parametrize("cells", [1, 7])
def test_thin_bodies(cells):
    grid = bar(cells, 0.01)
    body = jt.Body(jt.FullVolume(grid), METAL, temperature=300.0)
    scene = jt.Scene((body,), (jt.HeatFlux(1000.0),), dtype="float64")
    solution = jt.simulate(scene, 2.0, solver=STEPS)
    assert solution.surface_temperature.shape == (1, 4 * cells + 2)
    joules = 1000.0 * (4 * cells + 2) * 1e-4 * 2.0
    rise = joules / (METAL.volumetric_heat_capacity * cells * 1e-6)
    actual_rise = float(solution.mean_temperature[0, 0]) - 300.0
    assert actual_rise == pytest.approx(rise, rel=1e-10)


def test_every_digit_without_the_global_switch(structure):
    scene = _scene(structure, jt.Convection(20.0, 280.0), jt.Surroundings(270.0))

    def run():
        return jt.simulate(scene, 20.0, [0.0, 10.0, 20.0], solver=STEPS)

    expected = run()
    with jax.enable_x64(False):
        solution = run()
        surface = np.asarray(solution.surface_temperature)
        assert surface.dtype == np.float64
        assert np.asarray(solution.times).dtype == np.float64
        # Used afterwards, by numpy or by jax, it must neither warn nor fail.
        assert float(solution.mean_temperature[-1, 0]) < 300.0
        assert float(jnp.max(solution.surface_temperature)) == 300.0
        assert solution.of_body(0).shape == surface.shape
        residual = float(np.abs(solution.energy.residual_relative).max())
    np.testing.assert_array_equal(surface, expected.surface_temperature)
    assert residual < 1e-13


@pytest.mark.parametrize("transform", [jax.jit, jax.grad])
@pytest.mark.parametrize("is_global", [True, False])
def test_every_digit_in_transformed_code_needs_the_global_switch(
    structure, transform, is_global
):
    def mean(coefficient):
        scene = _scene(structure, jt.Convection(coefficient, 280.0))
        steps = jt.ForwardEuler(dt=LIMIT / 2)
        return jt.simulate(scene, 2.0, solver=steps).mean_temperature[-1, 0]

    with jax.enable_x64(is_global):
        if is_global:
            assert transform(mean)(20.0).dtype == np.float64
            return
        with pytest.raises(jt.InputError, match="call jax.config.update"):
            transform(mean)(20.0)


def test_a_constant_scene_of_every_digit_is_refused_in_a_jitted_function(structure):
    scene = _scene(structure, jt.Convection(20.0, 280.0))

    def run():
        return jt.simulate(scene, 2.0, solver=STEPS).surface_temperature

    with jax.enable_x64(False), pytest.raises(jt.InputError, match="under jax.jit"):
        jax.jit(run)()


def test_float32_is_the_default_and_close(structure):
    terms = jt.Convection(20.0, 280.0), jt.Surroundings(270.0)
    body = jt.Body(structure, METAL, temperature=300.0)

    def run(scene):
        return jt.simulate(scene, 200.0, [0.0, 100.0, 200.0], solver=STEPS)

    single = run(jt.Scene((body,), terms))
    double = run(jt.Scene((body,), terms, dtype="float64"))
    assert single.surface_temperature.dtype == np.float32
    drop = 300.0 - double.surface_temperature[-1]
    error = np.asarray(single.surface_temperature, float) - double.surface_temperature
    assert np.abs(error).max() < 1e-4
    assert float(drop.min()) > 0.5


def test_options_of_a_gpu_are_those_of_the_outermost_program(structure, monkeypatch):
    scene = _scene(structure, jt.HeatFlux(10.0))
    solver = jt.ForwardEuler(dt=0.5)
    plain = jt.simulate(scene, 10.0, solver=solver).surface_temperature
    # XLA reads the options of GPUs for other devices too.
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")

    def run():
        return jt.simulate(scene, 10.0, solver=solver).surface_temperature

    assert np.array_equal(run(), plain)
    assert jax.eval_shape(run).shape == plain.shape
