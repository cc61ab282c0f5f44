"""Fractions of pixels that bodies cover, and how they change with the camera's pose.

A pixel integrates over its square. Where the outline of the bodies moves by (u, v), to
the right and down, the covered fraction c of a pixel changes by what enters at its
edges:

    dc = u (m_left - m_right) + v (m_top - m_bottom),

with the covered fractions m of its four edges. Points at the outline move as points of
the bodies do: a silhouette slides along a surface, but not across the image.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter

from ..radiance.image import block_means
from ..surface.abstract_camera import AbstractCamera
from ..surface.visible import WorldMesh, visible_points
from .pose import POSE_SIZE, moved_camera


# Spread over which a pixel without a body takes the position of its neighbours.
_NEAR = 0.7
# Step of differences of the projection [rad, m], whose error is of second order.
_STEP = 1e-5


class Coverage(NamedTuple):
    """Bodies in the pixels of a camera, from several rays each."""

    fraction: Float[np.ndarray, "h w"]
    """Covered fraction of each pixel [-]."""
    slope: Float[np.ndarray, "2 h w"]
    """Change of the fraction as the outline moves to the right and down [1/pixel]."""
    position: Float[np.ndarray, "h w 3"]
    """Mean of the points that are visible in a pixel and its neighbours [m]."""


def coverage(
    bodies: tuple[WorldMesh, ...], camera: AbstractCamera, samples: int
) -> Coverage:
    """Find which part of each pixel shows a body, by `samples` rays along each axis.

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    width, height = camera.size
    fine_camera = camera.finer(samples)
    visible = visible_points(bodies, fine_camera)
    fine = fine_camera.frame_of(visible.pixel, np.ones(len(visible.pixel)), 0)
    down, right = (_edges(covered, samples) for covered in (fine, fine.T))
    slope = np.stack([-np.diff(right, axis=0).T, -np.diff(down, axis=0)])
    row, column = np.divmod(visible.pixel, width * samples)
    pixel = row // samples * width + column // samples
    shape = (height, width)
    count = height * width

    def spread(values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "h w"]:
        sums = np.bincount(pixel, values, count).reshape(shape)
        return gaussian_filter(sums, _NEAR, mode="constant")

    total = spread(np.ones(len(pixel)))
    sums = np.stack([spread(coordinate) for coordinate in visible.position.T], axis=-1)
    # Far from bodies any point will do, since the slope is 0 there.
    middle = visible.position.mean(axis=0)
    weight = np.maximum(total, 1e-12)[:, :, None]
    position = np.where(total[:, :, None] > 0, sums / weight, middle)
    return Coverage(np.asarray(block_means(fine, samples)), slope, position)


def _edges(fine: Float[np.ndarray, "_ _"], samples: int) -> Float[np.ndarray, "_ _"]:
    """Covered fractions of the upper and lower edges of pixels, top to bottom."""
    padded = np.pad(fine, ((1, 1), (0, 0)))
    # An edge lies between two rows of rays.
    lines = (padded[:-1] + padded[1:])[::samples] / 2
    return lines.reshape(len(lines), -1, samples).mean(axis=2)


def coverage_slopes(
    covered: Coverage,
    camera: AbstractCamera,
    pose: Float[np.ndarray, "6"],
    pixels: Int[np.ndarray, " p"],
) -> Float[np.ndarray, "p 6"]:
    """Change of covered fractions by each number of the pose [1/rad, 1/m]."""
    points = covered.position.reshape(-1, 3)[pixels]
    across, along = covered.slope.reshape(2, -1)[:, pixels]
    columns = []
    for step in _STEP * np.eye(POSE_SIZE):
        ends = [
            moved_camera(camera, end).project(points)
            for end in (pose + step, pose - step)
        ]
        right, down = (ends[0] - ends[1]).T / (2 * _STEP)
        columns.append(across * right + along * down)
    return np.stack(columns, axis=1)
