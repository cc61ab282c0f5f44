"""Richardson extrapolation on fields whose error and order are known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_truth_error import geometry, run, wavy

import jaxthermo as jt
from jaxthermo.errors import InputError


@pytest.fixture(scope="module")
def box():
    """A cube whose fragments read linear fields exactly."""
    return geometry(jt.voxelize(jt.shapes.box((0.6, 0.6, 0.6)), 0.1))


def sized(box, pitch):
    """The same fragments as those of a run with other voxels."""
    return replace(box, pitch=pitch)


def exact(x, t=0.0):
    return 300.0 + x @ np.array([30.0, -20.0, 10.0]) + t


def run_with_error(box, pitch, error, times=(0.0, 1.0, 9.0)):
    """A run that is off by `error(pitch, time)` times a field of 1 K and more."""

    def shape(x):
        return 1.0 + x @ np.array([1.0, 2.0, 3.0])

    def field(x, t):
        return exact(x, t) + error(pitch, t) * shape(x)

    return run(field, sized(box, pitch), times=times)


def rms_of_shape(box, count=400):
    points = jt.mesh_sample(jt.Mesh(box.vertices, box.faces), count).position
    return np.sqrt(((1.0 + points @ np.array([1.0, 2.0, 3.0])) ** 2).mean())


@pytest.mark.parametrize("order", [0.6, 1.0, 1.7, 2.0, 2.9])
@pytest.mark.parametrize("pitches", [(0.1, 0.2, 0.4), (0.1, 0.15, 0.4)])
def test_errors_of_a_known_order_are_found(box, order, pitches):
    def error(h, t):
        return 5.0 * h**order * (1 + t)

    estimate = jt.discretization_error(
        *(run_with_error(box, h, error) for h in pitches), count=400
    )
    np.testing.assert_allclose(estimate.order, order, rtol=1e-6)
    expected = 5.0 * 0.1**order * rms_of_shape(box) * np.array([2.0, 10.0])
    np.testing.assert_allclose(estimate.rms_kelvin, expected, rtol=1e-6)
    assert not estimate.is_bound.any() and estimate.times.tolist() == [1.0, 9.0]
    assert estimate.worst_rms_kelvin == pytest.approx(expected[1])
    # The percentage has the range of a truth error.
    against = jt.truth_error(
        run_with_error(box, 0.2, error), run_with_error(box, 0.1, error), 400
    )
    ratio = np.asarray(against.rms_percent) / np.asarray(against.rms_kelvin)
    np.testing.assert_allclose(estimate.rms_percent, ratio * expected, rtol=1e-6)


def test_each_time_has_its_own_order_and_bounds_are_marked(box):
    """After 1 s of order 2, then growing, too slow, too fast."""
    values = {
        1.0: (0.01, 0.04, 0.16),
        2.0: (0.1, 0.5, 0.4),
        3.0: (0.1, 0.2, 0.31),
        4.0: (0.1, 0.11, 0.9),
    }
    pitches = (0.1, 0.2, 0.4)

    def error(h, t):
        return 0.0 if t == 0 else values[t][pitches.index(h)]

    times = (0.0, *values)
    estimate = jt.discretization_error(
        *(run_with_error(box, pitch=h, error=error, times=times) for h in pitches),
        count=400,
    )
    assert estimate.is_bound.tolist() == [False, True, True, True]
    assert estimate.order[0] == pytest.approx(2) and np.isnan(estimate.order[1:]).all()
    rms = rms_of_shape(box)
    expected = rms * np.array([0.01, 0.4, 0.11, 0.79])
    np.testing.assert_allclose(estimate.rms_kelvin, expected, rtol=1e-6)
    plain = json.loads(json.dumps(estimate.as_dict(), allow_nan=False))
    assert plain["order"] == [pytest.approx(2), None, None, None]
    assert plain["is_bound"] == [False, True, True, True]
    np.testing.assert_allclose(plain["differences_kelvin"], estimate.differences)


def test_runs_that_agree_have_no_error(box):
    estimate = jt.discretization_error(
        *(run_with_error(box, h, lambda h, t: 0.0) for h in (0.1, 0.2, 0.4)), count=100
    )
    np.testing.assert_allclose(estimate.rms_kelvin, 0)
    np.testing.assert_allclose(estimate.rms_percent, 0)
    assert not estimate.is_bound.any()

    # Only the finer two agree: nothing is known but the other difference.
    def late(h, t):
        return 1.0 if h == 0.4 else 0.0

    bound = jt.discretization_error(
        *(run_with_error(box, h, late) for h in (0.1, 0.2, 0.4)), count=100
    )
    assert bound.is_bound.all() and (bound.rms_kelvin > 0.5).all()


def test_runs_in_the_wrong_order_are_refused(box):
    runs = [run_with_error(box, h, lambda h, t: h) for h in (0.1, 0.2, 0.4)]
    with pytest.raises(InputError, match="finest run first"):
        jt.discretization_error(runs[2], runs[1], runs[0])
    with pytest.raises(InputError, match="finest run first"):
        jt.discretization_error(runs[0], runs[0], runs[1])
    unchanged = sized(box, 0.1)
    two_body_runs = [run(wavy, unchanged, sized(box, h)) for h in (0.1, 0.2, 0.4)]
    with pytest.raises(InputError, match="1 to 2 times as large"):
        jt.discretization_error(two_body_runs[0], two_body_runs[1], two_body_runs[2])
    with pytest.raises(InputError, match="equal bodies"):
        jt.discretization_error(two_body_runs[0], runs[1], runs[2])


@pytest.mark.slow
def test_the_estimate_meets_the_error_against_a_much_finer_run():
    """A sphere in the sun: within a factor of two."""
    steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
    mesh = jt.shapes.sphere(0.04, subdivisions=4)
    sun = jt.Sun(direction=(-1.0, 0.0, -1.0), irradiance=5000.0)

    def solve(across):
        grid = jt.voxelize(mesh, 0.08 / across)
        body = jt.Body(jt.FullVolume(grid), steel, temperature=300.0)
        return jt.simulate(jt.Scene((body,), (sun,)), 60.0, save_at=[20.0, 60.0])

    runs = {across: solve(across) for across in (10, 20, 40, 80)}
    estimate = jt.discretization_error(runs[40], runs[20], runs[10])
    actual = np.asarray(jt.truth_error(runs[40], runs[80]).rms_kelvin)
    actual = jt.truth_error(runs[40], runs[80]).rms_kelvin
    # The finer run is off by as much as its own estimate.
    actual = actual + jt.discretization_error(runs[80], runs[40], runs[20]).rms_kelvin
    assert not estimate.is_bound.any()
    ratio = estimate.rms_kelvin / np.asarray(actual)
    assert (ratio > 0.5).all() and (ratio < 2).all()
