"""Bounds of temperatures hold, and follow from what is heated locally."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.time_varying import Dose, dose
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.voxels.selection import Everything, Region, Side
from jaxthermo.voxels.voxelize import voxelize
from tests.bodies import bar
from tests.shallow import SHALLOW


START = 300.0
PITCH = 0.01
FOAM = jt.Material(0.03, density=40.0, specific_heat=1400.0, emissivity=0.9)
STEEL = jt.Material(50.0, density=7800.0, specific_heat=500.0, emissivity=0.5)
LIGHT_METAL = jt.Material(50.0, density=20.0, specific_heat=500.0)
AROUND = jt.Surroundings(START)
TOP = Side((0.0, 0.0, 1.0))


def _bar(material=FOAM, x=0.0, cells=12) -> jt.Body:
    structure = jt.FullVolume(bar(cells, PITCH))
    pose = jt.Pose(translation=(x, 0.0, 0.0))
    return jt.Body(structure, material, temperature=START, pose=pose)


def _bounds(scene, end=300.0, **options):
    bounds = compile_scene(scene, 1, end, **options).temperatures
    return float(bounds.lowest), float(bounds.highest)


def _range(scene, end=300.0):
    """Lowest and highest temperature in the bars, whose nodes all have surface [K]."""
    times = np.linspace(end / 30, end, 30).tolist()
    values = jt.simulate(scene, end, times).surface_temperature
    return float(values.min()), float(values.max())


def _rise(material: jt.Material, density: float, seconds: float) -> float:
    specific_heat = material.specific_heat
    assert isinstance(specific_heat, float)
    return density * seconds / (float(material.density) * specific_heat)


END_VOXEL = Region((-0.06, -1.0, -1.0), (-0.05, 1.0, 1.0))


def test_a_small_hot_region_in_a_poor_conductor():
    """The mean of the body rises by a twelfth of its hottest voxel."""
    scene = jt.Scene((_bar(),), (jt.HeatSource(2e4, within=END_VOXEL),))
    lowest, highest = _bounds(scene)
    rise = _rise(FOAM, 2e4, 300.0)
    assert highest == pytest.approx(START + rise, rel=1e-6)
    assert lowest == START
    _, reached = _range(scene)
    assert START + rise / 3 < reached <= highest


def test_a_cold_neighbour_in_contact_with_a_heated_body():
    """The heat of the hot body alone bounds both."""
    bodies = (_bar(), _bar(LIGHT_METAL, x=0.12))
    source = jt.HeatSource(2e4, within=Everything(body=0))
    scene = jt.Scene(bodies, (source, jt.Contact(1e4)))
    _, highest = _bounds(scene)
    assert highest == pytest.approx(START + _rise(FOAM, 2e4, 300.0), rel=1e-6)
    solution = jt.simulate(scene, 300.0)
    metal = solution.surface_temperature[
        -1, len(solution.surfaces[0].geometry.fragment_area) :
    ]
    assert START + 2.0 < float(metal.max()) < highest


@SHALLOW
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_flux_into_a_surface_that_does_not_emit(sign):
    """The emissivity of the surface opposite does not bound it."""
    flux = jt.HeatFlux(sign * 60.0, on=TOP)
    terms = (flux, jt.Surroundings(START, on=Side((0.0, 0.0, -1.0))))
    scene = jt.Scene((_bar(),), terms)
    lowest, highest = _bounds(scene)
    coldest, hottest = _range(scene)
    assert lowest <= coldest
    assert hottest <= highest
    # Half a voxel of foam is between the surface and its node.
    change = _rise(FOAM, 60.0 / PITCH, 300.0) + 60.0 * PITCH / 2 / 0.03
    if sign > 0:
        emitting = (START**4 + 60.0 / (0.9 * STEFAN_BOLTZMANN)) ** 0.25
        assert emitting + 5.0 < hottest
        assert highest < START + change
        assert lowest == START
    else:
        assert lowest == pytest.approx(START - change, rel=1e-6)
        assert coldest < START - 0.4 * change
        assert highest == START


def test_what_is_lost_bounds_a_steady_state():
    """A flux by what emits it, or convects it; a source by its part of each surface."""
    body = _bar(STEEL)
    sun = jt.HeatFlux(800.0)
    emitted = (START**4 + 800.0 / (0.5 * STEFAN_BOLTZMANN)) ** 0.25
    _, highest = _bounds(jt.Scene((body,), (sun, AROUND)), 1e6)
    assert highest == pytest.approx(emitted, rel=1e-6)
    _, highest = _bounds(jt.Scene((body,), (sun, jt.Convection(20.0, START))), 1e6)
    assert highest == pytest.approx(START + 800.0 / 20.0, rel=1e-6)
    # A voxel inside the bar has four faces; its heat reaches them through half cells.
    heated = jt.Scene((body,), (jt.HeatSource(3e5), jt.Convection(20.0, START)))
    flux = 3e5 * PITCH / 4
    expected = START + flux / 20.0 + flux * PITCH / 2 / 50.0
    _, highest = _bounds(heated, 1e6)
    assert highest == pytest.approx(expected, rel=1e-6)
    _, highest = _bounds(heated, 0.0, duration=np.inf)
    assert highest == pytest.approx(expected, rel=1e-6)
    assert START + 0.9 * flux / 20.0 < float(
        jt.steady(heated).surface_temperature.max()
    )
    assert float(jt.steady(heated).surface_temperature.max()) <= expected


def test_a_source_deep_inside_adds_its_rise_to_what_surfaces_lose():
    """The middle one of 27 voxels has no surface that could lose its heat."""
    edge = 3 * PITCH
    cube = voxelize(box((edge, edge, edge)), PITCH)
    body = jt.Body(jt.FullVolume(cube), STEEL, temperature=START)
    half = PITCH / 2
    middle = Region((-half, -half, -half), (half, half, half))
    terms = (
        jt.HeatFlux(800.0),
        jt.Convection(20.0, START),
        jt.HeatSource(3e4, within=middle),
    )
    scene = jt.Scene((body,), terms, dtype="float64")
    _, highest = _bounds(scene, 3600.0)
    level = START + 800.0 / 20.0
    assert highest == pytest.approx(level + _rise(STEEL, 3e4, 3600.0), rel=1e-9)
    _, reached = _range(scene, 3600.0)
    assert level - 2.0 < reached <= highest


@pytest.mark.slow
def test_surfaces_that_radiate_to_each_other_lose_what_escapes():
    """Two heated bars face each other; their ends lose less than their backs."""
    bodies = (_bar(STEEL), _bar(STEEL, x=0.125))
    terms = (jt.HeatSource(2e5), jt.RadiativeExchange(START, directions=256))
    scene = jt.Scene(bodies, terms)
    _, highest = _bounds(scene, 0.0, duration=np.inf)
    reached = float(jt.steady(scene).surface_temperature.max())
    assert reached <= highest < START + 3 * (reached - START)


def test_traced_numbers_have_the_same_bounds():
    def highest(flux, density):
        terms = (jt.HeatFlux(flux), jt.HeatSource(density, within=END_VOXEL), AROUND)
        return compile_scene(jt.Scene((_bar(),), terms), 1, 60.0).temperatures.highest

    assert float(jax.jit(highest)(50.0, 2e4)) == pytest.approx(
        float(highest(50.0, 2e4)), rel=1e-6
    )


@pytest.mark.parametrize(
    ("value", "sign", "expected"),
    [
        (5.0, 1.0, Dose(5.0, 50.0)),
        (-5.0, 1.0, Dose(0.0, 0.0)),
        (-5.0, -1.0, Dose(5.0, 50.0)),
        (jt.Until(5.0, 4.0), 1.0, Dose(5.0, 20.0)),
        (jt.Table([2.0, 3.0, 4.0], [0.0, 8.0, -1.0]), 1.0, Dose(8.0, 16.0)),
        (jt.Table([2.0, 3.0, 4.0], [0.0, 8.0, -1.0]), -1.0, Dose(1.0, 7.0)),
        (jt.Table([-1.0, 20.0], [3.0, 4.0]), 1.0, Dose(4.0, 40.0)),
        (jt.Until(jt.Table([0.0, 20.0], [3.0, 4.0]), 1.0), 1.0, Dose(4.0, 4.0)),
        (lambda t: jnp.where(t < 5.0, 2.0, -2.0), 1.0, Dose(2.0, 10.0)),
    ],
)  # fmt: skip
def test_the_integral_of_what_heats(value, sign, expected):
    largest, integral = dose(value, 10.0, sign)
    assert float(largest) == expected.largest
    assert expected.integral <= float(integral) <= expected.integral * 1.002


def test_bodies_apart_do_not_heat_each_other():
    """A source deep in one body says nothing about the air beside another."""
    middle = Region((-0.01, -0.01, -0.01), (0.01, 0.01, 0.01))
    structure = jt.FullVolume(jt.voxelize(jt.shapes.box((0.05, 0.05, 0.05)), PITCH))
    block = jt.Body(structure, STEEL, temperature=START)
    far = jt.Pose(translation=(1.0, 0.0, 0.0))
    foil = jt.Body(
        jt.FullVolume(bar(4, PITCH)), LIGHT_METAL, temperature=START, pose=far
    )
    source = jt.HeatSource(1e4, within=middle)
    sun = jt.HeatFlux(500.0, on=Side((0.0, 0.0, 1.0), body=1))
    air = jt.Convection(10.0, START)
    _, of_block = _bounds(jt.Scene((block,), (source, air)))
    _, of_foil = _bounds(jt.Scene((foil,), (jt.HeatFlux(500.0, on=TOP), air)))
    _, of_both = _bounds(jt.Scene((block, foil), (source, sun, air)))
    assert of_both == pytest.approx(max(of_block, of_foil), rel=1e-6)
