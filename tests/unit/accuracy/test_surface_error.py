"""The error of a structure: by hand, against a plain loop, and where it is refused."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import bar
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.scene.scene import BodyGeometry, SolvedSurface
from tests.shallow import SHALLOW


def surface(area, shift: float = 0.0) -> SolvedSurface:
    """Fragments of given areas in a row."""
    count = len(area)
    geometry = BodyGeometry(
        vertices=np.zeros((3, 3)),
        faces=np.zeros((1, 3), int),
        fragment_position=np.arange(3.0 * count).reshape(count, 3) + shift,
        fragment_normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        fragment_area=np.asarray(area, float),
        pitch=1.0,
        pose=Pose(),
    )
    return SolvedSurface(geometry, jnp.asarray(1.0), jnp.asarray(1.0))


def run(times, temperature, area, **how) -> StoredSolution:
    rows = jnp.asarray(np.asarray(temperature, float))
    return StoredSolution(jnp.asarray(times, float), rows, (surface(area, **how),))


AREA = (1.0, 3.0)


def test_by_hand():
    """Areas 1 and 3; ranges 10 and 20 K; differences (2, 0) and (0, -4) K."""
    reference = run([0, 10, 20], [[300, 300], [300, 310], [300, 320]], AREA)
    solution = run([0, 10, 20], [[300, 300], [302, 310], [300, 316]], AREA)
    error = jt.surface_error(solution, reference)
    np.testing.assert_allclose(error.times, [10, 20])
    rms = np.array([np.sqrt(4 / 4), np.sqrt(3 * 16 / 4)])
    np.testing.assert_allclose(error.rms_kelvin, rms, rtol=1e-12)
    np.testing.assert_allclose(error.rms_percent, 100 * rms / [10, 20], rtol=1e-12)
    np.testing.assert_allclose(error.max_percent, [20, 20], rtol=1e-12)
    assert float(error.worst_rms_percent) == pytest.approx(100 * rms[1] / 20)
    assert float(error.worst_rms_kelvin) == pytest.approx(rms[1])


def test_a_time_that_is_even_again_counts_with_5_percent_of_the_largest_range():
    reference = run([1, 2], [[300, 400], [350, 350]], AREA)
    solution = run([1, 2], [[300, 400], [351, 351]], AREA)
    error = jt.surface_error(solution, reference)
    np.testing.assert_allclose(error.rms_percent, [0, 100 * 1 / 5], rtol=1e-12)


def test_the_99th_percentile_goes_by_area():
    """One fragment in a hundred is off: it counts if it has over 1 % of the area."""
    reference = run([1], [np.r_[np.zeros(99), 10]], np.ones(100))
    off = np.r_[np.zeros(98), 5.0, 10]

    def share(area):
        return float(
            jt.surface_error(
                run([1], [off], area), replace(reference, surfaces=(surface(area),))
            ).worst_p99_percent
        )

    assert share(np.ones(100)) == 0
    assert share(np.r_[np.ones(98), 3.0, 1]) == 50


def brute_percentile(sizes, area):
    """The smallest size that 99 % of the area does not exceed."""

    def below(v):
        return sum(a for a, s in zip(area, sizes, strict=True) if s <= v)

    return min(s for s in sizes if below(s) >= (0.99 - 1e-6) * sum(area))


@settings(deadline=None, max_examples=20)
@given(
    hnp.arrays(float, (2, 5), elements=st.floats(280, 400)),
    hnp.arrays(float, (2, 5), elements=st.floats(280, 400)),
    hnp.arrays(float, 5, elements=st.floats(0.1, 9)),
)
def test_against_a_plain_loop(temperature, expected, area):
    ranges = [max(row) - min(row) for row in expected]
    if max(ranges) == 0:
        return
    error = jt.surface_error(
        run([1, 2], temperature, area), run([1, 2], expected, area)
    )
    for t in range(2):
        span = max(ranges[t], 0.05 * max(ranges))
        square = sum(
            a * (x - y) ** 2
            for a, x, y in zip(area, temperature[t], expected[t], strict=True)
        )
        rms = (square / sum(area)) ** 0.5
        assert float(error.rms_kelvin[t]) == pytest.approx(rms, rel=1e-9, abs=1e-12)
        assert float(error.rms_percent[t]) == pytest.approx(100 * rms / span)
        sizes = [abs(x - y) for x, y in zip(temperature[t], expected[t], strict=True)]
        assert float(error.max_percent[t]) == pytest.approx(100 * max(sizes) / span)
        p99 = brute_percentile(sizes, area)
        assert float(error.p99_percent[t]) == pytest.approx(100 * p99 / span)


def test_it_has_a_derivative_and_the_slope_0_where_nothing_differs():
    reference = run([1], [[300, 310]], AREA)

    def worst(t):
        return jt.surface_error(
            replace(reference, surface_temperature=t), reference
        ).worst_rms_percent

    same = reference.surface_temperature
    np.testing.assert_array_equal(jax.grad(worst)(same), 0)
    # 100 sqrt((a d^2) / 4) / 10 for d in the second fragment alone.
    np.testing.assert_allclose(
        jax.jit(jax.grad(worst))(same + jnp.asarray([[0, 2.0]])),
        [[0, 10 * np.sqrt(3 / 4)]],
        rtol=1e-9,
        atol=1e-12,
    )


@SHALLOW
def test_solutions_of_one_scene_agree_and_go_through_a_simulation_with_a_derivative():
    grid = bar(6, 0.01)

    def solve(conductivity, dt=None):
        steel = jt.Material(conductivity=conductivity, density=8e3, specific_heat=5e2)
        body = jt.Body(jt.FullVolume(grid), steel, temperature=300.0)
        heat = jt.HeatFlux(2e4, on=jt.Side(normal=(1.0, 0.0, 0.0)))
        solver = jt.ForwardEuler(dt=dt)
        scene = jt.Scene((body,), (heat,))
        return jt.simulate(scene, 1.0, [0.0, 1.0], solver=solver)

    reference = solve(16.0, 0.1)
    assert float(jt.surface_error(reference, reference).worst_max_percent) == 0

    def error(k):
        return jt.surface_error(solve(k, 0.1), reference).worst_rms_percent

    error_and_slope = jax.jit(jax.value_and_grad(error))
    (low, _), (_, slope), (high, _) = (error_and_slope(k) for k in (19.9, 20.0, 20.1))
    assert float(slope) == pytest.approx(float(high - low) / 0.2, rel=1e-3)


def test_a_float32_run_is_measured_against_a_float64_one():
    with jax.enable_x64(False):
        single = run([1], [[300, 312]], AREA)
    assert single.surface_temperature.dtype == jnp.float32
    error = jt.surface_error(single, run([1], [[300, 310]], AREA))
    assert error.rms_percent.dtype == jnp.float64
    assert float(error.worst_max_percent) == pytest.approx(20)


@pytest.mark.parametrize(
    ("solution", "message"),
    [
        (run([1], [[300, 310]], (1.0, 2.0)), "other surface fragments"),
        (run([1], [[300, 310]], AREA, shift=0.5), "other surface fragments"),
        (run([1], [[300, 310, 320]], (1.0, 1.0, 2.0)), "other surface fragments"),
        (run([2], [[300, 310]], AREA), "same save_at"),
        (run([0, 1], [[300, 300], [300, 310]], AREA), "same save_at"),
    ],
)
def test_runs_that_do_not_fit_are_told_in_one_line(solution, message):
    with pytest.raises(InputError, match=message) as caught:
        jt.surface_error(solution, run([1], [[300, 310]], AREA))
    assert "\n" not in str(caught.value)


def test_a_reference_that_says_nothing_is_refused():
    even = run([1], [[300, 300]], AREA)
    with pytest.raises(InputError, match="no range to measure by"):
        jt.surface_error(run([1], [[300, 310]], AREA), even)
    start = run([0], [[300, 310]], AREA)
    with pytest.raises(InputError, match="after time 0"):
        jt.surface_error(start, start)
    two_bodies = replace(start, surfaces=(surface(AREA), surface(AREA)))
    with pytest.raises(InputError, match="2 bodies and the reference has 1"):
        jt.surface_error(two_bodies, start)
