"""V22a, heat_conduction_a of the FDS verification suite: a slab in hot gas.

0.1 m, insulated at the back, alpha 1e-6 m^2/s, k 0.1 W/(m K), from 20 C; gas at 120 C,
h 100 W/(m^2 K). Source: firemodels/fds, Verification/Heat_Transfer; the series solution
agrees with its table within 0.01 K.
"""

import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import bar, depth, on_top


PLACES = np.array([0.0, 0.02, 0.04, 0.06, 0.08, 0.1])
"""From the back [m]."""
EXACT = np.array([24.791, 27.701, 37.429, 55.969, 83.880, 118.217])
"""After 1000 s [C]."""


def _profile(cells: int):
    grid = bar(cells, 0.1 / cells)
    slab = jt.Material(0.1, density=100.0, specific_heat=1000.0)
    body = jt.Body(jt.FullVolume(grid), slab, temperature=293.15)
    gas = jt.Convection(100.0, 393.15, on=jt.Side((1.0, 0.0, 0.0)))
    scene = jt.Scene((body,), (gas,), dtype="float64")
    dt = 0.2 * grid.pitch**2 / 1e-6
    solution = jt.simulate(scene, 1000.0, solver=jt.ForwardEuler(dt=dt))
    surface = np.asarray(solution.surface_temperature[-1]) - 273.15
    front = grid.fragment_normal[:, 0] > 0.9
    # The insulated back is a plane of symmetry; the front's own surface stands last.
    x = depth(grid)
    along = surface[on_top(grid)]
    x = np.concatenate([-x[1::-1], x, [0.1]])
    along = np.concatenate([along[1::-1], along, surface[front]])
    temperatures = []
    for position in PLACES:
        near = np.argsort(np.abs(x - position), kind="stable")[:4]
        fit = np.polyfit((x[near] - position) / grid.pitch, along[near], 3)
        temperatures.append(np.polyval(fit, 0.0))
    return np.array(temperatures)


def test_it_converges_to_the_table():
    errors = [np.abs(_profile(cells) - EXACT).max() for cells in (20, 40)]
    assert errors[1] < 0.01
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
