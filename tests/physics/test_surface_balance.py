"""The balance at the surface: all mechanisms act at the surface's own temperature."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.physics.boundary import Exchange, ImposedFlux
from jaxthermo.physics.flux_law import bound
from jaxthermo.physics.half_cells import Extremes
from jaxthermo.physics.radiation.emission import _Emission
from jaxthermo.physics.surface_energy_balance import SurfaceTerms
from tests.bodies import bar, single_body_scene
from tests.shallow import SHALLOW


INSULATION = jt.Material(0.03, density=30.0, specific_heat=1000.0, emissivity=0.9)
FRONT = jt.Side(normal=(1.0, 0.0, 0.0))
FLUX = 1000.0
H = 10.0
AIR = 290.0
CONSTANT = Extremes(lowest=jnp.array(1.0), highest=jnp.array(1.0))


def _at_rest(pitch, cells=2):
    """Surface temperature and solution of an insulated bar at rest in sun and air."""
    scene = single_body_scene(
        bar(cells, pitch),
        INSULATION,
        AIR,
        jt.HeatFlux(FLUX, on=FRONT),
        jt.Convection(H, AIR, on=FRONT),
    )
    # Euler steps end at rest to rounding, RKL2 only to the error that it is given.
    solution = jt.simulate(scene, 2e6, solver=jt.ForwardEuler())
    normal = bar(cells, pitch).fragment_normal
    front = np.flatnonzero(normal[:, 0] > 0.9)
    surface = float(np.asarray(solution.surface_temperature)[0, front].mean())
    return surface, solution


@pytest.mark.parametrize("pitch", [0.02, 0.005])
def test_an_insulator_in_the_sun_is_right_at_any_pitch(pitch):
    """At rest h (T_s - T_air) = q'', and nothing flows inside."""
    surface, solution = _at_rest(pitch)
    assert surface == pytest.approx(AIR + FLUX / H, abs=1e-6)
    mean = float(solution.mean_temperature[0, 0])
    assert mean == pytest.approx(AIR + FLUX / H, abs=1e-6)


def test_the_ledger_closes_where_mechanisms_oppose_each_other():
    _, solution = _at_rest(0.01)
    assert abs(float(solution.energy.residual_relative[0])) < 1e-12


def _surface(half_cell, *laws, share=2.0):
    terms = tuple((n, bound(jnp.full(1, share), law)) for n, law in enumerate(laws))
    names = tuple(f"term{n}" for n in range(len(laws)))
    return SurfaceTerms(
        names=names, half_cell=jnp.full(1, half_cell), natural=terms, prescribed=()
    )


def _laws(flux, h, ambient, reference=280.0):
    reference = jnp.array(reference)
    return (
        ImposedFlux(jnp.array(flux)),
        Exchange(jnp.array(h), jnp.array(AIR), reference),
        _Emission(jnp.array(ambient), reference),
    )


@eqx.filter_jit
def _all_of(surface, theta):
    """One program for every case: its numbers are all arguments."""
    time = jnp.zeros(())
    return surface.surface_excess(time, theta), *surface.heat(time, theta)


def _bisected(half_cell, flux, h, ambient, node, share=2.0):
    """Surface temperature by bisection [K]."""
    low = 0.0
    high = 1e5
    for _ in range(200):
        middle = (low + high) / 2
        emitted = STEFAN_BOLTZMANN * (ambient**4 - middle**4)
        heat = share * (flux + h * (AIR - middle) + emitted)
        hotter = heat > half_cell * (middle - node)
        low, high = (middle, high) if hotter else (low, middle)
    return low


@pytest.mark.parametrize("half_cell", [1e-6, 0.05, 10.0, 1e5])
@pytest.mark.parametrize(
    ("flux", "h", "ambient", "node"),
    [
        (0.0, 0.0, 300.0, 300.0),
        (1000.0, 5.0, 0.0, 300.0),
        (5e6, 5.0, 300.0, 10.0),
        (0.0, 50.0, 5800.0, 3.0),
        (-50.0, 2.0, 280.0, 400.0),
        (1.0, 0.0, 0.0, 1000.0),
    ],
)
def test_against_bisection(half_cell, flux, h, ambient, node):
    exact = _bisected(half_cell, flux=flux, h=h, ambient=ambient, node=node)
    surface = _surface(half_cell, *_laws(flux, h, ambient))
    theta = jnp.full(1, node - 280.0)
    excesses, heat, by_term = _all_of(surface, theta)
    excess = float(excesses[0])
    assert node + excess == pytest.approx(exact, rel=1e-6)
    scale = float(jnp.abs(by_term).max()) + 1e-30
    assert float(heat[0]) == pytest.approx(float(by_term.sum()), abs=1e-12 * scale)
    carried = half_cell * excess
    assert float(heat[0]) == pytest.approx(carried, abs=1e-9 * scale)


def test_what_holds_a_surface_goes_straight_to_the_node():
    hold = Exchange(jnp.array(1.0), jnp.array(350.0), jnp.array(280.0))
    held = ((0, bound(jnp.full(1, 7.0), hold)),)
    surface = SurfaceTerms(
        names=("hold",), half_cell=jnp.zeros(1), natural=(), prescribed=held
    )
    theta = jnp.full(1, 20.0)
    heat, _ = surface.heat(jnp.array(0.0), theta)
    assert float(heat[0]) == pytest.approx(7.0 * 50.0)
    assert float(surface.surface_excess(jnp.array(0.0), theta)[0]) == 50.0
    assert float(surface.stiffness(jnp.array(400.0), 1.0, CONSTANT)[0]) == 7.0


def test_stiffness_is_the_slope_of_the_heat_rate():
    surface = _surface(3.0, *_laws(500.0, 8.0, 300.0))
    heat = jax.jit(lambda theta: surface.heat(jnp.array(0.0), theta)[0].sum())
    theta = jnp.full(1, 40.0)
    surface_temperature = 320.0 + float(
        surface.surface_excess(jnp.array(0.0), theta)[0]
    )
    slope = -float(jax.grad(heat)(theta)[0])
    step = 1e-3
    exact = -float(heat(theta + step) - heat(theta - step)) / (2 * step)
    assert slope == pytest.approx(exact, rel=1e-6)
    bound_ = float(surface.stiffness(jnp.array(surface_temperature), 1.0, CONSTANT)[0])
    assert slope == pytest.approx(bound_, rel=1e-6)


@SHALLOW
def test_fragments_of_a_corner_do_not_share_their_half_cells():
    """A voxel convects through one face only: the others are no way out."""
    cube = bar(1, 0.1)
    held = jt.FixedTemperature(300.0, on=FRONT)
    blown = jt.Convection(1e9, 300.0, on=FRONT)
    means = []
    for term in (held, blown):
        scene = single_body_scene(cube, INSULATION, 400.0, term)
        solution = jt.simulate(scene, 5e3, solver=jt.ForwardEuler(100.0))
        means.append(float(solution.mean_temperature[0, 0]))
    assert means[0] == pytest.approx(means[1], rel=1e-7)
    assert means[0] < 390.0


def test_two_holds_of_one_body_share_nothing():
    behind = jt.Side((-1.0, 0.0, 0.0))
    scene = single_body_scene(
        bar(3, 0.1),
        INSULATION,
        300.0,
        jt.FixedTemperature(500.0, on=behind),
        jt.FixedTemperature(350.0, on=FRONT),
    )
    surface = np.asarray(
        jt.simulate(scene, 10.0, solver=jt.ForwardEuler()).surface_temperature
    )[0]
    normal = bar(3, 0.1).fragment_normal[:, 0]
    assert_allclose(surface[normal > 0.9], 350.0)
    assert_allclose(surface[normal < -0.9], 500.0)
