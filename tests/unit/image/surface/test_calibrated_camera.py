"""Cameras of calibrations: OpenCV's matrices, and rays that a lens bends."""

import dataclasses

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.schema.image import PinholeConfig
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.image.files.labels import camera_matrices
from jaxthermo.image.surface.visible import WorldMesh, visible_points


WIDTH, HEIGHT = 640, 512
K = np.array([[741.0, 0.0, 325.3], [0.0, 739.0, 251.8], [0.0, 0.0, 1.0]])
BARREL = (-0.274, 0.0, 0.0, 0.0)
LENSES = {
    "barrel": BARREL,
    "five": (-0.31, 0.12, 0.0011, -0.0007, -0.02),
    "pincushion": (0.2, 0.05, -0.002, 0.001, 0.01),
}
ROTATION = Rotation.from_euler("xyz", (100, 12, -5), degrees=True).as_matrix()
POSE = np.eye(4)
POSE[:3, :3] = ROTATION
POSE[:3, 3] = (0.02, -0.05, 0.6)


def calibrated(distortion=(), **changes):
    arguments = {"K": K, "width": WIDTH, "height": HEIGHT, "world_to_camera": POSE}
    return jt.Camera.calibrated(**arguments | changes, distortion=distortion)


def opencv_pixels():
    rows, columns = np.indices((HEIGHT, WIDTH)).reshape(2, -1).astype(float)
    return np.stack([columns, rows], axis=1)


@pytest.mark.parametrize("name", LENSES)
def test_rays_of_all_pixels_are_those_of_opencv(name):
    camera = calibrated(LENSES[name])
    origin, step = camera.rays()
    in_camera = step @ ROTATION.T
    coefficients = np.array(LENSES[name])
    # By default OpenCV stops after five steps.
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    expected = cv2.undistortPoints(opencv_pixels(), K, coefficients, criteria=until)
    focal = np.diag(K)[:2]
    off = (in_camera[:, :2] - expected[:, 0]) * focal
    assert np.abs(off).max() < 1e-6
    np.testing.assert_allclose(in_camera[:, 2], 1.0)
    np.testing.assert_allclose(origin[0], -ROTATION.T @ POSE[:3, 3], atol=1e-12)


def test_rays_are_those_of_opencv_with_its_own_steps():
    tangents = calibrated(BARREL).lens.tangents()
    expected = cv2.undistortPoints(opencv_pixels(), K, np.array(BARREL))[:, 0]
    middle = np.abs(opencv_pixels() - K[:2, 2]).max(axis=1) < 200
    off = (tangents - expected)[middle] * np.diag(K)[:2]
    assert np.abs(off).max() < 0.01


@pytest.mark.parametrize("name", LENSES)
def test_points_are_projected_as_by_opencv(name):
    camera = calibrated(LENSES[name])
    points = np.random.default_rng(3).uniform(-0.12, 0.12, (200, 3))
    turn, _ = cv2.Rodrigues(ROTATION)
    coefficients = np.array(LENSES[name])
    expected, _ = cv2.projectPoints(points, turn, POSE[:3, 3], K, coefficients)
    # The centre of the first pixel is at (0, 0) there.
    np.testing.assert_allclose(camera.project(points) - 0.5, expected[:, 0], atol=1e-8)


@pytest.mark.parametrize("name", LENSES)
def test_pixels_show_what_their_rays_meet(name):
    """Against the intersection of each ray with each triangle, behind each lens."""
    camera = dataclasses.replace(calibrated(LENSES[name]), width=64, height=51)
    # One large box that fills a corner, and a ball of small triangles.
    block = box((0.5, 0.3, 0.3))
    ball = sphere(0.08, 2)
    position = np.asarray(camera.position)
    right, down, forward = camera.frame
    meshes = (
        WorldMesh(
            block.vertices + position + 0.9 * forward + 0.25 * right, block.faces
        ),
        WorldMesh(ball.vertices + position + 0.5 * forward - 0.1 * down, ball.faces),
    )
    visible = visible_points(meshes, camera)
    depth = np.full(64 * 51, np.inf)
    depth[visible.pixel] = visible.depth
    exact = np.full(64 * 51, np.inf)
    origin, step = camera.rays()
    for vertices, faces, _ in meshes:
        for a, b, c in vertices[faces]:
            # Solve a + u (b - a) + v (c - a) = o + d s.
            across = np.stack([b - a, c - a], axis=1)
            sides = np.broadcast_to(across, (len(step), 3, 2))
            matrix = np.concatenate([sides, -step[:, :, None]], axis=2)
            start = np.broadcast_to(origin - a, step.shape)[..., None]
            u, v, far = np.linalg.solve(matrix, start)[..., 0].T
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0)
            exact = np.where(hit, np.minimum(exact, far), exact)
    both = np.isfinite(depth) & np.isfinite(exact)
    # An outline within 1/256 pixel of a centre may be on its other side.
    assert (np.isfinite(depth) != np.isfinite(exact)).sum() <= 2
    assert both.sum() > 500
    off = np.abs(depth[both] / exact[both] - 1)
    assert np.quantile(off, 0.99) < 1e-9


def test_a_lens_without_distortion_is_the_plain_camera():
    plain = jt.Camera((0.3, -0.5, 0.2), (0.0, 0.0, 0.0), width=64, height=48)
    same = jt.Camera.calibrated(
        plain.K,
        width=64,
        height=48,
        distortion=np.zeros(5),
        position=plain.position,
        look_at=plain.look_at,
    )
    assert same.distortion == ()
    for actual, expected in zip(same.rays(), plain.rays(), strict=True):
        np.testing.assert_allclose(actual, expected, atol=1e-14)


@pytest.mark.parametrize("distortion", [(), BARREL])
def test_matrices_that_a_dataset_writes_give_the_camera_again(distortion):
    camera = calibrated(distortion)
    written = camera_matrices(camera)
    assert "K" in written
    np.testing.assert_allclose(written["K"], K, atol=1e-10)
    np.testing.assert_allclose(written["world_to_camera"], POSE[:3], atol=1e-12)
    again = jt.Camera.calibrated(
        written["K"],
        width=WIDTH,
        height=HEIGHT,
        distortion=written.get("distortion", ()),
        world_to_camera=written["world_to_camera"],
    )
    for actual, expected in zip(again.rays(), camera.rays(), strict=True):
        np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_a_scene_file_has_the_same_camera():
    config = PinholeConfig.model_validate(
        {
            "K": K.tolist(),
            "width": WIDTH,
            "height": HEIGHT,
            "distortion": list(BARREL),
            "world_to_camera": POSE.tolist(),
        }
    )
    triangles = box((0.1, 0.1, 0.1)).triangles
    for actual, expected in zip(
        build_camera(config, triangles).rays(), calibrated(BARREL).rays(), strict=True
    ):
        np.testing.assert_allclose(actual, expected, atol=1e-14)


@pytest.mark.parametrize("samples", [2, 3])
def test_pixels_of_a_finer_camera_are_parts_of_pixels(samples):
    camera = calibrated(LENSES["five"])
    points = np.random.default_rng(4).uniform(-0.1, 0.1, (50, 3))
    finer = camera.finer(samples).project(points)
    np.testing.assert_allclose(finer, samples * camera.project(points), atol=1e-9)


def test_pixels_towards_a_direction_are_all_within_the_angle():
    for camera in (calibrated(), calibrated(BARREL)):
        direction = camera.frame.T @ np.array([0.3, -0.2, 1.0])
        direction /= np.linalg.norm(direction)
        _, step = camera.rays()
        cosine = step @ direction / np.linalg.norm(step, axis=1)
        within = np.flatnonzero(cosine >= np.cos(0.02))
        chosen = camera.pixels_towards(direction, 0.02)
        assert len(within) > 500
        assert np.isin(within, chosen).all()
        assert len(chosen) < 2 * len(within)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 320, "height": 256}, "pictures of another size"),
        ({"width": 1280, "height": 1024}, "pictures of another size"),
        ({"K": K.T}, r"give \(\(f_x, 0, c_x\)"),
        ({"K": K[:2]}, "matrix of 3 x 3"),
        ({"K": np.diag([-1.0, 1.0, 1.0]) @ K}, "focal lengths"),
        ({"distortion": (0.1, 0.2)}, "k1, k2, p1, p2"),
        ({"distortion": (np.nan, 0, 0, 0)}, "k1, k2, p1, p2"),
        ({"distortion": (-2.0, 0, 0, 0)}, "folds a picture of 640 x 512"),
        ({"world_to_camera": POSE.T}, "its last row is"),
        ({"world_to_camera": np.diag([1.0, 1.0, -1.0, 1.0])}, "are no rotation"),
        ({"world_to_camera": 1e3 * POSE[:3]}, "are no rotation"),
        ({"world_to_camera": POSE[:3, :3]}, "3 x 4 or 4 x 4"),
        ({"world_to_camera": None}, "world_to_camera, or position and look_at"),
        ({"position": (0, 0, 1), "look_at": (0, 0, 0)}, "world_to_camera, or position"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(jt.InputError, match=message) as caught:
        calibrated(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": None}, "width\n  is missing"),
        ({"width": 320, "height": 256}, "pictures of another size"),
        ({"field_of_view": 0.6}, "field_of_view\n  is that of K"),
        ({"K": None}, "distortion\n  belongs to a matrix"),
        ({"look_at": [0, 0, 0]}, "look_at\n  is that of world_to_camera"),
        ({"world_to_camera": POSE.T.tolist()}, "its last row is"),
        ({"distortion": [-2.0, 0, 0, 0]}, "distortion\n  folds a picture"),
        ({"distortion": [0.1, 0]}, "distortion\n  give k1, k2, p1, p2"),
    ],
)
def test_a_scene_file_that_does_not_fit_is_refused(changes, message):
    values = {
        "K": K.tolist(),
        "width": WIDTH,
        "height": HEIGHT,
        "distortion": list(BARREL),
        "world_to_camera": POSE.tolist(),
    }
    changed = {k: v for k, v in (values | changes).items() if v is not None}
    with pytest.raises(ValueError, match=message):
        PinholeConfig.model_validate(changed)
