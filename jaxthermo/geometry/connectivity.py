"""Which faces share edges, and which hang together: array operations only."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int


@dataclass(frozen=True)
class Edges:
    """The edges of a mesh; half-edge `3 f + i` leaves corner i of face f."""

    start: Int[np.ndarray, "h"]
    end: Int[np.ndarray, "h"]
    edge: Int[np.ndarray, "h"]
    """The undirected edge that each half-edge runs along."""
    uses: Int[np.ndarray, "e"]
    """Half-edges along each edge: 2 on a closed surface."""
    balance: Int[np.ndarray, "e"]
    """Half-edges towards the higher vertex less those towards the lower one."""


def edges_of(faces: Int[np.ndarray, "f 3"]) -> Edges:
    """The edge table of a mesh."""
    start = faces.reshape(-1).astype(np.int64)
    end = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    width = int(faces.max(initial=0)) + 1
    key = np.minimum(start, end) * width + np.maximum(start, end)
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    upward = np.where(start < end, 1.0, -1.0)
    balance = np.bincount(edge, weights=upward, minlength=len(uses)).astype(np.int64)
    return Edges(start, end, edge, uses, balance)


def edge_pairs(edges: Edges) -> Int[np.ndarray, "p 2"]:
    """The two half-edges of each edge that has exactly two."""
    order = np.argsort(edges.edge, kind="stable")
    paired = order[edges.uses[edges.edge[order]] == 2]
    return paired.reshape(-1, 2)


def part_labels(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f"]:
    """A number from 0 for each face, equal where faces hang together by edges."""
    if not len(faces):
        return np.zeros(0, np.int64)
    edges = edges_of(faces)
    _, first = np.unique(edges.edge, return_index=True)
    links = np.stack([np.arange(len(edges.edge)), first[edges.edge]], 1) // 3
    roots = connected_labels(len(faces), links)
    return np.unique(roots, return_inverse=True)[1].astype(np.int64)


def connected_labels(
    count: int, links: Int[np.ndarray, "l 2"]
) -> Int[np.ndarray, "count"]:
    """The lowest node of each node's connected part.

    Roots are hooked to their lowest neighbour and paths are halved until nothing
    changes: a few passes over the links, none of them a Python loop over nodes.
    """
    label = np.arange(count)
    while True:
        ends = label[links]
        links = links[ends[:, 0] != ends[:, 1]]
        if not len(links):
            return label
        ends = label[links]
        np.minimum.at(label, ends.max(1), ends.min(1))
        while not np.array_equal(label, label[label]):
            label = label[label]


def is_closed(
    edges: Edges, labels: Int[np.ndarray, "f"], parts: int
) -> Bool[np.ndarray, "parts"]:
    """Whether each part has every edge used as often one way as the other."""
    open_edge = edges.balance[edges.edge] != 0
    touched = np.bincount(np.repeat(labels, 3)[open_edge], minlength=parts)
    return touched == 0
