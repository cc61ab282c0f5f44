"""Array code that several packages need."""

import numpy as np
from jaxtyping import Int


def members(group: Int[np.ndarray, " k"], groups: int) -> Int[np.ndarray, "m g"]:
    """The first entry of every group, the second, and so on; k where there is none.

    Args:
        group: of each entry.
        groups: how many there are.
    """
    order = np.argsort(group, kind="stable").astype(np.int32)
    found = np.full((np.bincount(group).max(), groups), len(group), np.int32)
    found[rank_in_group(group[order]), group[order]] = order
    return found


def rank_in_group(group: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Rank of each entry among those of its group; groups come one after the other."""
    slots = np.arange(len(group))
    first = np.ones(len(group), bool)
    first[1:] = group[1:] != group[:-1]
    return slots - np.maximum.accumulate(np.where(first, slots, 0))
