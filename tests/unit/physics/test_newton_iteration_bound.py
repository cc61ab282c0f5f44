"""Newton's steps at a surface: as many as the bound says are as good as all."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxthermo.physics.boundary import Exchange, ImposedFlux
from jaxthermo.physics.flux_law import Forcing, bound
from jaxthermo.physics.radiation.emission import _Emission
from jaxthermo.physics.surface_energy_balance import (
    _TOLERANCE,
    MAX_ITERATIONS,
    SurfaceTerms,
)


AREA = np.array([1e-6, 4e-6, 2e-6])
ZERO = jnp.zeros(())


def _terms(conductivity, pitch, dtype, sun=1000.0):
    """Sun, air and surroundings on three fragments above nodes of one material."""
    area = AREA.astype(dtype)
    sun, h, air, sky, reference = jnp.asarray([sun, 20.0, 285.0, 280.0, 300.0], dtype)
    laws = (
        ImposedFlux(sun),
        Exchange(h, air, reference),
        _Emission(sky, reference),
    )
    return SurfaceTerms(
        names=("sun", "air", "sky"),
        half_cell=area * np.asarray(conductivity / (pitch / 2), dtype),
        natural=tuple((n, bound(area, law)) for n, law in enumerate(laws)),
        prescribed=(),
    )


def _steps(terms, hottest=400.0):
    within = Forcing(highest=hottest, lowest=0.0)
    return terms.newton_iterations(lambda law: law.bounds(within, 1.0))


@eqx.filter_jit
def _solved(terms, theta):
    time = jnp.zeros((), theta.dtype)
    return terms.surface_excess(time, theta), terms.heat(time, theta)[0]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(
    ("conductivity", "pitch"), [(400.0, 1e-3), (16.0, 2e-3), (1.0, 5e-3), (0.03, 0.05)]
)
def test_fewer_steps_leave_what_they_promise(conductivity, pitch, dtype):
    terms = _terms(conductivity, pitch, dtype)
    steps = _steps(terms)
    theta = jnp.asarray([-20.0, 0.0, 90.0], dtype)
    excess, heat = _solved(replace(terms, iterations=steps), theta)
    exact, all_heat = _solved(terms, theta)
    rounding = 40 * np.finfo(dtype).eps * 400.0
    assert_allclose(excess, exact, atol=_TOLERANCE[dtype] + rounding)
    assert_allclose(heat, all_heat, rtol=1e-3 if dtype == "float32" else 1e-9)


def test_a_metal_takes_one_step_and_an_insulator_all():
    assert _steps(_terms(400.0, 1e-3, "float32")) == 1
    assert 1 < _steps(_terms(1.0, 5e-3, "float64")) < MAX_ITERATIONS
    assert _steps(_terms(0.03, 0.05, "float64")) == MAX_ITERATIONS
    assert _steps(_terms(16.0, 1e-3, "float64")) > _steps(_terms(16.0, 1e-3, "float32"))


def test_no_conduction_asks_for_all():
    assert _steps(_terms(0.0, 1e-3, "float64")) == MAX_ITERATIONS
