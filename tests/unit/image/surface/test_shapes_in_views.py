"""Points of many bodies at once are those of each body alone."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import block_diag

import jaxthermo as jt
from jaxthermo.image.surface.facets import facet_shading
from jaxthermo.image.surface.shapes import Bodies, ShapePoints, Shapes
from jaxthermo.image.surface.view import in_bodies
from jaxthermo.image.surface.visible import visible_points, world_meshes
from jaxthermo.image.surface.weights import nearest_weights, smooth_weights
from jaxthermo.scene.scene import SolvedSurface, body_geometry


STEEL = jt.Material(50.0, density=7800.0, specific_heat=470.0)
CAMERA = jt.Camera(
    (0.5, -0.6, 0.5), (0.1, 0.05, 0.0), field_of_view=0.4, width=120, height=90
)


@pytest.fixture(scope="module")
def surfaces():
    """Two equal balls with large facets, a box of finer voxels and a thin wall."""
    ball = jt.voxelize(jt.shapes.sphere(0.05, 1), 0.005)
    fine = jt.voxelize(jt.shapes.box((0.03, 0.04, 0.05)), 0.004)
    wall = jt.Sheet(jt.shapes.rectangle(0.2, 0.1), (jt.Layer(STEEL, 1e-3),), 0.02)
    placed = (
        (ball, jt.Pose()),
        (fine, jt.Pose.about((1.0, 2.0, 0.0), 0.4, (0.12, 0.02, 0.0))),
        (wall.grid, jt.Pose.about((0.0, 0.0, 1.0), 0.7, (0.1, 0.1, -0.05))),
        (ball, jt.Pose.about((0.0, 1.0, 1.0), 1.1, (0.2, 0.0, 0.03))),
    )
    grey = jnp.asarray(0.6)
    return tuple(
        SolvedSurface(body_geometry(grid, pose), grey, grey) for grid, pose in placed
    )


@pytest.fixture(scope="module")
def visible(surfaces):
    seen = visible_points(world_meshes(surfaces), CAMERA)
    assert np.bincount(seen.body).min() > 30
    return seen


def test_equal_bodies_share_a_shape_and_others_do_not(surfaces):
    bodies = Bodies.of(surfaces)
    assert bodies.shape.tolist() == [0, 1, 2, 0]
    assert Bodies.of(surfaces).shapes is bodies.shapes
    sizes = [len(surfaces[n].geometry.fragment_area) for n in range(3)]
    assert bodies.shapes.fragment_count.tolist() == sizes
    # A single shape is not copied.
    geometry = surfaces[0].geometry
    assert Shapes.of((geometry,)).fragment_position is geometry.fragment_position


def test_meshes_of_bodies_at_rest_are_placed_once(surfaces):
    first = world_meshes(surfaces)
    again = world_meshes(surfaces)
    for mesh, repeated, surface in zip(first, again, surfaces, strict=True):
        assert repeated.vertices is mesh.vertices
        geometry = surface.geometry
        simple = geometry.pose.to_world(geometry.vertices)
        np.testing.assert_array_equal(mesh.vertices, simple)


def test_bodies_are_placed_by_their_poses(surfaces, visible):
    bodies = Bodies.of(surfaces)
    local = bodies.to_body(visible.position, visible.body)
    normal = np.full_like(local, 0.5)
    back = bodies.to_world(local, visible.body)
    np.testing.assert_allclose(back, visible.position, atol=1e-15)
    for number, surface in enumerate(surfaces):
        on_body = visible.body == number
        pose = surface.geometry.placed
        expected = pose.to_body(visible.position[on_body])
        np.testing.assert_allclose(local[on_body], expected, atol=1e-15)
        turned = bodies.rotate(normal, visible.body)[on_body]
        np.testing.assert_allclose(turned, pose.rotate(normal[on_body]), atol=1e-15)


def alone(surfaces, visible, number):
    """Points of one body, which is the only one, and its triangles."""
    on_body = np.flatnonzero(visible.body == number)
    seen = type(visible)(*(field[on_body] for field in visible))._replace(
        body=np.zeros(len(on_body), int)
    )
    bodies = Bodies.of((surfaces[number],))
    return on_body, seen, bodies, in_bodies(bodies, seen)


@pytest.mark.parametrize("weights_of", [smooth_weights, nearest_weights])
def test_weights_are_those_of_each_body_alone(surfaces, visible, weights_of):
    bodies = Bodies.of(surfaces)
    points = in_bodies(bodies, visible)
    weights = bodies.of_fragments(weights_of(points, bodies.shapes), visible.body)
    rows = []
    blocks = []
    for number in range(len(surfaces)):
        on_body, _, one_body, body_points = alone(surfaces, visible, number)
        np.testing.assert_allclose(
            points.normal[on_body], body_points.normal, atol=1e-12
        )
        rows.append(on_body)
        blocks.append(weights_of(body_points, one_body.shapes))
    expected: Any = block_diag(blocks, format="csr")
    order = np.argsort(np.concatenate(rows))
    assert weights.nnz == expected.nnz
    assert abs(weights - expected[order]).max() < 1e-12


def test_facets_are_those_of_each_body_alone(surfaces, visible):
    bodies = Bodies.of(surfaces)
    size = sum(len(surface.geometry.fragment_area) for surface in surfaces)
    field = np.random.default_rng(2).normal(size=size)
    points = in_bodies(bodies, visible)
    shading = facet_shading(
        points, bodies.face_of(visible.face, visible.body), visible.body, bodies
    )
    assert shading is not None
    first = 0
    seen = []
    for number, surface in enumerate(surfaces):
        size = len(surface.geometry.fragment_area)
        values = field[first : first + size]
        first += size
        on_body, body_visible, one_body, body_points = alone(surfaces, visible, number)
        body_shading = facet_shading(
            body_points, body_visible.face, body_visible.body, one_body
        )
        if body_shading is None:
            continue
        entries = np.flatnonzero(np.isin(shading.point, on_body))
        seen.append(entries)
        np.testing.assert_array_equal(
            shading.point[entries], on_body[body_shading.point]
        )
        corners = shading.corner[entries]
        for name in ("joined", "alone"):
            whole = (getattr(shading, name) @ field)[corners]
            single = (getattr(body_shading, name) @ values)[body_shading.corner]
            np.testing.assert_allclose(whole, single, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            (shading.local_mean @ field)[entries],
            body_shading.local_mean @ values,
            rtol=1e-9,
            atol=1e-12,
        )
        np.testing.assert_allclose(
            shading.share[entries], body_shading.share, atol=1e-12
        )
    assert len(seen) == 2
    assert sum(map(len, seen)) == len(shading.point)


def test_points_without_a_large_facet_have_no_facets(surfaces, visible):
    _, seen, bodies, points = alone(surfaces, visible, 1)
    assert facet_shading(points, seen.face, seen.body, bodies) is None


def test_points_of_the_first_shape():
    points = ShapePoints.of_one(np.zeros((3, 3)), np.ones((3, 3)))
    assert points.shape.tolist() == [0, 0, 0]
    assert points.some(np.array([2])).normal.shape == (1, 3)
