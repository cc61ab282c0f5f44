"""Backward Euler keeps the maximum principle at any step; extreme cases settle."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.choices import Dtype
from tests.bodies import blocks
from tests.shallow import SHALLOW


AEROGEL = jt.Material(0.013, density=150.0, specific_heat=1000.0)
DIAMOND = jt.Material(2000.0, density=3500.0, specific_heat=780.0)
OVERSHOOT = {"float64": 1e-9, "float32": 5e-3}
DRIFT = {"float64": 1e-12, "float32": 1e-4}
PITCH = 1e-3


def _laminate(pattern, dtype):
    """Alternating aerogel and diamond, S01: k of ratio 1.5e5, 400 K against 300 K."""
    shape = (12, 3, 3)
    index = np.indices(shape)
    on = (index[0] if pattern == "laminate" else index.sum(axis=0)) % 2
    grid = blocks(np.ones(shape, bool), PITCH)
    labels = jt.MaterialLabels(on.astype(np.int32), (AEROGEL, DIAMOND))

    def hot(points):
        return np.where(points[:, 0] < 6 * PITCH, 400.0, 300.0)

    body = jt.Body(jt.FullVolume(grid), labels, temperature=hot)
    return jt.Scene((body,), (), dtype=dtype)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pattern", "dtype"),
    [
        pytest.param("checkerboard", "float32", marks=pytest.mark.slice),
        ("checkerboard", "float64"),
        ("laminate", "float32"),
        ("laminate", "float64"),
    ],
)
def test_no_step_overshoots_and_none_loses_heat(pattern, dtype):
    scene = _laminate(pattern, dtype)
    stable = jt.simulate(scene, 0.0).run.stable_step
    assert stable is not None
    for fourier in (1.0, 1e3, 1e6):
        dt = fourier * stable
        run = jt.simulate(scene, 5 * dt, solver=jt.BackwardEuler(dt=dt), throw=False)
        surface = np.asarray(run.surface_temperature, float)
        over = max(surface.max() - 400, 300 - surface.min(), 0)
        drift = np.abs(run.energy.residual_relative).max()
        print(pattern, dtype, fourier, "over", over, "drift", drift, run.result)
        assert np.isfinite(surface).all()
        assert over <= OVERSHOOT[dtype]
        assert drift <= DRIFT[dtype]


def _cube(start, dtype: Dtype = "float64"):
    grid = blocks(np.ones((2, 2, 2), bool), 0.01)
    metal = jt.Material(200.0, density=2700.0, specific_heat=900.0, emissivity=1.0)
    body = jt.Body(jt.FullVolume(grid), metal, temperature=start)
    sky = jt.Surroundings(300.0)
    return jt.Scene((body,), (sky,), dtype=dtype, allow_extreme_temperatures=True)


# From the cold; from 5800 K down by default in test_implicit_balance, test_fallback.
SHORT = ((1e-3, 1e12),)


@pytest.mark.parametrize(
    ("start", "dt"),
    [
        pytest.param(start, dt, marks=[pytest.mark.slow] * ((start, dt) not in SHORT))
        for start in (1e-3, 5800.0)
        for dt in (1.0, 1e4, 1e12)
    ],
)
def test_emission_settles_from_any_start_at_any_step(start, dt):
    """S06, S07: at most 20 steps of Newton's method, and nothing beyond the ends."""
    scene = _cube(start)
    run = jt.simulate(scene, dt, solver=jt.BackwardEuler(dt=dt), throw=False)
    mean = float(run.mean_temperature[-1, 0])
    effort = run.run.statistics
    assert effort is not None
    newton = int(effort.newton_iterations)
    print(start, dt, "ends at", mean, "after", newton, run.result)
    assert newton <= 20
    assert min(start, 300.0) - 1e-6 <= mean <= max(start, 300.0) + 1e-6
    if dt == 1e12:
        # Rounding of the rate of emission, times that step, is worth most of a kelvin.
        assert mean == pytest.approx(300.0, abs=1.0)


def test_an_island_stays_as_it_is_bit_by_bit():
    """S12: a part without heat exchange, beside one that loses heat."""
    solid = np.zeros((5, 2, 2), bool)
    solid[:2] = True
    solid[4, 0, 0] = True
    grid = blocks(solid, 0.01)
    body = jt.Body(
        jt.FullVolume(grid),
        jt.Material(10.0, density=2000.0, specific_heat=800.0),
        temperature=lambda points: 300.0 + 700.0 * points[:, 0],
    )
    region = jt.Region((-1.0, -1.0, -1.0), (0.001, 1.0, 1.0))
    term = jt.Convection(50.0, 250.0, on=region)
    scene = jt.Scene((body,), (term,), dtype="float64")
    ends = jt.simulate(scene, 100.0, [0.0, 100.0], solver=jt.BackwardEuler(dt=10.0))
    far = grid.fragment_position[:, 0] > 0.035
    surface = np.asarray(ends.surface_temperature)
    assert far.any()
    np.testing.assert_array_equal(surface[0, far], surface[1, far])
    assert (surface[0, ~far] - surface[1, ~far]).max() > 1.0


@SHALLOW
def test_voxels_of_10_um_and_1_m_in_one_scene():
    """S03: the explicit solver says its limit; the implicit one takes the step."""
    small = jt.Body(
        jt.FullVolume(blocks(np.ones((3, 3, 3), bool), 1e-5)),
        DIAMOND,
        temperature=400.0,
    )
    large = jt.Body(
        jt.FullVolume(blocks(np.ones((3, 3, 3), bool), 1.0)),
        AEROGEL,
        temperature=300.0,
        pose=jt.Pose(translation=(10.0, 0.0, 0.0)),
    )
    scene = jt.Scene((small, large), (jt.Convection(10.0, 350.0),), dtype="float64")
    with pytest.raises(jt.InputError, match="largest stable step of this scene is"):
        jt.simulate(scene, 1.0, solver=jt.ForwardEuler(dt=1.0))
    run = jt.simulate(scene, 1e4, solver=jt.BackwardEuler(dt=100.0), throw=False)
    surface = np.asarray(run.surface_temperature)
    assert surface.min() >= 300.0 - 1e-9 and surface.max() <= 400.0 + 1e-9
    assert np.abs(run.energy.residual_relative).max() < 1e-11
    np.testing.assert_allclose(run.of_body(0), 350.0, atol=1e-3)
