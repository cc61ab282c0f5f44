"""A term defined outside the package works like a built-in one.

Evaporation from a wet surface, q = -c (T - T_dew)^2 above the dew point.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt


class EvaporationFlux(jt.AbstractFluxLaw):
    """q = -c max(0, T - T_dew)^2 [W/m^2], at T = reference + theta."""

    coefficient: Any
    dew_point: Any
    reference: Any = 0.0

    def _excess(self, theta):
        return jnp.maximum(theta + (self.reference - self.dew_point), 0)

    def flux(self, time, theta):
        return -self.coefficient * self._excess(theta) ** 2

    def slope(self, time, theta):
        return 2 * self.coefficient * self._excess(theta)

    def max_slope(self, highest, end):
        return 2 * self.coefficient * jnp.maximum(highest - self.dew_point, 0)


class Evaporation(jt.AbstractSurfaceTerm):
    """Evaporation from the part of a surface that `on` selects."""

    name = "evaporation"
    coefficient: Any
    dew_point: Any
    on: Any = None

    def bind(self, surface):
        return surface.bind(
            EvaporationFlux(self.coefficient, self.dew_point), on=self.on
        )


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9)
WOOD = jt.Material(0.2, density=600.0, specific_heat=1500.0, emissivity=0.6)
C = 0.5
DEW = 285.0
SOLVERS = {
    "euler": jt.ForwardEuler(),
    "rkl2": jt.SuperTimeStepping(dt=10.0),
    "backward": jt.BackwardEuler(dt=10.0),
    "crank": jt.CrankNicolson(dt=10.0),
    "adaptive": jt.TRBDF2(),
}


@pytest.fixture(scope="module")
def grid():
    return jt.voxelize(jt.shapes.box((0.02, 0.02, 0.02)), 0.01)


def _scene(grid, *terms, count=1, start: Any = 350.0):
    materials = (STEEL, WOOD)[:count]
    bodies = tuple(
        jt.Body(
            jt.FullVolume(grid),
            material,
            temperature=start - 20.0 * n,
            pose=jt.Pose((0.05 * n, 0.0, 0.0)),
        )
        for n, material in enumerate(materials)
    )
    return jt.Scene(bodies, terms, dtype="float64")


@pytest.mark.parametrize(
    ("count", "name"),
    [
        (1, "backward"),
        # Its derivatives, below, are those of Euler steps, whose stages RKL2 has.
        *(pytest.param(1, name, marks=pytest.mark.slow) for name in ("euler", "rkl2")),
        # Their stages are those of backward Euler.
        *(
            pytest.param(1, name, marks=pytest.mark.slow)
            for name in ("crank", "adaptive")
        ),
        # What differs between the solvers does not depend on the number of bodies.
        *(pytest.param(2, name, marks=pytest.mark.slow) for name in SOLVERS),
    ],
)
def test_every_solver_takes_it(grid, name, count):
    """A lump of steel cools as C dT/dt = -A c (T - T_dew)^2 says."""
    scene = _scene(grid, Evaporation(C, DEW), count=count)
    solution = jt.simulate(scene, 100.0, solver=SOLVERS[name])
    heat = solution.energy.mechanisms["evaporation"]
    assert float(heat[-1]) < 0
    assert abs(float(solution.energy.residual_relative[-1])) < 1e-9
    assert solution.receipt.included == ("conduction", "evaporation")
    capacity = 4e6 * 0.02**3
    area = 6 * 0.02**2
    excess = 1 / (1 / (350.0 - DEW) + area * C / capacity * 100.0)
    # The gradient inside steel, and the steps in time, are small.
    actual = float(solution.mean_temperature[-1, 0])
    assert actual - DEW == pytest.approx(excess, rel=0.03)


def test_the_receipt_says_where_it_acts(grid):
    top = jt.Side((0.0, 0.0, 1.0), body=1)
    scene = _scene(grid, Evaporation(C, DEW, on=top), count=2)
    receipt = jt.compile_scene(scene).receipt
    (row,) = receipt.parts
    assert row.bodies == (1,) and row.surface_share == pytest.approx(1 / 6)
    reasons = {omission.what: omission.why for omission in receipt.left_out}
    assert reasons["evaporation on body 0"] == "`on` is on another body"


def test_it_balances_other_terms_in_a_steady_state(grid):
    """A heat flux q is balanced at T = T_dew + sqrt(q / c)."""
    scene = _scene(grid, Evaporation(C, DEW), jt.HeatFlux(200.0))
    solution = jt.steady(scene)
    exact = DEW + np.sqrt(200.0 / C)
    np.testing.assert_allclose(solution.surface_temperature, exact, atol=1e-6)
    rates = solution.heat_rates.mechanisms
    assert float(rates["evaporation"]) == pytest.approx(-float(rates["heat_flux"]))


@pytest.mark.parametrize(
    "solver",
    [
        pytest.param(jt.ForwardEuler(dt=2.0), id="euler"),
        pytest.param(jt.BackwardEuler(dt=10.0), id="be", marks=pytest.mark.slow),
    ],
)
def test_derivatives_are_finite_differences(grid, solver):
    def cooled(coefficient):
        scene = _scene(grid, Evaporation(coefficient, DEW), jt.Surroundings(280.0))
        return jt.simulate(scene, 20.0, solver=solver).surface_temperature.mean()

    temperatures = jax.jit(jax.value_and_grad(cooled))
    slope = float(temperatures(C)[1])
    rise = float(temperatures(C + 1e-4)[0] - temperatures(C - 1e-4)[0]) / 2e-4
    assert slope < -1e-3
    assert slope == pytest.approx(rise, rel=1e-5)
