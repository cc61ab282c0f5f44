"""The numbers of a scene, of a box where each is known."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.scene.dimensionless_groups import scene_numbers
from tests.bodies import blocks


def test_numbers_of_a_cube():
    """V / A of a cube is a sixth of its edge."""
    cube = jt.FullVolume(blocks(np.ones((6, 6, 6), bool), 0.01))
    metal = jt.Material(20.0, density=8000.0, specific_heat=500.0, absorptivity=0.5)
    body = jt.Body(cube, metal, temperature=300.0)
    terms = (
        jt.Sun((0.0, 0.0, -1.0), jt.Until(1000.0, 5.0)),
        jt.Convection(10.0, 290.0),
        jt.HeatFlux(-200.0, on=jt.Side((1.0, 0.0, 0.0))),
    )
    actual = scene_numbers(jt.Scene((body,), terms), 100.0)
    assert actual["biot"] == pytest.approx(10.0 * 0.01 / 20.0)
    assert actual["fourier"] == pytest.approx(20.0 / 4e6 * 100.0 / 0.01**2)
    assert actual["voxels_across"] == pytest.approx(1.0)
    assert actual["heating"] == pytest.approx(700.0 * 0.01 / 20.0)


def test_radiation_counts_as_a_coefficient():
    cube = jt.FullVolume(blocks(np.ones((6, 6, 6), bool), 0.01))
    metal = jt.Material(20.0, density=8000.0, specific_heat=500.0, emissivity=0.5)
    scene = jt.Scene(
        (jt.Body(cube, metal, temperature=300.0),), (jt.Surroundings(280.0),)
    )
    h = 0.5 * 4 * 5.670374419e-8 * 300.0**3
    assert scene_numbers(scene, 1.0)["biot"] == pytest.approx(h * 0.01 / 20.0)


def test_a_start_that_varies_counts_with_its_mean():
    cube = jt.FullVolume(blocks(np.ones((6, 6, 6), bool), 0.01))
    metal = jt.Material(
        jt.Property([300.0, 900.0], [20.0, 40.0]), density=8000.0, specific_heat=500.0
    )
    terms = (jt.Surroundings(280.0), jt.Convection(10.0, 290.0))

    def numbers(start):
        body = jt.Body(cube, metal, temperature=start)
        return scene_numbers(jt.Scene((body,), terms), 100.0)

    middle = cube.nodes().location[:, 0].mean()
    slope = 2000.0
    varied = numbers(lambda at: 600.0 + slope * (at[:, 0] - middle))
    assert varied == pytest.approx(numbers(600.0))
    assert varied["biot"] > 2.0 * numbers(300.0)["biot"]


def test_air_within_a_sheet_has_no_numbers():
    box = jt.shapes.box((0.4, 0.4, 0.4))
    wall = jt.Body(jt.Sheet(box, (jt.Layer("steel", 1e-3),), 0.2), temperature=300.0)
    air = jt.Body(jt.AirVolume(0.064), temperature=300.0)
    terms = (jt.Convection(10.0, 290.0), jt.EnclosedAir(5.0, body=0, air=1))
    numbers = scene_numbers(jt.Scene((wall, air), terms), 100.0)
    alone = scene_numbers(jt.Scene((wall,), terms[:1]), 100.0)
    assert numbers["fourier"] == alone["fourier"]
    assert numbers["biot"] >= alone["biot"]


SIDE = jt.Side((1.0, 0.0, 0.0))
HALF = jt.Region((-1.0, -1.0, -1.0), (0.03, 1.0, 1.0))


@pytest.mark.parametrize(
    ("by_heat_rate", "by_density"),
    [
        (jt.HeatFlux(heat_rate=-1.8, on=SIDE), jt.HeatFlux(-500.0, on=SIDE)),
        (jt.HeatFlux(heat_rate=10.8), jt.HeatFlux(500.0)),
        (
            jt.HeatSource(heat_rate=jt.Until(5.4, 2.0), within=HALF),
            jt.HeatSource(heat_rate_density=5e4, within=HALF),
        ),
        (jt.HeatSource(heat_rate=10.8), jt.HeatSource(heat_rate_density=5e4)),
    ],
)
def test_a_heat_rate_heats_as_its_flux_or_density(by_heat_rate, by_density):
    """500 W/m^2, or 5e4 W/m^3 with V / A of 0.01 m."""
    cube = jt.FullVolume(blocks(np.ones((6, 6, 6), bool), 0.01))
    metal = jt.Material(20.0, density=8000.0, specific_heat=500.0)
    body = jt.Body(cube, metal, temperature=300.0)
    for term in (by_heat_rate, by_density):
        actual = scene_numbers(jt.Scene((body,), (term,)), 100.0)
        assert actual["heating"] == pytest.approx(500.0 * 0.01 / 20.0)
