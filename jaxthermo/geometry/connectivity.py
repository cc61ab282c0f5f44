"""Edges and connected parts of a triangle mesh, by array operations only."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int


@dataclass(frozen=True)
class _Edges:
    """Edge table of a mesh; half-edge `3 f + i` leaves corner i of face f."""

    start: Int[np.ndarray, "h"]
    end: Int[np.ndarray, "h"]
    edge: Int[np.ndarray, "h"]
    """Number of the undirected edge of each half-edge."""
    uses: Int[np.ndarray, "e"]
    """Half-edges along each edge: 2 on a closed surface."""
    balance: Int[np.ndarray, "e"]
    """Half-edges towards the higher vertex minus those towards the lower one."""


def edges_of(faces: Int[np.ndarray, "f 3"]) -> _Edges:
    """Build the edge table of a mesh."""
    start = faces.reshape(-1).astype(np.int64)
    end = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    # One integer per edge: np.unique of integers is much faster than of rows.
    width = int(faces.max(initial=0)) + 1
    key = np.minimum(start, end) * width + np.maximum(start, end)
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    upward = np.where(start < end, 1.0, -1.0)
    balance = np.bincount(edge, weights=upward, minlength=len(uses)).astype(np.int64)
    return _Edges(start, end, edge, uses, balance)


def edge_pairs(edges: _Edges) -> Int[np.ndarray, "p 2"]:
    """Pairs of half-edges along the edges that have exactly two."""
    order = np.argsort(edges.edge, kind="stable")
    paired = order[edges.uses[edges.edge[order]] == 2]
    return paired.reshape(-1, 2)


def part_labels(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f"]:
    """Label the faces from 0 by connected part, connected over edges."""
    if not len(faces):
        return np.zeros(0, np.int64)
    edges = edges_of(faces)
    # All faces along an edge link to the first one there: a star is enough.
    _, first = np.unique(edges.edge, return_index=True)
    links = np.stack([np.arange(len(edges.edge)), first[edges.edge]], 1) // 3
    roots = connected_labels(len(faces), links)
    return np.unique(roots, return_inverse=True)[1].astype(np.int64)


def connected_labels(
    count: int, links: Int[np.ndarray, "l 2"]
) -> Int[np.ndarray, "count"]:
    """Label each node of a graph with the lowest node of its connected part."""
    label = np.arange(count)
    # Roots are hooked to their lowest neighbour and paths are halved until nothing
    # changes: a few passes over the links, none of them a Python loop over nodes.
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
    edges: _Edges, labels: Int[np.ndarray, "f"], parts: int
) -> Bool[np.ndarray, "parts"]:
    """Flag the parts in which every edge is used equally often in both directions."""
    open_edge = edges.balance[edges.edge] != 0
    touched = np.bincount(np.repeat(labels, 3)[open_edge], minlength=parts)
    return touched == 0
