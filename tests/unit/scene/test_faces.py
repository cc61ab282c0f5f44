"""The two faces of a sheet, which terms, coatings and combinations select."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.voxels.fractions import area_fractions


STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.3)
SHEET = jt.Sheet(jt.shapes.rectangle(1.0, 0.5), (jt.Layer(STEEL, 1e-3),), pitch=0.1)
GRID = SHEET.grid
FRONT = jt.Face("front")
BACK = jt.Face("back")


def area(on):
    return area_fractions(on, GRID) @ GRID.fragment_area


def test_each_face_has_the_area_of_the_mesh():
    assert_allclose(area(FRONT), 0.5, rtol=1e-12)
    assert_allclose(area(BACK), 0.5, rtol=1e-12)
    assert_allclose(area_fractions(~FRONT, GRID), area_fractions(BACK, GRID))
    assert area(FRONT & BACK) == 0


def test_a_region_divides_the_fragments_of_one_face():
    left = jt.Region((-9.0, -9.0, -9.0), (0.0, 9.0, 9.0))
    assert_allclose(area(left), 0.5, rtol=0.02)
    assert_allclose(area(left & FRONT), area(left) / 2, rtol=1e-12)
    assert_allclose(area(left | FRONT), 0.5 + area(left) / 2, rtol=1e-12)


def test_terms_act_on_the_face_that_they_name():
    body = jt.Body(SHEET, temperature=300.0)
    flux = jt.HeatFlux(100.0, on=FRONT)
    both = jt.HeatFlux(100.0)
    solution = jt.simulate(jt.Scene((body,), (flux,), dtype="float64"), 10.0)
    twice = jt.simulate(jt.Scene((body,), (both,), dtype="float64"), 10.0)
    rise = np.asarray(solution.mean_temperature)[-1, 0] - 300.0
    assert_allclose(rise, 100.0 * 10.0 / (1e-3 * 7850.0 * 480.0), rtol=1e-9)
    assert_allclose(twice.mean_temperature[-1, 0] - 300.0, 2 * rise, rtol=1e-9)


def test_a_coating_is_on_its_face():
    paint = jt.Coating(0.9, on=BACK)
    body = jt.Body(SHEET, temperature=300.0, coatings=(paint,))
    terms = (jt.Surroundings(200.0, on=FRONT), jt.Surroundings(200.0, on=BACK))
    rates = []
    for term in terms:
        scene = jt.Scene((body,), (term,), dtype="float64")
        rates.append(300.0 - jt.simulate(scene, 1.0).mean_temperature[-1, 0])
    assert_allclose(rates[1], 3 * rates[0], rtol=1e-3)


@pytest.mark.parametrize("on", [FRONT, ~BACK, jt.Side((0.0, 0.0, 1.0)) & FRONT])
def test_a_solid_has_no_faces(on):
    grid = jt.voxelize(jt.shapes.box((1.0, 1.0, 1.0)), 0.25)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0)
    scene = jt.Scene((body,), (jt.HeatFlux(1.0, on=on),))
    with pytest.raises(jt.InputError, match="body 0 is solid and has no face of that"):
        jt.compile_scene(scene)
    coated = jt.Body(
        jt.FullVolume(grid),
        STEEL,
        temperature=300.0,
        coatings=(jt.Coating(0.9, on=on),),
    )
    with pytest.raises(jt.InputError, match=r"coatings\[0\].*has no face of that"):
        jt.compile_scene(jt.Scene((coated,)))


GROUND = jt.Sheet(
    jt.shapes.rectangle(1.0, 0.5),
    (jt.Layer(STEEL, 0.1),),
    pitch=0.25,
    cells=4,
    back="adiabatic",
)


def run_ground(*terms):
    body = jt.Body(GROUND, temperature=300.0)
    return jt.Scene((body,), terms, dtype="float64")


@pytest.mark.parametrize(
    "term",
    [
        jt.HeatFlux(100.0),
        jt.HeatFlux(heat_rate=50.0),
        jt.HeatFlux(100.0, on=jt.Everything()),
        jt.HeatFlux(100.0, on=FRONT),
        jt.Sun((0.0, 0.0, -1.0), 100.0, on=FRONT | jt.Face("front", body=0)),
        jt.Sun((0.0, 0.0, 1.0), 100.0),
        # The front is named, and the rest selected by its position.
        jt.HeatFlux(100.0, on=jt.Face("front") | jt.Everything()),
    ],
)
def test_terms_reach_no_adiabatic_back(term):
    receipt = jt.compile_scene(run_ground(term)).receipt
    heated = [part.area for part in receipt.parts]
    up = not (isinstance(term, jt.Sun) and term.direction == (0.0, 0.0, 1.0))
    assert_allclose(heated, [0.5] if up else [], rtol=1e-9)


@pytest.mark.parametrize(
    ("on", "area"),
    [
        (BACK | jt.Side((0.0, 0.0, 1.0)), 1.0),
        (BACK & jt.Region((0.0, -1.0, -1.0), (1.0, 1.0, 1.0)), 0.25),
        (~jt.Face("front"), 0.5),
    ],
)
def test_a_combination_reaches_the_adiabatic_back_that_it_names(on, area):
    receipt = jt.compile_scene(run_ground(jt.HeatFlux(100.0, on=on))).receipt
    assert_allclose([part.area for part in receipt.parts], [area], rtol=1e-9)


def test_the_cells_of_an_adiabatic_back_are_wider():
    widths = np.array(GROUND.divisions[0]).ravel()
    assert (np.diff(widths) > 0).all()


def test_an_adiabatic_back_that_is_named_is_held():
    held = jt.FixedTemperature(280.0, on=BACK)
    air = jt.Convection(20.0, 320.0)
    steady = jt.steady(run_ground(held, air))
    flux = (320.0 - 280.0) / (1 / 20.0 + 0.1 / 45.0)
    at_front = 280.0 + flux * 0.1 / 45.0
    temperature = np.asarray(steady.surface_temperature).reshape(2, -1)
    assert_allclose(temperature[0], at_front, rtol=1e-8)
    assert_allclose(temperature[1], 280.0, rtol=1e-9)


def test_an_adiabatic_back_does_not_radiate():
    exchange = jt.RadiativeExchange(250.0)
    emission = jt.Surroundings(250.0)
    rates = [
        300.0 - jt.simulate(run_ground(term), 60.0).mean_temperature[-1, 0]
        for term in (exchange, emission)
    ]
    flux = 0.3 * 5.670374419e-8 * (300.0**4 - 250.0**4)
    assert_allclose(rates, flux * 60.0 / (0.1 * 7850.0 * 480.0), rtol=2e-3)
