"""Thin bodies that conduct well follow the law of one capacity, in float32 too.

With the Biot number near 0 the body is uniform, and between two gases

    T(t) = T_end + (T_0 - T_end) exp(-(h_1 + h_2) t / (rho c L)).

Hundreds of thousands of stable steps are taken by stages, whose rounding must not lose
heat.
"""

from typing import NamedTuple

import numpy as np
import pytest

import jaxthermo as jt


class Metal(NamedTuple):
    """Conductivity [W/(m K)], density [kg/m^3] and specific heat [J/(kg K)]."""

    conductivity: float
    density: float
    specific_heat: float


ALUMINIUM = Metal(237.0, density=2700.0, specific_heat=900.0)
COPPER = Metal(398.0, density=8930.0, specific_heat=385.0)
SILVER = Metal(429.0, density=10500.0, specific_heat=235.0)

START = 298.15
FRONT = jt.Side((1.0, 0.0, 0.0))
BACK = jt.Side((-1.0, 0.0, 0.0))

SHEETS = [
    (ALUMINIUM, 1e-3, 1),
    (ALUMINIUM, 5e-4, 1),
    (ALUMINIUM, 2e-4, 1),
    (ALUMINIUM, 2e-3, 4),
    (COPPER, 5e-4, 1),
    (COPPER, 1e-4, 1),
    (COPPER, 35e-6, 1),
    (SILVER, 3e-4, 1),
]
DEFAULT = (1, 6)


def _cases():
    for number, sheet in enumerate(SHEETS):
        marks = () if number in DEFAULT else (pytest.mark.slow,)
        for is_heated in (True, False):
            yield pytest.param(*sheet, is_heated, marks=marks)


def _off(scene, time_constant, end_temperature):
    """Largest deviation from the law over its whole rise [-], and the solution."""
    times = time_constant * np.array([1.0, 3.0, 10.0])
    solution = jt.simulate(scene, times[-1], save_at=list(times))
    rise = end_temperature - START
    exact = START + rise * (1 - np.exp(-times / time_constant))
    mean = np.asarray(solution.mean_temperature, float)[:, 0]
    assert not solution.run.warnings
    assert np.abs(np.asarray(solution.energy.residual_relative)).max() < 1e-5
    return np.abs(mean - exact).max() / rise


@pytest.mark.parametrize(("metal", "thickness", "layers", "is_heated"), list(_cases()))
def test_a_sheet_is_one_capacity(metal, thickness, layers, is_heated):
    pitch = thickness / layers
    grid = jt.voxelize(jt.shapes.box((thickness, 8 * pitch, 8 * pitch)), pitch)
    terms = (
        jt.HeatFlux(1250.0, on=FRONT),
        jt.Convection(10.0, START, on=FRONT),
        jt.Convection(10.0, START, on=BACK),
    )
    loss = 20.0
    end = START + 1250.0 / loss
    if not is_heated:
        terms = (
            jt.Convection(50.0, 773.0, on=FRONT),
            jt.Convection(50.0, 293.0, on=BACK),
        )
        loss = 100.0
        end = (773.0 + 293.0) / 2
    body = jt.Body(jt.FullVolume(grid), jt.Material(*metal), temperature=START)
    capacity = metal.density * metal.specific_heat * thickness
    scene = jt.Scene((body,), terms, dtype="float32")
    assert _off(scene, capacity / loss, end) < 2e-4


def test_a_small_cube_of_high_conductivity_is_one_capacity():
    grid = jt.voxelize(jt.shapes.box((1e-3, 1e-3, 1e-3)), 2e-4)
    material = jt.Material(2000.0, density=3500.0, specific_heat=510.0)
    # Three million stable steps.
    time_constant = 1.8
    coefficient = 3500.0 * 510.0 * 1e-3 / 6 / time_constant
    terms = (jt.HeatFlux(100 * coefficient), jt.Convection(coefficient, START))
    body = jt.Body(jt.FullVolume(grid), material, temperature=START)
    scene = jt.Scene((body,), terms, dtype="float32")
    assert _off(scene, time_constant, START + 100.0) < 2e-4
