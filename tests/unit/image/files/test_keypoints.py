"""Keypoints: points of bodies that move, turn away and leave the image."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry import shapes
from jaxthermo.image.files.keypoints import BodyPoint, keypoint_labels
from jaxthermo.image.surface.visible import visible_points, world_meshes
from jaxthermo.scene.scene import SolvedSurface, body_geometry


CAMERA = jt.Camera(
    position=(0.0, -1.0, 0.05), look_at=(0.0, 0.0, 0.05), width=64, height=48
)
HALF_TURN = jt.Pose.about((0.0, 0.0, 1.0), np.pi)
MOVED = jt.Pose(translation=(0.1, 0.0, 0.0))


def labels_at(time: float, pose: jt.Pose, point: tuple[float, float, float]):
    """Label of a point of a box at a time, which ends a motion to a pose at 10 s."""
    grid = jt.voxelize(shapes.box((0.1, 0.1, 0.1)), pitch=0.05)
    motion = jt.Motion(jt.PoseTable((0.0, 10.0), (jt.Pose(), pose)))
    geometry = body_geometry(grid, motion)
    surfaces = (SolvedSurface(geometry, np.array(0.9), np.array(0.9)),)
    shown = tuple(surface.at(time) for surface in surfaces)
    visible = visible_points(world_meshes(shown), CAMERA)
    (label,) = keypoint_labels(
        [BodyPoint("point", body=0, position=point)],
        surfaces=surfaces,
        time=time,
        camera=CAMERA,
        object_id=CAMERA.frame_of(visible.pixel, visible.body, -1),
        depth=CAMERA.frame_of(visible.pixel, visible.depth, np.inf),
    )
    return label


def test_a_point_moves_with_its_body():
    low, _ = shapes.box((0.1, 0.1, 0.1)).bounds
    front = (0.0, float(low[1]), 0.05)
    start = labels_at(0.0, MOVED, front)
    end = labels_at(10.0, MOVED, front)
    # By the ratio of similar triangles, 0.1 m at a distance of 1 m less the half box.
    distance = 1.0 + front[1]
    focal = CAMERA.K[0, 0]
    assert end["x"] - start["x"] == pytest.approx(focal * 0.1 / distance, rel=1e-6)
    assert end["y"] == pytest.approx(start["y"], abs=1e-6)
    assert start["visibility"] == end["visibility"] == 2


def test_a_point_that_turns_away_is_hidden():
    low, _ = shapes.box((0.1, 0.1, 0.1)).bounds
    front = (0.02, float(low[1]), 0.05)
    start = labels_at(0.0, HALF_TURN, front)
    end = labels_at(10.0, HALF_TURN, front)
    assert (start["visibility"], end["visibility"]) == (2, 1)
    assert start["x"] > 31.5 > end["x"]


@pytest.mark.parametrize("point", [(0.0, -3.0, 0.05), (2.0, 0.0, 0.05)])
def test_a_point_behind_the_camera_or_beside_the_image_is_outside(point):
    label = labels_at(0.0, MOVED, point)
    assert (label["x"], label["y"], label["visibility"]) == (0.0, 0.0, 0)
