"""Points that stand for surfaces: covering, their temperatures, and picking."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.colour.palette import palette_table
from jaxthermo.live.scale import Scale, scale_of
from jaxthermo.live.surface_points import colours, point_on_ray, surface_points
from tests.bodies import blocks


@pytest.fixture(scope="module")
def surfaces():
    copper = jt.materials["copper"]
    grid = jt.voxelize(jt.shapes.sphere(0.02), pitch=0.002)
    cuboid = blocks(np.ones((4, 3, 2), bool), 0.01)
    pose = jt.Pose((0.1, 0.0, 0.0))
    bodies = (
        jt.Body(jt.FullVolume(grid), copper, temperature=300.0),
        jt.Body(jt.FullVolume(cuboid), copper, temperature=300.0, pose=pose),
    )
    return jt.simulate(jt.Scene(bodies), 0.0).surfaces


@pytest.fixture(scope="module")
def points(surfaces):
    return surface_points(surfaces, 4000)


def test_points_cover_the_surface(points, surfaces):
    assert 3000 < sum(map(len, points.position)) < 9000
    sphere = jt.mesh_sample(jt.shapes.sphere(0.02), 2000, seed=5).position
    away = np.linalg.norm(sphere[:, None] - points.position[0][None], axis=2).min(1)
    # A point without another within its radius would be a hole.
    assert np.mean(away > points.diameter / 2) < 0.01
    radius = np.linalg.norm(points.position[0], axis=1)
    np.testing.assert_allclose(radius, 0.02, rtol=0.02)


def test_temperatures_are_those_of_the_fragments_around(points, surfaces):
    fragments = [s.geometry.fragment_position for s in surfaces]
    assert points.weights.shape == (points.rows[1].stop, sum(map(len, fragments)))
    constant = points.temperature(np.full(points.weights.shape[1], 321.0, np.float32))
    np.testing.assert_allclose(constant, 321.0, rtol=1e-5)
    # Linear in height on the sphere, and another temperature of the other body.
    kelvin = np.concatenate(
        [300 + 1000 * fragments[0][:, 2], np.full(len(fragments[1]), 7.0)]
    )
    temperatures = points.temperature(kelvin)
    on_sphere, on_cuboid = (temperatures[rows] for rows in points.rows)
    np.testing.assert_allclose(
        on_sphere, 300 + 1000 * points.position[0][:, 2], atol=0.8
    )
    np.testing.assert_allclose(on_cuboid, 7.0, rtol=1e-5)
    assert (points.body_of(0), points.body_of(len(temperatures) - 1)) == (0, 1)


def test_a_ray_picks_the_first_point(points):
    world = points.position[0].astype(float)
    radius = points.diameter / 2
    hit = point_on_ray(world, np.array([1.0, 0, 0]), np.array([-2.0, 0, 0]), radius)
    assert world[hit] == pytest.approx([0.02, 0, 0], abs=points.diameter)
    missing = point_on_ray(
        world, np.array([1.0, 0, 0.1]), np.array([-1.0, 0, 0]), radius
    )
    away = point_on_ray(world, np.array([1.0, 0, 0]), np.array([1.0, 0, 0]), radius)
    assert missing is None and away is None


def test_colours_are_those_of_the_palette():
    srgb = colours(np.array([280.0, 290.0, 300.0, 400.0]), 280.0, 300.0, "iron")
    table = palette_table("iron")
    assert srgb.tolist() == table[[0, 128, 255, 255]].tolist()


def test_a_scale_grows_with_what_is_seen():
    first = scale_of(np.array([300.0, np.nan]), "iron")
    assert first == Scale(299.5, 300.5, "iron")
    assert first.holding(np.array([300.2])) is first
    wider = first.holding(np.array([300.0, 310.0]))
    assert wider.low == pytest.approx(299.5) and wider.high == pytest.approx(310.5)
    lower = wider.holding(np.array([250.0]))
    assert lower.low < 250.0 and lower.high == wider.high
