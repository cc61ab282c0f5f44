"""Keypoints of a frame: pixels of named points of bodies, and whether they are seen."""

from collections.abc import Sequence
from typing import NamedTuple, TypedDict

import numpy as np
from jaxtyping import Float, Int

from ...scene.scene import SolvedSurface
from ..surface.abstract_camera import AbstractCamera


OUTSIDE = 0
"""Visibility in COCO: not in the image."""
HIDDEN = 1
"""Visibility in COCO: in the image, behind a surface."""
VISIBLE = 2


class BodyPoint(NamedTuple):
    """A named point of a body."""

    name: str
    body: int
    position: tuple[float, float, float]
    """In the world at the start [m]; it moves with the body."""


class KeypointLabel(TypedDict):
    """A keypoint in a frame."""

    name: str
    body: int
    x: float
    """Column [pixels]; the centre of the first pixel is at 0."""
    y: float
    """Row [pixels]."""
    visibility: int
    """0 outside of the image, 1 hidden, 2 visible."""


def keypoint_labels(
    points: Sequence[BodyPoint],
    surfaces: Sequence[SolvedSurface],
    time: float,
    camera: AbstractCamera,
    object_id: Int[np.ndarray, "h w"],
    depth: Float[np.ndarray, "h w"],
) -> list[KeypointLabel]:
    """Pixels of points of bodies at a time.

    Args:
        points: of the bodies.
        surfaces: of all bodies.
        time: of the frame [s].
        camera: of the frame.
        object_id: number of the body of each pixel, -1 in the background.
        depth: of each pixel along the optical axis [m].
    """
    labels: list[KeypointLabel] = []
    for point in points:
        pose = surfaces[point.body].geometry.pose
        in_body = pose.at(0.0).to_body(np.asarray(point.position))
        world = pose.at(time).to_world(in_body)
        ahead = float(camera.frame[2] @ (world - np.asarray(camera.position)))
        label = KeypointLabel(
            name=point.name, body=point.body, x=0.0, y=0.0, visibility=OUTSIDE
        )
        if ahead > 0.0:
            column, row = (camera.project(world[None])[0] - 0.5).tolist()
            x = round(column)
            y = round(row)
            if 0 <= x < camera.width and 0 <= y < camera.height:
                near = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
                # Within a pixel, over which the depth of an oblique surface changes.
                depths = depth[near][object_id[near] == point.body]
                is_visible = ahead <= depths.max(initial=0.0) * (1.0 + 1e-6)
                label["x"] = column
                label["y"] = row
                label["visibility"] = VISIBLE if is_visible else HIDDEN
        labels.append(label)
    return labels
