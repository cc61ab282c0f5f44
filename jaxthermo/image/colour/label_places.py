"""Places of labels in a picture, of which none covers another."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


# Points of an area at which its label is tried.
_TRIED = 400

Place = Float[np.ndarray, "2"]
"""Middle of a label: pixels to the right and down."""
Box = Float[np.ndarray, "2 2"]
"""Upper left and lower right corner of a rectangle [pixels]."""


def label_places(
    areas: Sequence[Float[np.ndarray, "_ 2"]],
    half_sizes: Sequence[Place],
    picture: Box,
    taken: Box,
) -> list[Place | None]:
    """Place the label of each area as near to its middle as the other labels allow.

    Small areas come first, because they leave the least choice.

    Args:
        areas: points of each area [pixels].
        half_sizes: half the width and height of each label [pixels].
        picture: all labels lie in it.
        taken: no label lies on it.

    Returns:
        The middle of each label; None where there is no room for it.
    """
    boxes = [taken]
    places: list[Place | None] = [None] * len(areas)
    for number in sorted(range(len(areas)), key=lambda area: len(areas[area])):
        half = half_sizes[number]
        inner = picture + np.array([half, -half])
        points = np.clip(_from_the_middle(areas[number]), inner[0], inner[1])
        low, high = np.stack(boxes, axis=1)
        is_apart = (points[:, None] + half <= low) | (points[:, None] - half >= high)
        free = np.flatnonzero(is_apart.any(axis=2).all(axis=1))
        if len(free):
            place = points[free[0]]
            places[number] = place
            boxes.append(np.stack([place - half, place + half]))
    return places


def _from_the_middle(area: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
    """Some points of an area, the nearest to its middle first."""
    # On a point of the area: the middle of a ring is none.
    away = np.hypot(*(area - np.median(area, axis=0)).T)
    nearest_first = np.argsort(away, kind="stable")
    step = -(-len(area) // _TRIED)
    return area[nearest_first[::step]].astype(float)
