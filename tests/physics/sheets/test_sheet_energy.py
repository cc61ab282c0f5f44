"""Heat of sheets: nothing is lost over a day, whatever the precision."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.sheet_bodies import FRONT, open_cylinder


DAY = 86400.0
TIMES = np.linspace(0.0, DAY, 25)
AIR = jt.Table(TIMES, 285.0 + 8.0 * np.sin(2 * np.pi * (TIMES - 32400.0) / DAY))
SUN = jt.Table(
    TIMES, 900.0 * np.maximum(0.0, np.sin(2 * np.pi * (TIMES - 21600.0) / DAY))
)
TERMS = (
    jt.Sun((-0.5, 0.2, -0.8), SUN),
    jt.DiffuseSky(80.0, reflected=20.0),
    jt.Surroundings(270.0, ground=288.0),
    jt.Convection(14.0, AIR),
)


LAYERS = {
    "thin": (jt.Layer("steel", 0.8e-3),),
    "thick": (jt.Layer("steel", 0.8e-3), jt.Layer("concrete", 0.05)),
}
LIMITS = {"float32": 1e-5, "float64": 1e-11}
DEFAULT = {("thin", "float32"), ("thick", "float64")}


@pytest.mark.parametrize(
    ("stack", "dtype"),
    [
        pytest.param(
            stack, dtype, marks=() if (stack, dtype) in DEFAULT else pytest.mark.slow
        )
        for stack in LAYERS
        for dtype in LIMITS
    ],
)
def test_energy_closes_over_a_day(stack, dtype):
    layers = LAYERS[stack]
    sheet = jt.Sheet(open_cylinder(0.3, 0.5, 16), layers, pitch=0.1)
    scene = jt.Scene((jt.Body(sheet, temperature=285.0),), TERMS, dtype=dtype)
    solution = jt.simulate(scene, DAY, save_at=[DAY / 4, DAY / 2, DAY])
    assert np.ptp(np.asarray(solution.mean_temperature)) > 2
    assert np.abs(np.asarray(solution.energy.residual_relative)).max() < LIMITS[dtype]


def test_a_sheet_keeps_the_heat_of_its_layers():
    layers = LAYERS["thick"]
    mesh = open_cylinder(0.3, 0.5, 16)
    sheet = jt.Sheet(mesh, layers, pitch=0.1)
    scene = jt.Scene(
        (jt.Body(sheet, temperature=285.0),),
        (jt.HeatFlux(100.0, on=FRONT),),
        dtype="float64",
    )
    solution = jt.simulate(scene, 600.0)
    heat = 100.0 * 600.0
    capacity = sum(
        layer.thickness * layer.material.volumetric_heat_capacity for layer in layers
    )
    rise = float(solution.mean_temperature[0, 0]) - 285.0
    assert rise == pytest.approx(heat / capacity, rel=1e-9)
    stored = float(solution.energy.mechanisms["heat_flux"][0])
    assert stored == pytest.approx(heat * mesh.area, rel=1e-9)
