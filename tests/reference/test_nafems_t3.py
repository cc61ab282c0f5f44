"""V20b, NAFEMS T3: a bar between 0 C and a swinging temperature, at 0.08 m and 32 s.

Source: NAFEMS, The Standard NAFEMS Benchmarks, test T3: k 35 W/(m K), c 440.5 J/(kg K),
rho 7200 kg/m^3, 0.1 m long, 100 sin(pi t / 40 s) C at one end; published 36.60 C.
"""

import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from tests.bodies import bar, depth, on_top


EXACT = 36.6031
"""Temperature of the series solution [C]."""

STEEL = jt.Material(35.0, density=7200.0, specific_heat=440.5)


def _swing(time):
    return 273.15 + 100.0 * jnp.sin(jnp.pi * time / 40.0)


def _at_target(cells: int) -> float:
    """0.08 m from the end at 0 C [C]: 0.02 m from the other; between two cells."""
    grid = bar(cells, 0.1 / cells)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=273.15)
    terms = (
        jt.FixedTemperature(273.15, on=jt.Side((-1.0, 0.0, 0.0))),
        jt.FixedTemperature(_swing, on=jt.Side((1.0, 0.0, 0.0))),
    )
    # A step that goes with the square of the cells: one order of error in all.
    dt = 0.2 * grid.pitch**2 * 7200.0 * 440.5 / 35.0
    scene = jt.Scene((body,), terms, dtype="float64")
    solution = jt.simulate(scene, 32.0, solver=jt.ForwardEuler(dt=dt))
    x = depth(grid)
    # Nothing passes through the long sides, which are as warm as the cells.
    along = np.asarray(solution.surface_temperature[-1])[on_top(grid)] - 273.15
    near = np.argsort(np.abs(x - 0.08))[:4]
    # The cubic through the four nearest cells: its error is below theirs.
    return float(np.polyval(np.polyfit(x[near] - 0.08, along[near], 3), 0.0))


def test_it_converges_to_the_exact_temperature():
    errors = [abs(_at_target(cells) - EXACT) for cells in (20, 40, 80)]
    # Second order, and the cubic's own error, which goes faster.
    assert errors[1] < errors[0] / 3.5 and errors[2] < errors[1] / 3.5
    assert errors[2] < 2e-3
