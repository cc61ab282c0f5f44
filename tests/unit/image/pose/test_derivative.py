"""Frames change with the camera's pose as the derivative says, away from outlines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN as SIGMA
from jaxthermo.image.pose.derivative import linearize_view
from jaxthermo.image.pose.outline import outline_distance
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.surface.view import compute_view
from jaxthermo.physics.radiation.irradiation import Irradiance
from jaxthermo.scene.compile.compile import compile_scene


POSE = np.array([0.02, -0.015, 0.01, 0.004, -0.006, 0.01])
CAMERAS = {
    "pinhole": jt.Camera(
        (0.5, -0.3, 0.25), (-0.03, 0.04, 0.0), field_of_view=0.36, width=96, height=72
    ),
    "calibrated": jt.Camera.calibrated(
        ((205.0, 0.0, 51.0), (0.0, 197.0, 33.5), (0.0, 0.0, 1.0)),
        width=96,
        height=72,
        distortion=(-0.8, 0.5, 0.004, -0.003),
        position=(0.5, -0.3, 0.25),
        look_at=(-0.03, 0.04, 0.0),
    ),
    "orthographic": jt.OrthographicCamera(
        (0.5, -0.3, 0.25), (-0.03, 0.04, 0.0), 0.22, width=96, height=72
    ),
}


@pytest.fixture(scope="module")
def surfaces():
    """A ball before a turned block: curved and plane, with an outline between."""
    metal = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.7)
    ball = jt.Body(
        jt.FullVolume(jt.voxelize(jt.shapes.sphere(0.05), 0.01)),
        metal,
        temperature=300.0,
    )
    grid = jt.voxelize(jt.shapes.box((0.08, 0.06, 0.1)), 0.01)
    matrix = Rotation.from_rotvec((0.2, 0.7, 0.1)).as_matrix()
    turned = jt.Pose((-0.06, 0.09, 0.0), matrix.tolist())
    block = jt.Body(jt.FullVolume(grid), metal, temperature=300.0, pose=turned)
    return compile_scene(jt.Scene((ball, block), (), dtype="float64"), 1, 1.0).surfaces


@pytest.fixture(scope="module")
def state(surfaces):
    """Temperatures that differ everywhere, and irradiation that does too."""
    world = [s.geometry.placed.to_world(s.geometry.fragment_position) for s in surfaces]
    x, y, z = np.concatenate(world).T
    kelvin = jnp.asarray(300 + 200 * x + 50 * np.sin(40 * y) + 300 * z)
    thermal = jnp.asarray(SIGMA * (260 + 100 * np.cos(30 * z)) ** 4)
    return kelvin, Irradiance(thermal, jnp.zeros((0, len(x))), jnp.zeros(0))


def _view(surfaces, camera, pose):
    return compute_view(surfaces, (), moved_camera(camera, pose))


def _frame(view, surfaces, state):
    kelvin, received = state
    image = draw(
        view,
        Moment(
            surfaces=surfaces,
            terms=(),
            temperature=kelvin,
            received=received,
            time=jnp.zeros(()),
        ),
    )
    return image.apparent_temperature


def _strip(camera, surfaces, state):
    """Frame of a linearized view's pixels as a function of the pose."""
    return jax.jit(
        lambda linear, pose: _frame(linear.at(pose, camera), surfaces, state)[0]
    )


@pytest.mark.parametrize(
    "name",
    [
        "pinhole",
        "calibrated",
        pytest.param("orthographic", marks=[pytest.mark.slow, pytest.mark.slice]),
    ],
)
def test_the_derivative_is_that_of_frames_rendered_again(surfaces, state, name):
    """By all six numbers, to 1e-6 of the largest at each pixel that shows one face."""
    camera = CAMERAS[name]
    pixels = np.flatnonzero(outline_distance(_view(surfaces, camera, POSE)) > 2)
    size = 30 * len(pixels)
    frame = _strip(camera, surfaces, state)

    def linearized(pose):
        return linearize_view(
            surfaces, camera=camera, pose=pose, pixels=pixels, size=size
        )

    def again(pose):
        return frame(linearized(pose), pose)

    linear = linearized(POSE)
    slopes = np.asarray(jax.jit(jax.jacfwd(frame, 1))(linear, POSE))
    largest = np.abs(slopes).max()
    step = 1e-6
    for number, unit in enumerate(np.eye(6)):
        ends = again(POSE + step * unit), again(POSE - step * unit)
        difference = np.asarray(ends[0] - ends[1]) / (2 * step)
        smooth = np.abs(difference - slopes[:, number]) <= 1e-6 * largest
        # A few pixels change to another face, where the slope of the depth jumps.
        assert smooth.mean() > 0.99


@pytest.mark.parametrize("name", CAMERAS)
def test_at_its_pose_a_linear_view_shows_the_rendered_frame(surfaces, state, name):
    """To 1/1024 pixel, to which the raster snaps, with pixels that see no body."""
    camera = CAMERAS[name]
    view = _view(surfaces, camera, POSE)
    rendered = np.asarray(_frame(view, surfaces, state))
    pixels = np.arange(rendered.size)
    linear = linearize_view(surfaces, camera=camera, pose=POSE, pixels=pixels)
    strip = _strip(camera, surfaces, state)(linear, jnp.asarray(POSE))
    strip = np.asarray(strip)
    seen = np.asarray(linear.seen) > 0
    assert (np.flatnonzero(seen) == view.pixel).all()
    # About 1 K a pixel.
    off = np.abs(strip - rendered.ravel())[outline_distance(view).ravel() > 2]
    assert off.max() < 5e-3
    # Behind a lens both have the points where rays meet planes.
    assert (off.max() > 1e-9) == (name != "calibrated")
    assert np.isfinite(strip).all()


def test_outlines_are_those_of_the_bodies_and_between_them(surfaces):
    """Far from outlines no pixel shows another body in a pose two pixels away."""
    camera = CAMERAS["pinhole"]
    view = _view(surfaces, camera, np.zeros(6))
    distance = outline_distance(view)
    pixel = 0.36 / 72
    for turn in np.array([(0, 2, 0), (0, -2, 0), (2, 0, 0), (-2, 0, 0)]) * pixel:
        turned_view = _view(surfaces, camera, np.append(turn, np.zeros(3)))
        bodies = []
        for shown_view in (view, turned_view):
            body = np.full(distance.size, -1)
            body[shown_view.pixel] = shown_view.body
            bodies.append(body.reshape(distance.shape))
        far = distance > 3
        assert (bodies[0] == bodies[1])[far].all()
        assert (bodies[0] != bodies[1])[~far].any()
    # Edges of the block that are seen are no outlines.
    assert 0.5 < (distance > 2).sum() / len(view.pixel) < 0.9
