"""The view of a fixed camera is computed once, and released with its scene."""

import gc
import weakref

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.surface import view as view_module
from jaxthermo.image.surface.view import compute_view, kept_view
from jaxthermo.memo.found import found


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.6)
TURNING = jt.Motion(
    jt.PoseTable((0.0, 10.0), (jt.Pose(), jt.Pose(translation=(0.0, 0.04, 0.0)))),
    every=5.0,
)


def camera(width=24):
    return jt.Camera((0.4, 0.0, 0.1), (0.0, 0.0, 0.0), width=width, height=20)


HERE = jt.Pose()


def solve(pose: jt.Pose | jt.Motion = HERE, source=None):
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0, pose=pose)
    terms = (jt.Surroundings(250.0),) if source is None else (source,)
    return jt.simulate(jt.Scene((body,), terms), 0.0, [0.0])


@pytest.fixture
def computed(monkeypatch):
    """The cameras whose views were computed."""
    cameras = []
    compute = view_module.compute_view

    def count(surfaces, terms, camera, **options):
        cameras.append(camera)
        return compute(surfaces, terms=terms, camera=camera, **options)

    monkeypatch.setattr(view_module, "compute_view", count)
    return cameras


def test_equal_cameras_share_a_view(computed):
    solution = solve()
    first = jt.render(solution, camera())
    second = jt.render(solution, camera())
    assert len(computed) == 1
    np.testing.assert_array_equal(first.radiance, second.radiance)
    for another_camera in (
        camera(width=30),
        jt.OrthographicCamera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1),
    ):
        jt.render(solution, another_camera)
    assert len(computed) == 3
    jt.render(solution, camera())
    assert len(computed) == 3
    jt.render(solution, camera(), smooth=False)
    jt.render(solution, camera(), samples=2)
    assert len(computed) == 5
    # The least recently used view has been dropped.
    jt.render(solution, camera(width=30))
    assert len(computed) == 6


def test_what_moves_has_a_view_at_each_time(computed):
    surfaces = solve(TURNING).surfaces
    pixels = []
    for time in (0.0, 10.0):
        posed = tuple(surface.at(time) for surface in surfaces)
        pixels.append(kept_view(posed, (), camera()).pixel)
    assert len(computed) == 2 and len(pixels[0]) > 0
    assert not np.array_equal(pixels[0], pixels[1])


def test_a_source_moves_within_one_view(computed):
    lamp = jt.PointSource(
        lambda time: (0.0, 0.05 - 0.1 * time, 0.05), 1.0, min_distance=0.02
    )
    still = solve(source=lamp)
    pixels = []
    for time in (0.0, 1.0):
        terms = (lamp.at(time),)
        view = kept_view(still.surfaces, terms, camera())
        new_view = compute_view(still.surfaces, terms, camera())
        (source,) = view.background.sources
        (expected,) = new_view.background.sources
        np.testing.assert_array_equal(source.pixel, expected.pixel)
        np.testing.assert_array_equal(source.depth, expected.depth)
        pixels.append(source.pixel)
    assert not np.array_equal(pixels[0], pixels[1])
    assert len(computed) == 1


def test_frames_of_a_moving_source_are_those_of_new_views():
    lamp = jt.PointSource(
        lambda time: (0.0, 0.05 - 0.1 * time, 0.05), 1.0, min_distance=0.02
    )
    solution = solve(source=lamp)
    first = jt.render(solution, camera())
    later = tuple(term.at(1.0) for term in solution.terms)
    kept_view(solution.surfaces, later, camera())
    again = jt.render(solution, camera())
    np.testing.assert_array_equal(first.radiance, again.radiance)


@pytest.mark.slow
def test_views_are_released_with_the_scene(computed):
    solution = solve()
    jt.render(solution, camera())
    (first,) = (surface.geometry for surface in solution.surfaces)
    ((_, view),) = found((first,), "kept views", list)
    view = weakref.ref(view)
    del solution, first
    gc.collect()
    assert view() is None
