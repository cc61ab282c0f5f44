"""The energy of loads that change with time, in float32, against closed forms.

Whatever the solver and its steps, and however late in a run they change.
"""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from tests.bodies import blocks
from tests.shallow import SHALLOW


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
TOP = jt.Side((0.0, 0.0, 1.0))
AREA = 0.01
"""Of the heated side [m^2]."""

HOUR = 3600.0
SOLVERS = {
    "error control": lambda dt: None,
    "Euler": jt.ForwardEuler,
    "stages": jt.SuperTimeStepping,
    "implicit Euler": jt.BackwardEuler,
    "trapezoidal": jt.CrankNicolson,
    "TR-BDF2": jt.TRBDF2,
    "adaptive": lambda dt: jt.TRBDF2(),
}


@pytest.fixture(scope="module")
def scene():
    """Two voxels, insulated but for a flux into the top."""
    structure = jt.FullVolume(blocks(np.ones((1, 1, 2), bool), 0.1))
    return lambda flux: jt.Scene(
        (jt.Body(structure, STEEL, temperature=300.0),), (jt.HeatFlux(flux, on=TOP),)
    )


def absorbed(solution) -> np.ndarray:
    """Heat per area since the start at the saved times [J/m^2]."""
    return np.asarray(solution.energy.mechanisms["heat_flux"], float) / AREA


def gaussian(width: float):
    """Pulse of 1e6 J/m^2 in the middle of an hour, of a standard deviation [s]."""
    height = 1e6 / (width * math.sqrt(2 * math.pi))
    return lambda time: height * jnp.exp(-0.5 * ((time - HOUR / 2) / width) ** 2)


@SHALLOW
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name == "TR-BDF2" else name
        for name in SOLVERS
    ],
)
def test_the_heat_of_short_and_late_intervals_is_exact(scene, name):
    # Longer steps than the intervals; the last ones are nothing in float32.
    cases = [
        ([0.0, 100.0, 100.000001], [1e3, 1e3, 0.0], [100.0, 101.0], [1e5, 1e5]),
        (
            [0.0, 3e6, 3e6 + 0.01, 3e6 + 0.02],
            [0.0, 0.0, 1e6, 0.0],
            [3e6, 3e6 + 0.01, 3e6 + 0.02],
            [0.0, 5e3, 1e4],
        ),
    ]
    for times, values, saves, exact in cases:
        solver = SOLVERS[name](saves[-1] / 40)
        if name == "Euler" and saves[-1] > 1e6:
            solver = jt.SuperTimeStepping(dt=1e5)
        solution = jt.simulate(
            scene(jt.Table(times, values)), saves[-1], saves, solver=solver
        )
        assert_allclose(absorbed(solution), exact, rtol=1e-5, atol=1e-5 * max(exact))
        assert np.asarray(solution.times).tolist() == saves


@SHALLOW
@pytest.mark.parametrize(
    ("name", "width"),
    [
        ("error control", 0.1),
        ("Euler", 0.03),
        ("stages", 0.03),
        ("implicit Euler", 0.03),
        ("adaptive", 0.1),
        pytest.param("error control", 0.03, marks=pytest.mark.slow),
        pytest.param("trapezoidal", 0.1, marks=pytest.mark.slow),
        pytest.param("TR-BDF2", 0.1, marks=pytest.mark.slow),
        pytest.param("adaptive", 0.03, marks=pytest.mark.slow),
    ],
)
def test_a_pulse_given_as_a_function_brings_its_energy(scene, name, width):
    peak = HOUR / 2
    saves = [peak - 6 * width, peak, peak + 6 * width, HOUR]
    solver = SOLVERS[name](40.0)
    solution = jt.simulate(scene(gaussian(width)), HOUR, saves, solver=solver)
    assert_allclose(absorbed(solution), [0.0, 5e5, 1e6, 1e6], rtol=1e-5, atol=1.0)
    assert any("less than 0.055 s may be missed" in n for n in solution.receipt.notes)


@pytest.mark.parametrize("by_heat_rate", [False, True])
def test_what_is_missed_is_told_in_joules(scene, by_heat_rate):
    # The mean of |sin| is 2 / pi: 100 s of 1e5 W/m^2 on 0.01 m^2.
    def noise(time):
        return 1e5 * jnp.sin(1e9 * time)

    if by_heat_rate:
        flux = jt.HeatFlux(heat_rate=lambda time: AREA * noise(time), on=TOP)
        loaded = jt.Scene(scene(0.0).bodies, (flux,))
    else:
        loaded = scene(noise)
    with pytest.warns(UserWarning, match="too fast") as warned:
        jt.compile_simulation(loaded, 100.0)
    (warning,) = [str(record.message) for record in warned]
    missed, varying = map(float, re.findall(r"([0-9.e+]+) J", warning))
    assert varying == pytest.approx(1e5 * 0.01 * 100 * 2 / np.pi, rel=0.05)
    assert 0.1 * varying < missed < 2 * varying


@SHALLOW
def test_the_stated_error_of_a_pulse_is_true(scene):
    # The half that is heated is hotter than the whole, by its own conduction.
    peak = HOUR / 2
    saves = [peak + 0.5, peak + 30.0]
    run = jt.simulate(scene(gaussian(0.1)), HOUR, saves)
    fine = jt.simulate(
        scene(gaussian(0.1)), HOUR, saves, solver=jt.SuperTimeStepping(dt=0.05)
    )
    error = np.abs(np.asarray(run.surface_temperature - fine.surface_temperature)).max()
    assert run.run.time_error is not None
    assert error <= run.run.time_error + 1e-3
    assert float(run.surface_temperature.max()) > 302.4


UNKNOWN_TIMES = {
    "Euler": lambda: jt.ForwardEuler(dt=7.0),
    "stages": lambda: jt.SuperTimeStepping(dt=7.0, stages=3),
    "implicit Euler": lambda: jt.BackwardEuler(dt=7.0),
    "trapezoidal": lambda: jt.CrankNicolson(dt=7.0),
    "TR-BDF2": lambda: jt.TRBDF2(dt=7.0),
}


@pytest.mark.parametrize(
    "name",
    [
        name if name == "stages" else pytest.param(name, marks=pytest.mark.slow)
        for name in UNKNOWN_TIMES
    ],
)
def test_a_pulse_of_unknown_times_keeps_its_energy_in_any_steps(scene, name):
    """Of the times as float32 has them, which is all that is known of them."""

    # Times that are traced end no steps: each step takes the integral within it.
    def heat(times):
        flux = jt.Table(times, [0.0, 1e6, 0.0])
        return absorbed_at_end(scene(flux), UNKNOWN_TIMES[name]())

    derived = jax.jit(jax.value_and_grad(heat))
    # The steps end at multiples of 20 / 3 s.
    for begin in (0.3, 33.21, 66.5, 69.9, 98.123):
        times = np.float32(begin) + np.array([0.0, 0.1, 0.3], np.float32)
        value, slopes = derived(jnp.asarray(times))
        exact = 1e6 * float(times[2].astype(float) - times[0]) / 2
        assert float(value) == pytest.approx(exact, rel=3e-6)
        assert_allclose(slopes, [-5e5, 0.0, 5e5], atol=100.0)


def test_unknown_times_of_64_bits_keep_their_remainders(scene):
    """A pulse of 10 ms after a month, which float32 cannot tell apart, in its state."""
    month = 3e6

    def heat(begin):
        times = begin + jnp.array([0.0, 0.004, 0.01])
        flux = jt.Table(times, [0.0, 1e6, 0.0])
        solver = jt.BackwardEuler(dt=1e5)
        saves = [month, month + 100.0]
        solution = jt.simulate(scene(flux), saves[-1], saves, solver=solver)
        return solution.energy.mechanisms["heat_flux"][-1] / AREA

    with jax.enable_x64(True):
        # In the middle of the last step, and at its start.
        for begin in (month + 33.2, month):
            value = jax.jit(heat)(jnp.asarray(begin))
            assert float(value) == pytest.approx(5e3, rel=1e-5)


def test_a_function_of_a_traced_number_has_its_energy_and_derivative(scene):
    def heat(width):
        def flux(time):
            return 1e3 * jnp.exp(-0.5 * ((time - 50.0) / width) ** 2)

        return absorbed_at_end(scene(flux), jt.BackwardEuler(dt=2.0))

    value, slope = jax.jit(jax.value_and_grad(heat))(jnp.asarray(4.0))
    exact = 1e3 * math.sqrt(2 * math.pi)
    assert float(value) == pytest.approx(4.0 * exact, rel=1e-4)
    assert float(slope) == pytest.approx(exact, rel=1e-4)


def absorbed_at_end(traced: jt.Scene, solver) -> jax.Array:
    """Heat per area after 100 s [J/m^2]."""
    solution = jt.simulate(traced, 100.0, solver=solver)
    return solution.energy.mechanisms["heat_flux"][-1] / AREA


def test_a_compiled_run_takes_other_tables_late_in_it(scene):
    late = 3e6
    saves = [late, late + 0.01]

    def load(height):
        flux = jt.Table([0.0, late, late + 0.01], [0.0, 0.0, height])
        return scene(flux)

    run = jt.compile_simulation(load(1e6), saves[-1], saves)
    assert_allclose(absorbed(run(load(3e6))), [0.0, 1.5e4], rtol=1e-5, atol=1e-3)


@SHALLOW
def test_segments_take_the_windows_of_the_whole_run(scene):
    plan = plan_run(scene(gaussian(0.1)), HOUR, [1801.0, HOUR], jt.ForwardEuler())
    whole = jt.simulate(plan.scene, HOUR, [1801.0, HOUR], solver=jt.ForwardEuler())
    progress = begin_run(plan)
    for following in run_segments(plan, progress, seconds=1e-9):
        progress = following
    parts = finish_run(plan, progress)
    assert absorbed(parts).tolist() == absorbed(whole).tolist()


def test_what_is_switched_late_shows_as_it_was_before(scene):
    late = 3e6
    lamp = jt.Sun((0.0, 0.0, -1.0), jt.Until(100.0, late + 0.01))
    bright = jt.Scene(scene(0.0).bodies, (lamp,))
    saves = [late, late + 0.01, late + 0.02]
    solution = jt.simulate(bright, saves[-1], saves)
    shown = [float(solution.irradiance(k).sources.max()) for k in range(3)]
    assert shown == pytest.approx([100.0, 100.0, 0.0])
