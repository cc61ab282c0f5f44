"""Nodes that are much stiffer than others: they pass their area to a neighbour.

The temperature of a node of area A with conductances w to its neighbours, over those of
a square of the sheet, follows theirs within A / sum(w) over the diffusivity. Where two
nodes are close to each other that is far less than for a whole cell, and limits the
explicit steps of the sheet. Such a node stores no heat: it is eliminated, which leaves
steady heat flows as they are, and its area goes to the neighbour that it conducts to
best.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array

from .coarse import SheetLinks
from .tufted import without_capacity


_STIFF = 1 / 64
"""Area of a node over the sum of its conductances below which it is stiff [cells].

It is a quarter for a square cell among four others."""


class LooseNodes(NamedTuple):
    """The nodes that remain, and their conductances."""

    earlier: Int[np.ndarray, " m"]
    """Earlier number of each node; sorted."""
    node: Int[np.ndarray, " n"]
    """Node that has the area of each earlier one: itself, if it remains."""
    links: SheetLinks


def without_stiff_nodes(
    links: SheetLinks, area: Float[np.ndarray, " n"], pitch: float
) -> LooseNodes:
    """Eliminate nodes that are stiff, but those at which two parts meet.

    Args:
        links: conductances between the nodes by part.
        area: area of each node [m^2].
        pitch: edge of a cell [m].
    """
    earlier = np.arange(len(area))
    heir = np.arange(len(area))
    parts = range(int(links.part.max(initial=0)) + 1)
    weights = [_matrix(links, part, len(area)) for part in parts]
    while True:
        stiff = _stiffest(weights, area, _STIFF * pitch**2)
        if not stiff.any():
            break
        all_parts: Any = sum(weights)
        best = all_parts[stiff].argmax(axis=1)
        heir[earlier[stiff]] = earlier[best]
        area = area + np.bincount(best, area[stiff], len(area))
        order = np.argsort(stiff, kind="stable")
        remaining = order[: len(order) - int(stiff.sum())]
        # The Laplacian's entries off its diagonal are the conductances' negatives.
        weights = [
            without_capacity(-part[order][:, order], len(remaining)) for part in weights
        ]
        area = area[remaining]
        earlier = earlier[remaining]
    while (heir[heir] != heir).any():
        heir = heir[heir]
    return LooseNodes(
        earlier=earlier,
        node=np.searchsorted(earlier, heir),
        links=_joined_links(weights),
    )


def _stiffest(
    weights: list[csr_array], area: Float[np.ndarray, " n"], limit: float
) -> Bool[np.ndarray, " n"]:
    """Flag stiff nodes of one part that are stiffer than all of their neighbours."""
    sums = np.stack([part.sum(axis=1) for part in weights])
    total = sums.sum(axis=0)
    ratio = np.where(total > 0, area / np.where(total > 0, total, 1), np.inf)
    stiff = (ratio < limit) & ((sums > 0).sum(axis=0) == 1)
    # No two are equally stiff.
    rank = np.argsort(np.argsort(ratio, kind="stable"))
    lowest = np.full(len(area), len(area))
    for part in weights:
        row, column = coo_array(part).coords
        rivals = stiff[column]
        np.minimum.at(lowest, row[rivals], rank[column[rivals]])
    return stiff & (rank < lowest)


def _matrix(links: SheetLinks, part: int, count: int) -> csr_array:
    """Conductances of one part as a symmetric matrix [-]."""
    chosen = links.part == part
    src = links.src[chosen]
    dst = links.dst[chosen]
    weight = np.tile(links.weight[chosen], 2)
    ends = (np.concatenate([src, dst]), np.concatenate([dst, src]))
    return csr_array((weight, ends), shape=(count, count))


def _joined_links(weights: list[csr_array]) -> SheetLinks:
    entries = [coo_array(part) for part in weights]
    src = np.concatenate([part.coords[0] for part in entries]).astype(np.int64)
    dst = np.concatenate([part.coords[1] for part in entries]).astype(np.int64)
    part = np.repeat(np.arange(len(entries)), [part.nnz for part in entries])
    weight = np.concatenate([matrix.data for matrix in entries])
    order = np.lexsort([part, dst, src])
    order = order[(src < dst)[order]]
    return SheetLinks(
        src=src[order], dst=dst[order], part=part[order], weight=weight[order]
    )
