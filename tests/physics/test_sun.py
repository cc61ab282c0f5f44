"""A directional source (C04): Lambert's cosine, the terminator, shadows."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.radiation.source import Sun
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.voxels.voxelize import voxelize
from tests.bodies import body_at, single_body_scene
from tests.radiating import check_terminator, exposure


METAL = jt.Material(
    16.0, density=8000.0, specific_heat=500.0, emissivity=0.8, absorptivity=0.6
)
PITCH = 0.01


@pytest.fixture(scope="module")
def plate():
    return voxelize(box((0.2, 0.2, 0.02)), PITCH)


@pytest.fixture(scope="module")
def cover():
    return voxelize(box((0.06, 0.08, 0.02)), PITCH)


@pytest.fixture(scope="module")
def ball():
    """20 cells a radius."""
    return voxelize(sphere(0.2, subdivisions=4), PITCH)


def _exposure(grid, direction, *obstacles):
    return exposure(grid, Sun(direction, 1.0), *obstacles)


def _rays(angle, turn=0.3):
    """Travelling down, `angle` [degrees] from the vertical."""
    sine = np.sin(np.deg2rad(angle))
    cosine = np.cos(np.deg2rad(angle))
    return (-float(sine * np.cos(turn)), -float(sine * np.sin(turn)), -float(cosine))


@pytest.mark.parametrize("angle", [0, 20, 45, 70, 85, 89, 89.9])
def test_every_fragment_of_a_box_takes_its_cosine(plate, angle):
    rays = _rays(angle)
    cosine = np.maximum(0.0, -plate.fragment_normal @ np.array(rays))
    assert_allclose(_exposure(plate, rays), cosine, atol=1e-15)


def test_grazing_rays_bring_nothing(plate):
    top = plate.fragment_normal[:, 2] > 0.9
    assert _exposure(plate, (1.0, 0.0, 0.0))[top].max() == 0.0


def _absorbed(bodies, rays, irradiance=1000.0, t1=2.0):
    scene = jt.Scene(bodies, (jt.Sun(rays, irradiance),), dtype="float64")
    return float(
        jt.simulate(scene, t1, solver=jt.ForwardEuler()).energy.mechanisms["sun"][0]
    )


def test_box_absorbs_what_its_projected_area_catches(plate):
    rays = _rays(35.0)
    faces = np.array([0.2 * 0.02, 0.2 * 0.02, 0.2 * 0.2])
    exact = 1000.0 * 2.0 * 0.6 * (np.abs(rays) @ faces)
    assert _absorbed((body_at(plate, METAL, 300.0),), rays) == pytest.approx(
        exact, rel=1e-12
    )


def test_turning_the_body_is_turning_the_sun(plate):
    turn = ((0.0, -1.0, 0.0), (0.8, 0.0, -0.6), (0.6, 0.0, 0.8))
    rays = _rays(35.0)
    body_rays = tuple(float(x) for x in np.array(rays) @ np.array(turn))
    structure = jt.FullVolume(plate)
    pose = jt.Pose(translation=(3.0, -2.0, 1.0), rotation=turn)
    turned = jt.Body(structure, METAL, temperature=300.0, pose=pose)
    straight = jt.Body(structure, METAL, temperature=300.0)
    turned_heat = _absorbed((turned,), rays)
    expected = _absorbed((straight,), body_rays)
    assert turned_heat == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("rays", [(0.0, 0.0, -1.0), (-1.0, 0.4, -0.7)])
def test_sphere_absorbs_its_disc(ball, rays):
    absorbed = (_exposure(ball, rays) * ball.fragment_area).sum()
    error = absorbed / (np.pi * 0.2**2) - 1
    assert abs(error) < 0.01


@pytest.mark.parametrize("rays", [(0.0, 0.0, -1.0), (-1.0, 0.4, -0.7)])
def test_terminator_of_a_sphere_is_at_ninety_degrees(ball, rays):
    cosine = -ball.fragment_normal @ (np.array(rays) / np.linalg.norm(rays))
    check_terminator(_exposure(ball, rays), cosine)


@pytest.mark.parametrize("angle", [0.0, 30.0, 60.0])
def test_shadow_of_a_plate_over_a_plate(plate, cover, angle):
    """The shadow of a box 2 cm thick: its shape swept along the rays."""
    rays = _rays(angle, turn=0.0)
    gap = 0.03
    slope = np.tan(np.deg2rad(angle))
    above = cover.mesh.moved((0.03, 0.01, 0.01 + gap + 0.01))
    top = plate.fragment_normal[:, 2] > 0.9
    cosine = -rays[2]
    dark = 1.0 - _exposure(plate, rays, above)[top] / cosine
    x = plate.fragment_position[top, 0]
    y = plate.fragment_position[top, 1]
    low = 0.03 - 0.03 - (gap + 0.02) * slope
    high = 0.03 + 0.03 - gap * slope
    expected = (min(high, 0.1) - max(low, -0.1)) * 0.08
    shadow = (dark * PITCH**2).sum()
    perimeter = 2 * ((high - low) + 0.08)
    assert abs(shadow - expected) < 0.5 * PITCH * perimeter
    full = dark > 0.99
    shaded = dark > 0.01
    # Half a voxel as the source sees it, and half of the voxel that is in part dark.
    edge = 0.5 * PITCH * (1 / cosine + 1)
    inside = (x > low + edge) & (x < high - edge) & (abs(y - 0.01) < 0.04 - PITCH)
    outside = (x < low - edge) | (x > high + edge) | (abs(y - 0.01) > 0.04 + PITCH)
    assert inside.any() and full[inside].all()
    assert outside.any() and not shaded[outside].any()


@pytest.mark.parametrize("angle", [0.0, 45.0, 75.0])
def test_no_light_under_a_body_that_stands_on_another(plate, cover, angle):
    rays = _rays(angle, turn=0.0)
    standing = cover.mesh.moved((0.0, 0.0, 0.02))
    lit_share = _exposure(plate, rays, standing)
    x = plate.fragment_position[:, 0]
    y = plate.fragment_position[:, 1]
    top = plate.fragment_normal[:, 2] > 0.9
    # The rays come from +x: the shadow starts at the foot on the other side, too.
    reach = 0.03 + 0.02 * np.tan(np.deg2rad(angle))
    edge = 0.5 * PITCH * (1 / -rays[2] + 1)
    dark = top & (abs(y) < 0.04) & (x < 0.03) & (x > edge - reach)
    assert dark.sum() >= 40
    assert lit_share[dark].max() == 0.0
    lit = top & ((abs(y) > 0.05) | (x > 0.04))
    assert_allclose(lit_share[lit], -rays[2], atol=1e-15)


def _two(plate, cover, height):
    above = body_at(cover, METAL, 300.0, at=(0.0, 0.0, height))
    return body_at(plate, METAL, 300.0), above


@pytest.mark.slow
@pytest.mark.slice
def test_two_bodies_share_the_light_of_one(plate, cover):
    down = (0.0, 0.0, -1.0)
    together = _absorbed(_two(plate, cover, 0.1), down)
    assert together == pytest.approx(0.6 * 2000.0 * 0.2 * 0.2, rel=1e-12)


def test_body_in_another_one_s_shadow_has_no_sun_in_its_program(plate, cover):
    scene = jt.Scene(_two(plate, cover, -0.1), (jt.Sun((0.0, 0.0, -1.0), 1000.0),))
    compiled = compile_scene(scene)
    surface = compiled.program.surface
    assert surface is not None
    assert len(surface.by_cell.terms.natural) == 1
    assert [cells.body for cells in surface.by_cell.cells] == [0]
    left_out = {(o.what, o.why) for o in compiled.receipt.left_out}
    assert ("sun on body 1", "no surface of this body sees it") in left_out


def test_switched_off_at_an_exact_time(plate):
    sun = jt.Sun((0.0, 0.0, -1.0), jt.Until(1000.0, 7.3))
    scene = single_body_scene(plate, METAL, 300.0, sun)
    saves = [5.0, 7.3, 11.0]
    energy = jt.simulate(scene, 11.0, saves, solver=jt.ForwardEuler()).energy
    watts = 0.6 * 1000.0 * 0.2 * 0.2
    expected = watts * np.array([5.0, 7.3, 7.3])
    assert_allclose(energy.mechanisms["sun"], expected, rtol=1e-13)


def test_directions_are_checked():
    with pytest.raises(jt.InputError, match="direction"):
        jt.Sun((0.0, 0.0, 0.0), 1000.0)
