"""What the crossings of one ray say about the body: what is inside it, what is thin."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ..raster.layers import DepthLayers
from .fill import balanced_rays, turn


SAME_DEPTH = 1e-4
"""Crossings closer than this, in cells, count as one surface when parts touch."""


def hidden_inside(layers: DepthLayers) -> Bool[np.ndarray, " k"]:
    """Crossings with the body on both sides: where closed parts overlap or touch.

    On a ray that has passed a hole nothing can be said, and nothing is hidden.
    """
    if not len(layers.pixel):
        return np.zeros(0, bool)
    step = turn(layers).astype(np.int64)
    # Balanced rays sum to zero, and of the others nothing is asked.
    balanced = balanced_rays(layers)[layers.pixel]
    after = np.cumsum(np.where(balanced, step, 0))
    apart = np.ones(len(after), bool)
    apart[1:] = (layers.pixel[1:] != layers.pixel[:-1]) | (
        np.diff(layers.depth) > SAME_DEPTH
    )
    start = np.flatnonzero(apart)
    last = np.append(start[1:], len(after)) - 1
    between = ((after - step)[start] != 0) & (after[last] != 0)
    return between[np.cumsum(apart) - 1] & balanced


def select(layers: DepthLayers, keep: Bool[np.ndarray, " k"]) -> DepthLayers:
    """Some of the fragments, with the layer numbers they had."""
    return replace(
        layers,
        pixel=layers.pixel[keep],
        depth=layers.depth[keep],
        triangle=layers.triangle[keep],
        entering=layers.entering[keep],
        layer=layers.layer[keep],
    )


def thickness_behind(layers: DepthLayers) -> Float[np.ndarray, " k"]:
    """Depth from each crossing to the next one on the body's side of it.

    Infinite where that one does not close the body.
    """
    last = max(len(layers.pixel) - 1, 0)
    entering = layers.entering
    other = np.arange(len(entering)) + np.where(entering, 1, -1)
    other = np.clip(other, 0, last)
    paired = (layers.pixel[other] == layers.pixel) & (entering[other] != entering)
    return np.where(paired, np.abs(layers.depth[other] - layers.depth), np.inf)
