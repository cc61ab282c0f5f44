"""A fin held at its base and cooled on both faces, against its cosh law.

The strip is turned in space and badly triangulated; K = k d = 0.05 W/K.
"""

import functools

import numpy as np
import pytest

import jaxthermo as jt
from tests.fin_forms import fin, fin_heat_rate
from tests.sheet_bodies import (
    at_nodes,
    badly_meshed_strip,
    fragments_of,
    turned,
    turned_back,
)


LENGTH = 0.3
WIDTH = 0.1
K = 0.05
H = 20.0
# Thin and highly conductive: the base is held through half of the thickness, whose
# resistance the law does not have.
METAL = jt.Material(500.0, density=8000.0, specific_heat=500.0)
LAYERS = (jt.Layer(METAL, K / 500.0),)
AIR = 300.0
BASE = 400.0
LOAD = {"sheet_conductance": K, "heat_transfer_coefficient": 2 * H}

PROTOTYPE_RMS = {0.02: 0.012, 0.01: 0.0032, 0.005: 0.0006}
PROTOTYPE_NODES = {0.02: 135, 0.01: 485, 0.005: 1822}
PROTOTYPE_HEAT_ERROR = {0.02: 0.15, 0.01: 0.032, 0.005: 0.006}


FINEST = 0.005


@functools.cache
def fin_errors(pitch):
    """Nodes, rms over the excess of the base [-], and error of its heat rate [-]."""
    sheet = jt.Sheet(turned(badly_meshed_strip(LENGTH, WIDTH)), LAYERS, pitch=pitch)
    x = turned_back(sheet.nodes().location)[:, 0]
    is_base = x < 1e-9
    base = jt.FixedTemperature(BASE, on=fragments_of(sheet, is_base))
    scene = jt.Scene(
        (jt.Body(sheet, temperature=AIR),),
        (base, jt.Convection(H, AIR)),
        dtype="float64",
    )
    solution = jt.steady(scene)
    reading = at_nodes(sheet, solution.surface_temperature[0])
    way = turned_back(reading.position)[:, 0]
    reading = reading._replace(temperature=(reading.temperature - AIR) / (BASE - AIR))
    exact_rate = (BASE - AIR) * fin_heat_rate(length=LENGTH, width=WIDTH, **LOAD)
    # Air cools the held nodes, too, which is none of the heat that holds them.
    held = sheet.nodes().volume[is_base].sum() / LAYERS[0].thickness
    rate = float(solution.heat_rates.mechanisms["fixed_temperature"])
    rate += 2 * H * held * (BASE - AIR)
    return (
        sheet.node_count,
        reading.rms(fin(way, length=LENGTH, **LOAD)),
        rate / exact_rate - 1,
    )


@pytest.mark.parametrize(
    "pitch", [0.02, 0.01, pytest.param(FINEST, marks=pytest.mark.slow)]
)
def test_fin_follows_its_law(pitch):
    nodes, rms, heat_error = fin_errors(pitch)
    assert nodes <= 1.1 * PROTOTYPE_NODES[pitch]
    assert rms <= PROTOTYPE_RMS[pitch]
    assert abs(heat_error) <= PROTOTYPE_HEAT_ERROR[pitch]


@pytest.mark.slow
def test_fin_converges_at_second_order():
    assert np.log2(fin_errors(0.01)[1] / fin_errors(FINEST)[1]) >= 1.8
