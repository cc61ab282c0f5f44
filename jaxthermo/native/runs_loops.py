"""The loop of `runs`, for numba."""

import numba
import numpy as np

from .frame import array_at, parallel, serial
from .runs import Runs


@parallel
def _conduct(runs, state, keep, ratio, out):
    for b in numba.prange(len(runs.block) - 1):
        for r in range(runs.block[b, 0], runs.block[b + 1, 0]):
            # Slices, of which numba knows that no index counts from their end.
            first, count, ahead, behind, above, below = runs.runs[r]
            line = state[first - 1 : first + count + 1]
            target = out[first : first + count]
            north = state[ahead : ahead + count]
            south = state[behind : behind + count]
            east = state[above : above + count]
            west = state[below : below + count]
            for k in range(count):
                value = line[k + 1]
                near = (line[k] - value) + (line[k + 2] - value)
                near += (north[k] - value) + (south[k] - value)
                near += (east[k] - value) + (west[k] - value)
                target[k] = keep * value + ratio * near
        for n in range(runs.block[b, 1], runs.block[b + 1, 1]):
            at = runs.neighbour[n]
            weight = runs.weight[n]
            value = state[runs.node[n]]
            # Written out: a loop over so few is vectorized, and slower.
            near = weight[0] * (state[at[0]] - value)
            near += weight[1] * (state[at[1]] - value)
            near += weight[2] * (state[at[2]] - value)
            near += weight[3] * (state[at[3]] - value)
            near += weight[4] * (state[at[4]] - value)
            near += weight[5] * (state[at[5]] - value)
            out[runs.node[n]] = keep * value + ratio / runs.volume[n] * near
        for k in range(runs.block[b, 2], runs.block[b + 1, 2]):
            n = runs.list_row[k]
            value = state[runs.node[n]]
            near = value - value
            for e in range(runs.list_first[k], runs.list_first[k + 1]):
                near += runs.list_weight[e] * (state[runs.list_neighbour[e]] - value)
            out[runs.node[n]] += ratio / runs.volume[n] * near


@serial
def conduct(args, results, like):
    """See `runs.conducted`."""
    # Signed in JAX; numba would look for negative ones, which count from the end.
    index = np.uint32(0)
    runs = Runs(
        block=array_at(args, 3, index).reshape(-1, 3),
        runs=array_at(args, 4, index).reshape(-1, 6),
        node=array_at(args, 5, index),
        neighbour=array_at(args, 6, index).reshape(-1, 6),
        weight=array_at(args, 7, like).reshape(-1, 6),
        volume=array_at(args, 8, like),
        list_row=array_at(args, 9, index),
        list_first=array_at(args, 10, index),
        list_neighbour=array_at(args, 11, index),
        list_weight=array_at(args, 12, like),
    )
    keep = array_at(args, 1, like)[0]
    ratio = array_at(args, 2, like)[0]
    state = array_at(args, 0, like)
    out = array_at(results, 0, like)
    _conduct(runs, state=state, keep=keep, ratio=ratio, out=out)
