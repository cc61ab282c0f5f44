"""New views of a scene: as the simple way finds them, and nothing is compiled."""

from typing import Any

import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import csr_array

import jaxthermo as jt
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.surface import view as view_module
from jaxthermo.image.surface.fragment_cells import CHUNK, cells_of
from jaxthermo.image.surface.shapes import ShapePoints, Shapes
from jaxthermo.image.surface.view import compute_view
from jaxthermo.memo.found import forget_findings
from jaxthermo.physics.radiation.irradiation import Irradiance
from jaxthermo.raster.fragments import peel
from jaxthermo.scene.scene import SolvedSurface, body_geometry


EVENTS: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, *_, **__: EVENTS.append(event)
)
TERMS = (jt.Sun((-1.0, 0.2, -0.4), 800.0), jt.Surroundings(250.0, ground=280.0))


def compilations() -> int:
    """Number of functions that were traced or compiled so far."""
    return sum("/jax/core/compile/" in name for name in EVENTS)


@pytest.fixture(scope="module")
def surfaces():
    """Two bodies, one of which partly hides the other."""
    bodies = (
        (jt.shapes.sphere(0.05, 3), (0.0, 0.0, 0.0)),
        (jt.shapes.box((0.03, 0.04, 0.05)), (0.07, 0.02, 0.01)),
    )
    grey = jnp.asarray(0.6)
    return tuple(
        SolvedSurface(
            body_geometry(jt.voxelize(mesh, 0.005), jt.Pose(translation=at)), grey, grey
        )
        for mesh, at in bodies
    )


def camera(turn, away=0.4, width=192):
    at = away * np.array([np.cos(turn), np.sin(turn), 0.3])
    position = float(at[0]), float(at[1]), float(at[2])
    return jt.Camera(
        position, (0.02, 0.0, 0.0), field_of_view=0.4, width=width, height=144
    )


def test_new_views_compile_nothing(surfaces):
    size = sum(len(s.geometry.fragment_area) for s in surfaces)

    def frame(*where):
        view = compute_view(surfaces, TERMS, camera(*where))
        kelvin = np.full(size, 300.0)
        time = jnp.zeros(())
        received = Irradiance(
            thermal=0.1 * kelvin, sources=np.zeros((0, size)), spectrum=np.zeros(0)
        )
        return draw(
            view,
            Moment(
                surfaces=surfaces,
                terms=TERMS,
                temperature=kelvin,
                received=received,
                time=time,
            ),
        ).object_id

    assert (frame(0.0) == 0).sum() > CHUNK
    count_at_start = compilations()
    assert count_at_start > 0
    for where in ((1.0,), (2.0, 0.3), (4.0, 0.6, 230)):
        assert (frame(*where) >= 0).any()
    assert compilations() == count_at_start


def test_the_first_view_of_a_body_is_kept_for_other_processes(surfaces, monkeypatch):
    asked = []

    def stored(category, inputs, compute, types):
        asked.append(inputs[0])
        return compute()

    monkeypatch.setattr(view_module, "stored", stored)
    forget_findings()
    cameras = [camera(turn, width=48) for turn in (0.0, 0.3)]
    for new_camera in cameras:
        compute_view(surfaces, TERMS, new_camera)
    assert asked == cameras[:1]


@pytest.mark.parametrize("turn", [0.0, 2.5])
def test_a_view_is_that_of_all_layers_and_all_pairs(surfaces, turn):
    view_camera = camera(turn)
    view = compute_view(surfaces, TERMS, view_camera)
    world = [s.geometry.triangles for s in surfaces]
    corners, parent = view_camera.to_raster(np.concatenate(world))
    layers = peel(corners, *view_camera.size)
    front = layers.layer == 0
    pixel = layers.pixel[front]
    triangle = parent[layers.triangle[front]]
    np.testing.assert_array_equal(view.pixel, pixel)
    np.testing.assert_array_equal(view.body, triangle >= len(world[0]))
    assert set(view.body.tolist()) == {0, 1}
    position, depth = view_camera.points(pixel, layers.depth[front])
    np.testing.assert_allclose(view.depth, depth, rtol=1e-12)
    first = 0
    rows = []
    fragments = []
    weights = []
    for number, surface in enumerate(surfaces):
        on_body = view.body == number
        geometry = surface.geometry
        local = geometry.placed.to_body(position[on_body])
        cells = cells_of(Shapes.of((geometry,)), 2.0)
        points = ShapePoints.of_one(local, view.normal[on_body])
        pairs = cells.weighted(points)
        rows.append(np.flatnonzero(on_body)[pairs.owner])
        fragments.append(pairs.fragment + first)
        weights.append(pairs.weight)
        first += len(geometry.fragment_area)
    row = np.concatenate(rows)
    fragment = np.concatenate(fragments)
    weight = np.concatenate(weights)
    size = len(pixel), first
    total = np.bincount(row, weight, len(pixel))
    assert (total > 0).all()
    simple = csr_array((weight / total[row], (row, fragment)), size)
    weights: Any = view.weights
    assert weights.nnz == simple.nnz
    assert abs(weights - simple).max() < 1e-12
