"""Which of many axis-aligned boxes overlap: the broad phase of contact."""

import numpy as np
from jaxtyping import Float, Int


def overlapping_pairs(
    lower: Float[np.ndarray, "b 3"], upper: Float[np.ndarray, "b 3"]
) -> Int[np.ndarray, "p 2"]:
    """Pairs i < j of boxes that share a point, by sort and sweep.

    Sorted along the axis on which they are spread most, a box can only meet those that
    start before it ends.

    Args:
        lower: lowest corners [m].
        upper: highest corners [m].
    """
    axis = int(np.argmax(np.ptp(lower, axis=0))) if len(lower) else 0
    order = np.argsort(lower[:, axis], kind="stable")
    starts, ends = lower[order, axis], upper[order, axis]
    ahead = np.searchsorted(starts, ends, side="right") - np.arange(len(order)) - 1
    ahead = np.maximum(ahead, 0)
    first = np.repeat(np.arange(len(order)), ahead)
    step = np.arange(len(first)) - np.repeat(np.cumsum(ahead) - ahead, ahead)
    pairs = np.stack([order[first], order[first + 1 + step]], axis=1)
    i, j = pairs.T
    meet = ((lower[i] <= upper[j]) & (lower[j] <= upper[i])).all(1)
    found = np.sort(pairs[meet], axis=1)
    return found[np.lexsort(found.T[::-1])]
