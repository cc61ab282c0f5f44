"""A small picture of a run's difference from its reference, at the worst time."""

import io

import numpy as np
from jaxtyping import Float
from PIL import Image

from jaxthermo.accuracy.surface_error import AnySolution
from jaxthermo.accuracy.truth_error import AtPoints, TruthPoints
from jaxthermo.geometry.vectors import unit_vector
from jaxthermo.integrate.run.surface_reading import SurfaceReading
from jaxthermo.report.difference_scale import (
    BACKGROUND,
    DifferenceScale,
    nice_limit,
)


_HEIGHT = 160
"""Height of the picture [pixels]."""
_VIEWS = ((-1.0, 0.6, -0.25), (1.0, -0.6, -0.25))
"""Directions in which the body is seen, side by side: all of its surface is in one."""
_RADIUS = 1.6
"""Radius of a point over the distance of points that are spread evenly."""


def difference_picture(
    points: TruthPoints, solution: AnySolution, reading: SurfaceReading
) -> bytes:
    """Draw T - T_ref at the points, blue below zero and red above, as a PNG."""
    temperature = reading.read(np.asarray(solution.surface_temperature))
    measured = AtPoints(temperature, reading.is_lost)
    expected = points.expected
    is_compared = ~(measured.is_lost | expected.is_lost)
    later = np.asarray(points.times) > 0
    difference = np.asarray(measured.temperature, float) - expected.temperature
    difference = np.where(is_compared, difference, 0.0)[later]
    worst = difference[np.square(difference).mean(axis=1).argmax()]
    scale = DifferenceScale(nice_limit(float(abs(worst).max())))
    colour = scale.colour(scale.position(worst))
    colour[~is_compared] = BACKGROUND
    position = np.concatenate([sample.position for sample in points.samples])
    normal = np.concatenate([sample.normal for sample in points.samples])
    views = [
        _view(position, normal=normal, colour=colour, direction=np.array(view))
        for view in _VIEWS
    ]
    stream = io.BytesIO()
    # A sweep stores hundreds of pictures: with a palette they are smaller.
    picture = Image.fromarray(np.concatenate(views, axis=1)).quantize(64)
    picture.save(stream, "PNG", optimize=True)
    return stream.getvalue()


def _view(
    position: Float[np.ndarray, "p 3"],
    normal: Float[np.ndarray, "p 3"],
    colour: np.ndarray,
    direction: Float[np.ndarray, "3"],
) -> np.ndarray:
    """Points as discs, seen from far away along a direction, the nearest on top."""
    along = unit_vector(direction)
    right = unit_vector(np.cross(along, (0.0, 0.0, 1.0)))
    up = np.cross(right, along)
    faces = normal @ along < 0
    plane = position @ np.stack([right, -up], axis=1)
    low = plane.min(axis=0)
    extent = plane.max(axis=0) - low
    scale = (_HEIGHT - 8) / extent[1]
    width = int(extent[0] * scale) + 8
    picture = np.empty((_HEIGHT, width, 3), np.uint8)
    picture[:] = BACKGROUND
    pixel = np.rint((plane - low) * scale).astype(int) + 4
    # Discs as large as the points are far apart leave no gaps.
    radius = _RADIUS * np.sqrt(picture[..., 0].size / max(faces.sum(), 1)) / 2
    reach = int(np.ceil(radius))
    order = np.flatnonzero(faces)[np.argsort(-(position @ along)[faces])]
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dx * dx + dy * dy <= radius**2:
                x = np.clip(pixel[order, 0] + dx, 0, width - 1)
                y = np.clip(pixel[order, 1] + dy, 0, _HEIGHT - 1)
                picture[y, x] = colour[order]
    return picture
