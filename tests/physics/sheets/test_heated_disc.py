"""A disc that is heated in its middle, and strips that meet in an edge."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.fin_forms import heated_disc, junction
from tests.sheet_bodies import (
    at_nodes,
    disc,
    fragments_of,
    strips_at_an_edge,
    turned,
    turned_back,
)


METAL = jt.Material(500.0, density=8000.0, specific_heat=500.0)
LAYERS = (jt.Layer(METAL, 1e-4),)
K = 0.05
AIR = 300.0


def disc_error(pitch):
    """Rms of the temperature of a heated disc over its range [-]."""
    radius = 0.1
    heated = 0.03
    # The circle of the heated part is one of the rings of the mesh.
    sheet = jt.Sheet(disc(radius, rings=10), LAYERS, pitch=pitch)
    grid = sheet.grid
    distance = np.linalg.norm(np.asarray(grid.fragment_position)[:, :2], axis=1)
    is_heated = (distance < heated) & (np.asarray(grid.fragment_face) == 0)
    mask = jt.FragmentMask(is_heated)
    area = np.asarray(grid.fragment_area)[is_heated].sum()
    heat_flux = 40.0 / area
    terms = (jt.HeatFlux(heat_flux, on=mask), jt.Convection(20.0, AIR))
    scene = jt.Scene((jt.Body(sheet, temperature=AIR),), terms, dtype="float64")
    reading = at_nodes(sheet, jt.steady(scene).surface_temperature[0])
    exact = heated_disc(
        np.linalg.norm(reading.position[:, :2], axis=1),
        radius=radius,
        heated_radius=heated,
        sheet_conductance=K,
        heat_transfer_coefficient=40.0,
        heat_flux=40.0 / (np.pi * heated**2),
    )
    return reading.rms(AIR + exact) / np.ptp(exact)


def test_heated_disc_follows_bessels_functions():
    assert disc_error(0.005) < 0.01


LENGTH = 0.1


def along_strip(sheet, number):
    """Distance of each node from the edge along the direction of a strip [m]."""
    angle = 2 * np.pi * number / 3
    position = turned_back(sheet.nodes().location)
    return position[:, :2] @ [np.cos(angle), np.sin(angle)]


def junction_of_three(loss, pitch):
    """Readings of the nodes, and their distances along three strips [m]."""
    sheet = jt.Sheet(turned(strips_at_an_edge(LENGTH, 0.06)), LAYERS, pitch=pitch)
    ends = [
        jt.FixedTemperature(
            temperature,
            on=fragments_of(sheet, along_strip(sheet, number) > LENGTH - 1e-9),
        )
        for number, temperature in enumerate((AIR + 100.0, AIR, AIR))
    ]
    terms = (*ends, jt.Convection(loss, AIR)) if loss else tuple(ends)
    scene = jt.Scene((jt.Body(sheet, temperature=AIR),), terms, dtype="float64")
    reading = at_nodes(sheet, jt.steady(scene).surface_temperature[0])
    return reading, [along_strip(sheet, number) for number in range(3)]


def test_three_strips_meet_at_a_third_of_the_temperature():
    reading, ways = junction_of_three(loss=0.0, pitch=0.01)
    # Nodes at the edge hold parts of all three strips: they are near it, not on it.
    for way in ways:
        is_on_strip = way > 0.015
        _, at_edge = np.polyfit(
            way[is_on_strip], reading.temperature[is_on_strip] - AIR, 1
        )
        assert at_edge == pytest.approx(100 / 3, rel=1e-4)


@pytest.mark.slow
def test_three_strips_with_a_loss_are_fins_of_one_base():
    loss = 10.0
    reading, ways = junction_of_three(loss=loss, pitch=0.005)
    at_edge = junction(
        (100.0, 0.0, 0.0),
        length=(LENGTH,) * 3,
        sheet_conductance=(K,) * 3,
        heat_transfer_coefficient=(2 * loss,) * 3,
    )
    m = np.sqrt(2 * loss / K)
    for way, end in zip(ways, (100.0, 0.0, 0.0), strict=True):
        on_strip = way > 0.005
        inner = at_edge * np.sinh(m * (LENGTH - way)) + end * np.sinh(m * way)
        exact = AIR + inner / np.sinh(m * LENGTH)
        deviation = (reading.temperature - exact)[on_strip]
        assert np.sqrt(np.mean(deviation**2)) < 0.01 * 100.0
