"""Observed orders: 2 in space, 1 in time for explicit Euler."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import bar, depth, on_top


LENGTH = 0.1
SOLID = jt.Material(conductivity=10.0, density=1000.0, specific_heat=1000.0)
ENDS = tuple(
    jt.FixedTemperature(300.0, on=jt.Side((side, 0.0, 0.0))) for side in (-1.0, 1.0)
)


def _mode(shape_name, cells, dt, end=50.0):
    """Amplitude left of the second eigenmode, and of the same by the closed form."""
    grid = bar(cells, LENGTH / cells)
    shape = {"cosine": np.cos, "sine": np.sin}[shape_name]
    wave = 2 * np.pi / LENGTH
    body = jt.Body(
        jt.FullVolume(grid),
        SOLID,
        temperature=lambda p: 300.0 + shape(wave * (p[:, 0] + LENGTH / 2)),
    )
    scene = jt.Scene((body,), ENDS if shape_name == "sine" else (), dtype="float64")
    solution = jt.simulate(scene, end, solver=jt.ForwardEuler(dt=dt))
    temperature = np.asarray(solution.surface_temperature)[0, on_top(grid)] - 300.0
    exact = np.exp(-SOLID.diffusivity * wave**2 * end) * shape(wave * depth(grid))
    return np.sqrt(np.mean((temperature - exact) ** 2))


# Cosines alone are exact eigenvectors of cells, of second order: test_anisotropic.
@pytest.mark.parametrize(
    "shape_name", [pytest.param("cosine", marks=pytest.mark.slow), "sine"]
)
def test_second_order_in_space(shape_name):
    # dt ~ h^2 keeps the error in time in step; alpha dt = h^2 / 12 leaves space ahead.
    errors = np.array(
        [
            _mode(shape_name, cells, (LENGTH / cells) ** 2 / (12 * SOLID.diffusivity))
            for cells in (10, 20, 40)
        ]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    print("space,", shape_name, errors, "orders", orders)
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_first_order_in_time():
    """Self-convergence, with every mechanism and a load that changes in time."""
    grid = bar(6, 0.01)
    body = jt.Body(jt.FullVolume(grid), SOLID, temperature=350.0)
    terms = (
        jt.Surroundings(280.0),
        jt.Convection(30.0, jt.Table([0.0, 50.0], [300.0, 320.0])),
        jt.HeatFlux(jt.Table([0.0, 50.0], [0.0, 8000.0]), on=jt.Side((1.0, 0.0, 0.0))),
    )
    scene = jt.Scene((body,), terms, dtype="float64")
    ends = [
        np.asarray(
            jt.simulate(scene, 50.0, solver=jt.ForwardEuler(dt)).surface_temperature
        )
        for dt in (1.0, 0.5, 0.25, 0.125)
    ]
    steps = np.array(
        [np.abs(b - a).max() for a, b in zip(ends, ends[1:], strict=False)]
    )
    orders = np.log2(steps[:-1] / steps[1:])
    print("time", steps, "orders", orders)
    np.testing.assert_allclose(orders, 1.0, atol=0.1)
