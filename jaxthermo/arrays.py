"""Array code that several packages need."""

import numpy as np
from jaxtyping import Int


def rank_in_group(group: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Rank of each entry among those of its group; groups come one after the other."""
    slots = np.arange(len(group))
    first = np.ones(len(group), bool)
    first[1:] = group[1:] != group[:-1]
    return slots - np.maximum.accumulate(np.where(first, slots, 0))
