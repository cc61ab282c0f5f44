"""Labels of a frame for detector networks: boxes and masks of COCO, camera matrices."""

import math
from collections.abc import Mapping
from typing import NamedTuple, NotRequired, TypedDict

import numpy as np
from jaxtyping import Bool, Float, Int

from ..surface.abstract_camera import AbstractCamera
from ..surface.camera import Camera
from .keypoints import OUTSIDE, KeypointLabel


class _Instance(NamedTuple):
    """Visible pixels of a body, or of a part of it, in a frame."""

    number: int
    box: tuple[int, int, int, int]
    """Left, top, width and height [pixels]."""
    area: int
    """Number of pixels."""
    mask: Bool[np.ndarray, "h w"]

    @property
    def is_cut(self) -> bool:
        """True if it reaches an edge of the image."""
        left, top, width, height = self.box
        rows, columns = self.mask.shape
        return left == 0 or top == 0 or left + width == columns or top + height == rows


def instances(number: Int[np.ndarray, "h w"]) -> list[_Instance]:
    """Visible instances of an image of numbers, -1 in the background."""
    visible = []
    for instance_number in np.unique(number[number >= 0]).tolist():
        mask = number == instance_number
        rows = np.flatnonzero(mask.any(axis=1))
        columns = np.flatnonzero(mask.any(0))
        left = int(columns[0])
        top = int(rows[0])
        size = int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top
        visible.append(
            _Instance(
                number=instance_number,
                box=(left, top, *size),
                area=int(mask.sum()),
                mask=mask,
            )
        )
    return visible


class _RunLengths(TypedDict):
    """Mask in the uncompressed run-length encoding of COCO."""

    counts: list[int]
    """Lengths of runs of 0 and 1 in turn, columns first."""
    size: list[int]
    """Height and width [pixels]."""


class PartLabels(TypedDict):
    """A visible part of a body in a frame."""

    part: int
    name: str
    box: list[int]
    """Left, top, width and height [pixels]."""
    area: int
    """Number of visible pixels."""


class InstanceLabels(TypedDict):
    """A visible body in a frame."""

    body: int
    category: str
    box: list[int]
    """Left, top, width and height [pixels]."""
    area: int
    """Number of visible pixels."""
    is_cut: bool
    """True if the edge of the image cuts the body."""
    segmentation: _RunLengths
    parts: list[PartLabels]


class FrameLabels(TypedDict):
    """Labels of a frame that follow from its image."""

    width: int
    height: int
    low_K: float
    """Temperature of black in the 8-bit image [K]."""
    high_K: float
    """Temperature of white in the 8-bit image [K]."""
    saturated_pixels: int
    instances: list[InstanceLabels]
    keypoints: list[KeypointLabel]


class _LabelledFrame(FrameLabels):
    """Labels of a frame with the name of its file."""

    file: str
    """Path of the image in the folder of the dataset."""


def run_lengths(mask: Bool[np.ndarray, "h w"]) -> _RunLengths:
    """Mask in the uncompressed run-length encoding of COCO: columns first, from 0."""
    flat = mask.ravel(order="F")
    ends = np.flatnonzero(np.diff(flat)) + 1
    counts = np.diff(np.concatenate([[0], ends, [flat.size]])).tolist()
    first = [0] if flat[0] else []
    return {"counts": [*first, *counts], "size": list(mask.shape)}


class _CameraMatrices(TypedDict):
    """Matrices of a camera as plain numbers, in the axes of OpenCV."""

    world_to_camera: list[list[float]]
    K: NotRequired[list[list[float]]]
    """Intrinsic matrix of a pinhole [pixels]."""
    distortion: NotRequired[list[float]]
    """Coefficients k1, k2, p1, p2 and perhaps k3 of a pinhole's lens [-]."""
    pixels_per_metre: NotRequired[float]
    """Scale of a camera with parallel rays."""
    centre_pixel: NotRequired[list[float]]
    """Centre of the image of a camera with parallel rays [pixels]."""


def camera_matrices(camera: AbstractCamera) -> _CameraMatrices:
    """Matrices of a camera as plain numbers, in the axes of OpenCV.

    Axes of the camera are right, down and forward, and the centre of the first pixel is
    at (0, 0). A pinhole has `K`, with which K X / X_z is the pixel of a point X but for
    the `distortion` of a lens; a camera with parallel rays has `pixels_per_metre`
    instead.
    """
    rotation: Float[np.ndarray, "3 3"] = camera.frame
    shift = -rotation @ np.asarray(camera.position)
    extrinsic = np.concatenate([rotation, shift[:, None]], axis=1)
    matrices: _CameraMatrices = {"world_to_camera": extrinsic.tolist()}
    if isinstance(camera, Camera):
        matrices["K"] = camera.K.tolist()
        if camera.distortion:
            matrices["distortion"] = list(camera.distortion)
        return matrices
    height = float(getattr(camera, "view_height", math.nan))
    matrices["pixels_per_metre"] = camera.height / height
    matrices["centre_pixel"] = [(camera.width - 1) / 2, (camera.height - 1) / 2]
    return matrices


class _Annotation(TypedDict):
    """A visible body in the format of COCO."""

    id: int
    image_id: int
    category_id: int
    bbox: list[int]
    area: int
    segmentation: _RunLengths
    iscrowd: int
    keypoints: NotRequired[list[float]]
    """Column, row [pixels] and visibility of each keypoint of the category."""
    num_keypoints: NotRequired[int]
    """Number of keypoints in the image."""


class _Category(TypedDict):
    """A class of bodies."""

    id: int
    name: str
    keypoints: NotRequired[list[str]]


class _Coco(TypedDict):
    """Annotations of a dataset in the format of COCO's object detection."""

    info: dict[str, str]
    images: list[dict[str, int | str]]
    annotations: list[_Annotation]
    categories: list[_Category]


def coco(
    frames: list[_LabelledFrame],
    categories: list[str],
    description: str,
    keypoints: Mapping[str, list[str]],
) -> _Coco:
    """Annotations of all frames in the format of COCO's object detection.

    Args:
        frames: labels of the frames.
        categories: names of the classes, numbered from 1.
        description: of the dataset.
        keypoints: names of the keypoints of the classes that have some.
    """
    images: list[dict[str, int | str]] = []
    annotations: list[_Annotation] = []
    for number, frame in enumerate(frames, start=1):
        size = {"width": frame["width"], "height": frame["height"]}
        images.append({"id": number, "file_name": frame["file"], **size})
        for instance in frame["instances"]:
            category = instance["category"]
            annotation: _Annotation = {
                "id": len(annotations) + 1,
                "image_id": number,
                "category_id": categories.index(category) + 1,
                "bbox": instance["box"],
                "area": instance["area"],
                "segmentation": instance["segmentation"],
                "iscrowd": 0,
            }
            if category in keypoints:
                labels = _keypoints_of(instance["body"], frame, keypoints[category])
                annotation["keypoints"] = [
                    value
                    for label in labels
                    for value in (label["x"], label["y"], label["visibility"])
                ]
                annotation["num_keypoints"] = sum(
                    label["visibility"] != OUTSIDE for label in labels
                )
            annotations.append(annotation)
    named: list[_Category] = []
    for number, name in enumerate(categories, start=1):
        described: _Category = {"id": number, "name": name}
        if name in keypoints:
            described["keypoints"] = keypoints[name]
        named.append(described)
    return {
        "info": {"description": description},
        "images": images,
        "annotations": annotations,
        "categories": named,
    }


def _keypoints_of(
    body: int, frame: _LabelledFrame, names: list[str]
) -> list[KeypointLabel]:
    """Keypoints of a body in the order of its class; those of other bodies are out."""
    labels = {k["name"]: k for k in frame["keypoints"] if k["body"] == body}
    absent = KeypointLabel(name="", body=body, x=0.0, y=0.0, visibility=OUTSIDE)
    return [labels.get(name, absent) for name in names]
