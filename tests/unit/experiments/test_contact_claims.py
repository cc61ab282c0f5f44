"""C17, C18 and C19: contact as the exhibits of section 5.3 measure it."""

import numpy as np
import pytest

from experiments.thesis import bodies
from experiments.thesis.bodies import planck
from experiments.thesis.exhibits import blocks, broad_phase, contact
from experiments.thesis.exhibits.ball_on_head import BALL, HEAD, ball_on_head
from experiments.thesis.exhibits.intersection import bounds_along, pictures, two_balls
from experiments.verification.contacts import resisted
from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.voxels.voxelize import voxelize
from tests.exhibits import measured


@pytest.fixture(scope="module")
def balls():
    return two_balls((0.1, 0.08), (0.075, 0.07, 0.06), subdivisions=4)


def test_rays_bound_the_intersection_of_two_balls(balls):
    bounds = [bounds_along(balls, axis, 48) for axis in range(3)]
    volumes = [on_axis.volume for on_axis in bounds]
    assert volumes == pytest.approx([balls.volume] * 3, rel=0.01)
    areas = [sum(on_axis.area_of(body) for on_axis in bounds) for body in (0, 1)]
    assert areas == pytest.approx(balls.areas, rel=0.01)
    # On every ray the intersection is entered as often as it is left.
    assert all(2 * b.enters.sum() == len(b.enters) for b in bounds)


def test_half_a_ball_in_another_has_half_of_its_surface():
    # Centres one small radius and more apart, such that the small cap is a hemisphere.
    large, small = 0.1, 0.06
    apart = float(np.sqrt(large**2 - small**2))
    balls = two_balls((large, small), (apart, 0.0, 0.0), subdivisions=2)
    assert balls.cap_heights[1] == pytest.approx(small)
    assert balls.areas[1] == pytest.approx(2 * np.pi * small**2)


def test_pictures_of_an_intersection(balls):
    cast = {n: [bounds_along(balls, axis, n) for axis in range(3)] for n in (8, 24)}
    images = pictures(balls, cast)
    assert list(images) == ["figure-5.3", "figure-5.3-rays"]
    for image in images.values():
        # Bounds along x are red, those along y are green.
        seen = np.asarray(image, int).reshape(-1, 3)
        assert (seen[:, 0] > seen[:, 1] + 100).any()
        assert (seen[:, 1] > seen[:, 0] + 60).any()


@pytest.mark.parametrize("voxels", [16, 32])
def test_areas_by_texels_and_by_rays(voxels):
    touching = contact.two_cylinders(voxels)
    found = contact.contact_areas(touching, touching.a.pitch)
    exact = contact.lens_area(touching)
    assert found.rays == pytest.approx(exact, rel=0.006)
    assert [found.texels_a, found.texels_b] == pytest.approx([exact] * 2, rel=0.06)


def test_texels_are_those_under_the_other_body():
    """A brick on a corner of a plate: as many texels as it covers."""
    plate = voxelize(box((0.08, 0.08, 0.02)), 0.01, "dominant_axis")
    brick = voxelize(box((0.04, 0.04, 0.04)), 0.01, "dominant_axis")
    below = PlacedGrid(plate)
    on_it = PlacedGrid(brick, Pose((0.02, 0.02, 0.03)))
    texels = contact.touching_texels(below, on_it, 0.005)
    assert texels.sum() == 16
    assert (plate.fragment_position[texels] > [0, 0, 0.009]).all()
    above = PlacedGrid(brick, Pose((0.02, 0.02, 0.036)))
    assert not contact.touching_texels(below, above, 0.005).any()
    # Neither is it in contact next to the plate.
    next_to = PlacedGrid(brick, Pose((0.2, 0.02, 0.03)))
    assert not contact.touching_texels(below, next_to, 0.005).any()


def test_pruning_loses_nothing():
    row, pairs = broad_phase.measure_pruning(8)
    assert row["lost"] == 0 < row["touching"] == len(pairs.touching)
    assert pairs.touching <= pairs.searched
    assert len(pairs.searched) == row["after_views"]
    assert row["after_views"] <= row["after_boxes"] <= row["possible"] == 28


def test_the_heat_through_a_contact_is_the_integral_of_its_flux():
    times = np.linspace(0.0, 3.0, 3001)[1:]
    flux = np.array([resisted(time)[2] for time in times.tolist()])
    first = blocks.heat_through(float(times[0]))
    integral = first + np.trapezoid(flux, times)
    assert blocks.heat_through(3.0) == pytest.approx(integral, rel=1e-5)
    # A bonded contact takes more, and both as little as there is time.
    assert (
        blocks.bonded_heat_through(3.0)
        > blocks.heat_through(3.0)
        > blocks.heat_through(1.0)
        > 0
    )


@pytest.mark.slow
def test_heat_goes_through_texels_that_touch_alone():
    found = blocks.offset_blocks()
    assert found.elsewhere == 0.0 and found.area == pytest.approx(1.0, abs=0.01)


def test_the_ball_on_the_head_needs_the_mesh(monkeypatch):
    monkeypatch.setattr(bodies, "_statues", dict)
    with pytest.raises(InputError, match="max-planck.obj"):
        measured("figure-5.5")


@pytest.mark.slow
def test_heat_goes_from_the_ball_to_the_head():
    try:
        planck()
    except InputError:
        pytest.skip("no max-planck.obj")
    run = ball_on_head(40)
    gained, lost = run.conducted()
    assert gained == pytest.approx(-lost, rel=1e-10) and gained > 0
    texture = run.conduction_texture(0)
    touched = run.pairs.coverage_a > 0
    # The ball's temperature at first, on the texels that touch it alone.
    assert (
        texture[touched] == pytest.approx(150.0) and np.isnan(texture[~touched]).all()
    )
    assert run.in_contact(BALL, 2) < 150.0 and run.in_contact(HEAD, 2) > 20.0
    assert 0.0 == run.warmed_area(0) < run.warmed_area(1) < run.warmed_area(2)
