"""One body of two materials (V11, V13): contact of half-spaces, series resistances."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.reference.semi_infinite import perfect_contact
from tests.bodies import bar, depth, on_top, single_body_scene


COPPER_K = 401.0
STEEL_K = 15.1
COPPER = jt.Material(conductivity=COPPER_K, density=8933.0, specific_heat=385.0)
STEEL = jt.Material(conductivity=STEEL_K, density=8055.0, specific_heat=480.0)
LEFT = jt.Side((-1.0, 0.0, 0.0))
RIGHT = jt.Side((1.0, 0.0, 0.0))


def _painted(grid, base, rest_material, cells):
    """`base` in the first `cells` cells of a bar, `other` in the rest."""
    start = float(grid.origin[0] + cells * grid.pitch)
    wide = 10 * float(grid.pitch) * len(depth(grid))
    region = jt.Region((start, -wide, -wide), (wide, wide, wide))
    return jt.MaterialMap(base, ((region, rest_material),))


@pytest.mark.slow
@pytest.mark.slice
def test_interface_of_copper_and_steel():
    """In copper one diffusion length is 27 cells, in steel 5."""
    pitch = 1e-3
    copper_cells = 165
    steel_cells = 35
    grid = bar(copper_cells + steel_cells, pitch)
    middle = float(grid.origin[0] + copper_cells * pitch)
    end = float((5 * pitch) ** 2 / STEEL.diffusivity)
    solution = jt.simulate(
        single_body_scene(
            grid,
            _painted(grid, base=COPPER, rest_material=STEEL, cells=copper_cells),
            lambda p: np.where(p[:, 0] < middle, 373.15, 273.15),
        ),
        end,
    )
    nodes = np.asarray(solution.surface_temperature)[0, on_top(grid)]
    a = nodes[copper_cells - 1]
    b = nodes[copper_cells]
    k_a = COPPER_K
    k_b = STEEL_K
    interface = (k_a * a + k_b * b) / (k_a + k_b) - 273.15
    exact = perfect_contact(
        100.0,
        temperature_b=0.0,
        effusivity_a=COPPER.effusivity,
        effusivity_b=STEEL.effusivity,
    )
    assert exact == pytest.approx(82.93590583, abs=1e-8)
    assert interface == pytest.approx(exact, abs=0.05)
    # The far ends have not felt the contact: these are half-spaces.
    assert nodes[0] == pytest.approx(373.15, abs=1e-3)
    assert nodes[-1] == pytest.approx(273.15, abs=1e-3)


def _composite(grid, solver):
    """Copper | insulation of the same diffusivity between 0 and 100 K above 300 K."""
    first = jt.Material(401.0, density=401.0, specific_heat=1e4)
    second = jt.Material(0.2, density=0.2, specific_heat=1e4)
    scene = single_body_scene(
        grid,
        _painted(grid, base=first, rest_material=second, cells=3),
        300.0,
        jt.FixedTemperature(400.0, on=LEFT),
        jt.FixedTemperature(300.0, on=RIGHT),
    )
    solution = jt.simulate(scene, 200.0, save_at=[190.0, 200.0], solver=solver)
    return np.asarray(solution.surface_temperature)[:, on_top(grid)]


# By default two layers are exact in a steady state: test_probes.
@pytest.mark.slow
def test_steady_composite_is_exact():
    grid = bar(9, 0.01)
    nodes = _composite(grid, jt.ForwardEuler())
    assert_allclose(nodes[0], nodes[1], atol=1e-10)
    flux = 100.0 / (0.03 / 401.0 + 0.06 / 0.2)
    x = depth(grid)
    hot = 400.0 - flux * x / 401.0
    cold = 300.0 + flux * (0.09 - x) / 0.2
    exact = np.where(x < 0.03, hot, cold)
    assert_allclose(nodes[1] - 300.0, exact - 300.0, rtol=1e-9)


def test_an_insulator_of_no_conductivity_stops_heat_and_no_gradient():
    """S13: traced, since a material with k = 0 is refused at construction."""
    grid = bar(6, 0.01)

    def means(k):
        middle = jt.Material(k, density=1000.0, specific_heat=1000.0)
        base = jt.Material(10.0, density=1000.0, specific_heat=1000.0)
        low, high = (float(grid.origin[0]) + n * 0.01 for n in (2, 4))
        region = jt.Region((low, -1.0, -1.0), (high, 1.0, 1.0))
        body = jt.Body(
            jt.FullVolume(grid),
            jt.MaterialMap(base, ((region, middle),)),
            temperature=300.0,
            surface_map=jt.ConstantMap(),
        )
        terms = (
            jt.FixedTemperature(400.0, on=LEFT),
            jt.Convection(10.0, 250.0),
            jt.Surroundings(300.0),
        )
        scene = jt.Scene((body,), terms, dtype="float64")
        solution = jt.simulate(scene, 20.0, solver=jt.ForwardEuler(dt=1.0))
        return solution.surface_temperature[0, on_top(grid)]

    values, slopes = jax.jit(lambda k: jax.jvp(means, (k,), (1.0 + k,)))(0.0)
    # Nothing enters a cell without conduction, not even through its own surface.
    assert_array_equal(values[2:4], 300.0)
    assert float(values[0]) > 300.0 > float(values[5])
    assert np.isfinite(slopes).all()
    reverse = jax.jit(jax.grad(lambda k: means(k).sum()))(0.0)
    assert float(reverse) == pytest.approx(float(slopes.sum()), rel=1e-10)
