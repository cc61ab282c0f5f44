"""Parts of a sheet with layers of their own, joined along an edge."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.sheet_bodies import at_nodes, fragments_of, plate


LENGTH = 0.1
COPPER = jt.Layer(jt.Material(400.0, density=8900.0, specific_heat=385.0), 0.1e-3)
STEEL = jt.Layer(jt.Material(20.0, density=7800.0, specific_heat=460.0), 0.5e-3)


def strip_from(start):
    """A strip of two squares along x."""
    mesh = plate(LENGTH, 0.05, divisions=4)
    return jt.Mesh(mesh.vertices + [start + LENGTH / 2, 0.0, 0.0], mesh.faces)


@pytest.fixture(scope="module")
def strip():
    """Copper, then steel."""
    parts = {"copper": strip_from(0.0), "steel": strip_from(LENGTH)}
    layers = {"copper": (COPPER,), "steel": (STEEL,)}
    return jt.Sheet(parts, layers, pitch=0.01)


def test_heat_flows_through_parts_in_series(strip):
    x = strip.nodes().location[:, 0]
    ends = (
        jt.FixedTemperature(400.0, on=fragments_of(strip, x < 1e-9)),
        jt.FixedTemperature(300.0, on=fragments_of(strip, x > 2 * LENGTH - 1e-9)),
    )
    scene = jt.Scene((jt.Body(strip, temperature=300.0),), ends, dtype="float64")
    reading = at_nodes(strip, jt.steady(scene).surface_temperature[0])
    first = LENGTH / (400.0 * 0.1e-3)
    second = LENGTH / (20.0 * 0.5e-3)
    between = 400.0 - 100.0 * first / (first + second)
    exact = np.interp(
        reading.position[:, 0], [0.0, LENGTH, 2 * LENGTH], [400.0, between, 300.0]
    )
    # A node on both parts is at one point, and holds heat on both sides of the edge.
    assert np.abs(reading.temperature - exact).max() < 0.01 * 100.0
    assert reading.rms(exact) < 0.003 * 100.0


def test_every_part_keeps_its_heat(strip):
    scene = jt.Scene(
        (jt.Body(strip, temperature=300.0),),
        (jt.HeatFlux(50.0, on=jt.Face("front", body=0)),),
        dtype="float64",
    )
    solution = jt.simulate(scene, 100.0)
    capacity = sum(float(layer.capacity) for layer in (COPPER, STEEL)) / 2
    rise = float(solution.mean_temperature[0, 0]) - 300.0
    assert rise == pytest.approx(50.0 * 100.0 / capacity, rel=1e-9)
