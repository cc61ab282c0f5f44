"""Sheets shade each other and themselves, on both faces and whatever the gap."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.sheet_bodies import open_cylinder, plate


BLACK = jt.Material(
    50.0, density=8000.0, specific_heat=500.0, emissivity=1.0, absorptivity=1.0
)
LAYERS = (jt.Layer(BLACK, 1e-3),)
IRRADIANCE = 800.0


def sheet_at(mesh, height, pitch=0.02):
    """A black sheet at a height [m]."""
    structure = jt.Sheet(mesh, LAYERS, pitch=pitch)
    pose = jt.Pose((0.0, 0.0, height))
    return jt.Body(structure, temperature=300.0, pose=pose)


def absorbed(bodies, direction):
    """Heat rate that each body absorbs from the sun [W]."""
    scene = jt.Scene(bodies, (jt.Sun(direction, IRRADIANCE),), dtype="float64")
    step = 1e-3
    solution = jt.simulate(scene, step, solver=jt.ForwardEuler(dt=step))
    heat = [body.mechanisms.get("sun", np.zeros(1)) for body in solution.energy.bodies]
    return np.array([float(rate[0]) / step for rate in heat])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("gap", [0.003, 0.05])
def test_sheet_behind_another_is_dark_whatever_the_gap(gap, sign):
    bodies = (sheet_at(plate(0.2, 0.2), 0.0), sheet_at(plate(0.2, 0.2), sign * gap))
    hidden, lit = absorbed(bodies, (0.0, 0.0, -sign))
    assert hidden == pytest.approx(0.0, abs=1e-9)
    assert lit == pytest.approx(IRRADIANCE * 0.04, rel=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_shadow_of_a_small_sheet_has_its_area(sign):
    small = plate(0.07, 0.05)
    bodies = (
        sheet_at(plate(0.2, 0.2), 0.0, pitch=0.01),
        sheet_at(small, sign * 0.04, 0.01),
    )
    rays = np.array([0.3, 0.1, -sign])
    rays /= np.linalg.norm(rays)
    below, above = absorbed(bodies, tuple(rays))
    flux = IRRADIANCE * abs(rays[2])
    assert above == pytest.approx(flux * 0.0035, rel=1e-9)
    # The border of the shadow is resolved to a tenth of a cell.
    assert below == pytest.approx(flux * (0.04 - 0.0035), rel=0.003)


@pytest.mark.parametrize("pitch", [0.015, 0.007])
def test_no_light_gets_into_a_cylinder_around_its_border(pitch):
    body = sheet_at(open_cylinder(0.05, 0.2, 48), 0.0, pitch)
    face = np.asarray(body.structure.grid.fragment_face)
    scene = jt.Scene((body,), (jt.Sun((-1.0, 0.0, 0.0), IRRADIANCE),))
    solution = jt.simulate(scene, 0.0)
    irradiance = np.asarray(solution.irradiance(0).sources).reshape(-1)
    assert irradiance[face == 1].max() == 0.0
    normal = np.asarray(body.structure.grid.fragment_normal)
    expected = IRRADIANCE * np.maximum(normal[face == 0, 0], 0.0)
    np.testing.assert_allclose(irradiance[face == 0], expected, atol=1e-2)
