"""Emissivity by the angle on both faces of a sheet."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from tests.imaging import apparent, metal
from tests.sheet_bodies import BACK, FRONT, plate, turned


EMISSIVITY = {"front": 0.9, "back": 0.6}


@pytest.fixture(scope="module")
def sheet():
    return jt.Sheet(turned(plate(0.4, 0.3)), (jt.Layer(metal(0.5), 1e-3),), pitch=0.1)


@pytest.fixture(scope="module")
def solution(sheet):
    """A turned plate of 320 K, as its coatings radiate, in a room of 280 K."""
    coatings = (
        jt.Coating(emissivity=EMISSIVITY["front"], on=FRONT),
        jt.Coating(emissivity=EMISSIVITY["back"], on=BACK),
    )
    body = jt.Body(sheet, temperature=320.0, coatings=coatings)
    return jt.simulate(jt.Scene((body,), (jt.Surroundings(280.0),)), 0.0)


@pytest.mark.parametrize("face", EMISSIVITY)
@pytest.mark.parametrize("degrees", [0.0, 40.0, 75.0])
def test_each_face_emits_by_its_angle(sheet, solution, face, degrees):
    middle = sheet.grid.fragment_position.mean(axis=0)
    normal = sheet.grid.fragment_normal[0] * (1.0 if face == "front" else -1.0)
    along = np.cross(normal, [0.3, -0.5, 0.8])
    along /= np.linalg.norm(along)
    angle = np.deg2rad(degrees)
    sight = np.cos(angle) * normal + np.sin(angle) * along
    camera = jt.OrthographicCamera(
        tuple(middle + 2.0 * sight), tuple(middle), 0.03, width=9, height=7
    )
    image = jt.render(solution, camera, band=None, effects=(jt.AngularEmissivity(),))
    emissivity = EMISSIVITY[face] * (1 - (1 - np.cos(angle)) ** 5)
    seen = np.asarray(image.object_id) == 0
    assert seen.all()
    assert_allclose(image.emissivity, emissivity, rtol=1e-5)
    expected = (emissivity * 320.0**4 + (1 - emissivity) * 280.0**4) ** 0.25
    assert_allclose(apparent(image), expected, rtol=1e-5)
