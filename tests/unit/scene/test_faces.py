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
