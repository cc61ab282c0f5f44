"""Reflection on large facets is that of the smooth surface which they approximate."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.radiance.draw import _irradiation_at_pixels
from jaxthermo.image.surface.view import View, compute_view
from jaxthermo.scene.scene import SolvedSurface, body_geometry


TO_SUN = np.array([0.6, -0.64, 0.48])
CAMERA = jt.Camera(
    (0.3, -1.0, 0.3), (0.0, 0.0, 0.0), field_of_view=0.25, width=60, height=50
)


def seen(*meshes: jt.Mesh, pitch: float = 0.005) -> tuple[View, np.ndarray]:
    """View of bodies, and the irradiation of their fragments by a parallel beam."""
    surfaces = tuple(
        SolvedSurface(
            body_geometry(jt.voxelize(mesh, pitch), jt.Pose()),
            jnp.asarray(0.3),
            jnp.asarray(0.3),
        )
        for mesh in meshes
    )
    normal = np.concatenate([s.geometry.fragment_normal for s in surfaces])
    view = compute_view(surfaces, (), CAMERA)
    return view, np.maximum(normal @ TO_SUN, 0.0)


@pytest.fixture(scope="module")
def ball():
    """A ball of 320 triangles, each 6 voxels wide."""
    return seen(jt.shapes.sphere(0.1, 2))


def received(view: View, values: np.ndarray) -> np.ndarray:
    return np.asarray(_irradiation_at_pixels(view, values[:, None])[:, 0])


def points(view: View) -> np.ndarray:
    origin, step = view.camera.rays()
    return origin[view.pixel] + step[view.pixel] * view.depth[:, None]


def test_a_ball_of_facets_reflects_like_a_ball(ball):
    view, beam = ball
    shaded = received(view, beam)
    plain = view.means(beam)
    out = points(view)
    exact = out / np.linalg.norm(out, axis=1, keepdims=True) @ TO_SUN
    lit = exact > 0.25
    off = np.full((2, CAMERA.height * CAMERA.width), np.nan)
    off[:, view.pixel] = np.where(lit, np.stack([shaded, plain]) - exact, np.nan)
    # What the eye sees as facets: steps of the error from a pixel to the next.
    steps = np.abs(np.diff(off.reshape(2, CAMERA.height, -1), axis=2))
    smooth, facets = np.nanmax(steps, axis=(1, 2))
    print("steps:", smooth, facets, "error:", np.nanmax(np.abs(off), axis=1))
    assert smooth < 0.03 and facets > 0.08
    # Of second order in the angle of 20 degrees between facets, not of first order.
    assert np.nanmax(np.abs(off[0])) < 0.05 < 0.07 < np.nanmax(np.abs(off[1]))
    assert abs(np.nanmean(off[0])) < 0.02
    # But for rounding no light is taken away where there is none.
    assert shaded.min() > -1e-12


def test_what_is_uniform_stays_uniform(ball):
    view, beam = ball
    np.testing.assert_allclose(received(view, np.full(len(beam), 7.0)), 7.0, rtol=1e-12)


def test_a_shadow_on_the_facets_stays_dark(ball):
    view, _ = ball
    [surface] = [jt.shapes.sphere(0.1, 2)]
    position = body_geometry(jt.voxelize(surface, 0.005), jt.Pose()).fragment_position
    irradiance = received(view, (position[:, 2] < 0.0) * 1.0)
    # Its edge is as wide as the weights, but for the light that corners spread.
    high = points(view)[:, 2]
    assert (
        irradiance[high > 0.06].max() < 1e-12
        and irradiance[high < -0.06].min() > 1 - 1e-12
    )


def test_flat_faces_and_fine_meshes_are_as_they_were():
    for mesh, pitch in ((jt.shapes.box((0.1, 0.1, 0.1)), 0.01), (FINE, 0.01)):
        view, _ = seen(mesh, pitch=pitch)
        assert view.facets is None


FINE = jt.shapes.sphere(0.1, 4)


@pytest.mark.slow
def test_the_facets_of_several_bodies_are_their_own(ball):
    left, right = (
        jt.shapes.sphere(0.04, 1).moved((x, 0.0, 0.0)) for x in (-0.05, 0.05)
    )
    box = jt.shapes.box((0.02, 0.02, 0.02)).moved((0.0, 0.0, 0.09))
    view, beam = seen(left, box, right)
    irradiance = received(view, beam)
    for number, mesh in ((0, left), (2, right)):
        alone, beam_on_mesh = seen(mesh)
        pixels = view.body == number
        np.testing.assert_allclose(
            irradiance[pixels], received(alone, beam_on_mesh), atol=1e-12
        )


@pytest.mark.slow
def test_under_derivatives_they_are_the_same(ball):
    view, beam = ball
    traced = _irradiation_at_pixels(view, jnp.asarray(beam)[:, None])
    np.testing.assert_allclose(traced[:, 0], received(view, beam), atol=1e-12)
