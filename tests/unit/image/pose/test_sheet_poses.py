"""Frames of thin walls, seen from either side, change with the pose as linearized."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.pose.derivative import linearize_view
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.surface.view import compute_view
from jaxthermo.scene.compile.compile import compile_scene
from tests.sheet_bodies import plate


POSE = np.array([0.02, -0.015, 0.01, 0.004, -0.006, 0.01])


@pytest.mark.parametrize("height", [2.0, -2.0])
def test_temperatures_of_pixels_move_with_the_pose(height):
    """By all six numbers, up to the border, to 1e-6 of the largest change."""
    metal = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=1.0)
    sheet = jt.Sheet(plate(1.0, 0.8), (jt.Layer(metal, 1e-3),), 0.1)
    scene = jt.Scene((jt.Body(sheet, temperature=300.0),), (), dtype="float64")
    surfaces = compile_scene(scene, 1, 1.0).surfaces
    x, y, _ = surfaces[0].geometry.fragment_position.T
    kelvin = jnp.asarray(300 + 50 * x + 10 * np.sin(9 * y))
    camera = jt.Camera(
        (0.1, -0.1, height),
        (0.0, 0.0, 0.0),
        up=(0.0, 1.0, 0.0),
        field_of_view=0.5,
        width=24,
        height=18,
    )
    view = compute_view(surfaces, (), moved_camera(camera, POSE))

    def linearized(pose):
        return linearize_view(
            surfaces, camera=camera, pose=pose, pixels=view.pixel, size=40 * 24 * 18
        )

    @jax.jit
    def frame(linear, pose):
        return linear.at(pose, camera).means(kelvin)

    linear = linearized(POSE)
    np.testing.assert_allclose(frame(linear, POSE), view.means(kelvin), atol=5e-3)
    slopes = np.asarray(jax.jit(jax.jacfwd(frame, 1))(linear, POSE))
    largest = np.abs(slopes).max()
    step = 1e-6
    for number, unit in enumerate(np.eye(6)):
        ends = [POSE + step * unit, POSE - step * unit]
        above, below = (np.asarray(frame(linearized(end), end)) for end in ends)
        difference = (above - below) / (2 * step)
        seen = np.asarray(linear.seen) > 0
        exact = np.abs(difference - slopes[:, number]) <= 1e-6 * largest
        # A pixel at the border may leave the sheet.
        assert exact[seen].mean() > 0.98
