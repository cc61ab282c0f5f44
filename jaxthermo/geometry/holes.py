"""Fill small holes with fans of triangles."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from .connectivity import edges_of, part_labels
from .mesh import Mesh


# A hole of more than this share of its part's area is meant: a cup is no defect.
_AREA_SHARE = 0.1


def fill_small_holes(mesh: Mesh, max_edges: int) -> tuple[Mesh, int]:
    """Close the holes of at most `max_edges` edges; tells how many were closed.

    A hole stays open if it is large beside its part, or if no fan over it is free of
    edges that the mesh already has.
    """
    loops = [loop for loop in boundary_loops(mesh.faces) if len(loop) <= max_edges]
    if not loops:
        return mesh, 0
    labels = part_labels(mesh.faces)
    areas = np.bincount(labels, np.linalg.norm(mesh.area_vectors, axis=1))
    limit = np.zeros(len(mesh.vertices))
    limit[mesh.faces] = _AREA_SHARE * areas[labels][:, None]
    edges = edges_of(mesh.faces)
    taken = set(zip(edges.start.tolist(), edges.end.tolist(), strict=True))
    fans: list[Int[np.ndarray, "t 3"]] = []
    for loop in loops:
        fan = _best_fan(mesh.vertices, loop, taken, float(limit[loop[0]]))
        if fan is not None:
            fans.append(fan)
            rim = np.roll(fan, -1, axis=1).reshape(-1)
            taken.update(zip(fan.reshape(-1).tolist(), rim.tolist(), strict=True))
    if not fans:
        return mesh, 0
    return replace(mesh, faces=np.concatenate([mesh.faces, *fans])), len(fans)


def boundary_loops(faces: Int[np.ndarray, "f 3"]) -> list[list[int]]:
    """The holes of a mesh as rings of vertices, in the winding of a face that fills.

    Where two holes meet in a vertex the walk drops each ring as it closes, so that
    every ring visits a vertex once.
    """
    edges = edges_of(faces)
    lone = edges.uses[edges.edge] == 1
    onward: dict[int, list[int]] = {}
    for tail, head in zip(edges.end[lone], edges.start[lone], strict=True):
        onward.setdefault(int(tail), []).append(int(head))
    loops = []
    for first in list(onward):
        while onward.get(first):
            loops += _walk(first, onward)
    return loops


def _walk(first: int, onward: dict[int, list[int]]) -> list[list[int]]:
    path, place, loops = [first], {first: 0}, []
    while onward.get(path[-1]):
        vertex = onward[path[-1]].pop()
        if vertex not in place:
            place[vertex] = len(path)
            path.append(vertex)
            continue
        loops.append(path[place[vertex] :])
        for dropped in path[place[vertex] + 1 :]:
            del place[dropped]
        path = path[: place[vertex] + 1]
    return loops


def _best_fan(
    vertices: Float[np.ndarray, "v 3"],
    loop: list[int],
    taken: set[tuple[int, int]],
    largest: float,
) -> Int[np.ndarray, "t 3"] | None:
    """The fan of least area over a ring, or None where none is fit."""
    best, best_area = None, largest
    for turn in range(len(loop)):
        ring = loop[turn:] + loop[:turn]
        spokes = [(ring[0], tip) for tip in ring[2:-1]]
        if len(ring) < 3 or any(s in taken or s[::-1] in taken for s in spokes):
            continue
        fan = np.array([(ring[0], *side) for side in pairwise(ring[1:])])
        a, b, c = np.moveaxis(vertices[fan], 1, 0)
        area = float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        if area < best_area:
            best, best_area = fan, area
    return best
