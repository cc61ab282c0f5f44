"""Mesh repair: weld, clean, orient and close, with a count of each kind of defect.

The repairs of trimesh would turn cavities outward, flip bands with one side, drop walls
between two bodies, and close cups as well as holes.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from .mesh import (
    Mesh,
    connected_labels,
    edges_of,
    is_closed,
    part_labels,
    part_volumes,
    winding_number,
)


MAX_HOLE_EDGES = 8
"""Default of `max_hole_edges` [-]."""

# A part with less volume over area^1.5 than this is a sheet, which has no inside.
_MIN_COMPACTNESS = 1e-3

# A larger hole, relative to its part's area, is intended: a cup is no defect.
_MAX_HOLE_AREA = 0.1


def repair_mesh(
    mesh: Mesh, *, max_hole_edges: int = MAX_HOLE_EDGES, turns_open: bool = True
) -> Mesh:
    """Weld, clean, orient and close a mesh; `Mesh.repairs` counts the changes.

    Equal vertices are merged, degenerate and duplicate faces and unused vertices
    removed, faces wound consistently and outward (a part inside another that points
    the other way stays a cavity), and holes of at most `max_hole_edges` edges filled.
    Without `turns_open` the winding of a part that stays open is that of most of its
    faces in the file, which says where the front of a wall is.
    """
    # A face of zero area between three distinct vertices stays: without it its
    # neighbours would have open edges.
    counts = {"unused_vertices": len(mesh.vertices) - len(np.unique(mesh.faces))}
    mesh, counts["merged_vertices"] = _merge_vertices(mesh)
    mesh, counts["degenerate_faces"] = _drop(mesh, _is_degenerate(mesh.faces))
    mesh, counts["duplicate_faces"] = _drop(mesh, _is_duplicate(mesh.faces))
    aligned = _consistent_winding(mesh.faces)
    closed, counts["filled_holes"] = _fill_small_holes(
        replace(mesh, faces=aligned), max_hole_edges
    )
    outward = _outward_winding(closed, turns_open)
    turned = outward[: len(mesh.faces)] != mesh.faces
    counts["flipped_faces"] = int(turned.any(1).sum())
    mesh = _drop_unused(replace(closed, faces=outward))
    earlier = mesh.repairs
    total = {defect: earlier.get(defect, 0) + counts[defect] for defect in counts}
    return replace(mesh, repairs={defect: n for defect, n in total.items() if n})


def _merge_vertices(mesh: Mesh) -> tuple[Mesh, int]:
    # Adding zero turns -0.0 into 0.0.
    points = mesh.vertices + 0.0
    # The first vertex of each group in file order represents it: order is kept.
    _, first, group = np.unique(points, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    used = np.unique(mesh.faces)
    merged = len(used) - len(np.unique(group[used]))
    return replace(mesh, vertices=points, faces=first[group][mesh.faces]), merged


def _drop(mesh: Mesh, unwanted: Bool[np.ndarray, "f"]) -> tuple[Mesh, int]:
    return replace(mesh, faces=mesh.faces[~unwanted]), int(unwanted.sum())


def _is_degenerate(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, "f"]:
    return (faces == np.roll(faces, 1, axis=1)).any(1)


def _is_duplicate(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, "f"]:
    """Flag copies of an earlier face, with the same or the opposite winding."""
    # Two faces back to back are a wall between two parts, and stay, unless their whole
    # part is doubled (a two-sided export) or they leave an edge with an odd use.
    lowest = faces.argmin(1)
    turned = np.take_along_axis(faces, (lowest[:, None] + np.arange(3)) % 3, axis=1)
    winding = turned[:, 1] > turned[:, 2]
    corners, same = np.unique(np.sort(faces, 1), axis=0, return_inverse=True)
    same = same.reshape(-1)
    _, first = np.unique(2 * same + winding, return_index=True)
    copy = np.ones(len(faces), bool)
    copy[first] = False
    distinct = np.flatnonzero(~copy)
    partners = np.bincount(same[distinct], minlength=len(corners))[same[distinct]] == 2
    if partners.any():
        labels = part_labels(faces[distinct])
        singles = np.bincount(labels[~partners], minlength=int(labels.max()) + 1)
        odd = edges_of(faces[distinct])
        uneven = (odd.uses[odd.edge] % 2 == 1).reshape(-1, 3).any(1)
        suspect = partners & (uneven | (singles[labels] == 0))
        _, earliest = np.unique(same[distinct], return_index=True)
        later = np.ones(len(distinct), bool)
        later[earliest] = False
        copy[distinct[suspect & later]] = True
    return copy


def _drop_unused(mesh: Mesh) -> Mesh:
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    number = np.cumsum(used) - 1
    return replace(mesh, vertices=mesh.vertices[used], faces=number[mesh.faces])


def _consistent_winding(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
    """Flip the fewest faces such that neighbours agree across every two-face edge."""
    # Each face is two nodes of a graph, as it is and flipped; a link joins the states
    # that agree. The two components of a part are its two windings, so one labelling
    # solves all parts. Where they coincide (a Moebius band) the part stays as it is.
    edges = edges_of(faces)
    pairs = edges.pairs
    differ = edges.start[pairs[:, 0]] == edges.start[pairs[:, 1]]
    if not differ.any():
        return faces
    count = len(faces)
    a, b = pairs.T // 3
    shift = np.where(differ, count, 0)
    links = np.concatenate(
        [np.stack([a, b + shift], 1), np.stack([a + count, b + count - shift], 1)]
    )
    label = connected_labels(2 * count, links)
    as_is = label[:count]
    turned = label[count:]
    # The lower label of its two windings identifies a part.
    lower_label = np.minimum(as_is, turned)
    differs = (as_is != lower_label) & (as_is != turned)
    outvoted = np.bincount(lower_label, differs, 2 * count) > np.bincount(
        lower_label, ~differs, 2 * count
    )
    one_sided = np.bincount(lower_label, as_is == turned, 2 * count) > 0
    return _flip(faces, (differs ^ outvoted[lower_label]) & ~one_sided[lower_label])


def _outward_winding(mesh: Mesh, turns_open: bool) -> Int[np.ndarray, "f 3"]:
    """Wind each outermost part outward, flipping the parts inside it along with it."""
    # Flipping nested parts together keeps their sense relative to each other: a cavity
    # stays a cavity, whichever way the file wound the outer surface.
    labels = part_labels(mesh.faces)
    part_count = int(labels.max(initial=-1)) + 1
    volumes = part_volumes(mesh, labels, part_count)
    face_areas = np.linalg.norm(mesh.area_vectors, axis=1)
    areas = np.bincount(labels, weights=face_areas, minlength=part_count)
    closed = is_closed(edges_of(mesh.faces), labels, part_count)
    min_compactness = np.where(closed, 0.0, _MIN_COMPACTNESS)
    inward = volumes < -min_compactness * areas**1.5
    if not turns_open:
        inward &= closed
    if not inward.any():
        return mesh.faces
    triangles = mesh.triangles
    outermost = np.arange(part_count)
    lower = np.full((part_count, 3), np.inf)
    upper = np.full((part_count, 3), -np.inf)
    np.minimum.at(lower, labels, triangles.min(1))
    np.maximum.at(upper, labels, triangles.max(1))
    box_volumes = np.prod(upper - lower, axis=1)
    for outer in np.argsort(-box_volumes, kind="stable"):
        if outermost[outer] != outer:
            continue
        boxed = (lower > lower[outer]).all(1) & (upper < upper[outer]).all(1)
        # The costly winding number is needed only where it would change the result.
        is_outermost = outermost == np.arange(part_count)
        boxed &= is_outermost & (inward != inward[outer])
        surface = triangles[labels == outer] if boxed.any() else triangles[:0]
        for inner in np.flatnonzero(boxed):
            point = triangles[np.argmax(labels == inner)].mean(0)
            if abs(winding_number(surface, point)) > 0.5:
                outermost[inner] = outer
    return _flip(mesh.faces, inward[outermost][labels])


def _flip(
    faces: Int[np.ndarray, "f 3"], which: Bool[np.ndarray, "f"]
) -> Int[np.ndarray, "f 3"]:
    return np.where(which[:, None], faces[:, [0, 2, 1]], faces)


def _fill_small_holes(mesh: Mesh, max_edges: int) -> tuple[Mesh, int]:
    """Close the holes of at most `max_edges` edges by fans; return how many.

    A hole stays open if it is large compared with its part, or if every fan over it
    would use an edge that the mesh already has.
    """
    loops = [loop for loop in _boundary_loops(mesh.faces) if len(loop) <= max_edges]
    if not loops:
        return mesh, 0
    labels = part_labels(mesh.faces)
    face_areas = np.linalg.norm(mesh.area_vectors, axis=1)
    areas = np.bincount(labels, weights=face_areas)
    limit = np.zeros(len(mesh.vertices))
    limit[mesh.faces] = _MAX_HOLE_AREA * areas[labels][:, None]
    edges = edges_of(mesh.faces)
    used_edges = set(zip(edges.start.tolist(), edges.end.tolist(), strict=True))
    fans: list[Int[np.ndarray, "t 3"]] = []
    for loop in loops:
        fan = _best_fan(
            mesh.vertices,
            loop=loop,
            used_edges=used_edges,
            max_area=float(limit[loop[0]]),
        )
        if fan is not None:
            fans.append(fan)
            tails = fan.reshape(-1).tolist()
            heads = np.roll(fan, -1, axis=1).reshape(-1).tolist()
            used_edges.update(zip(tails, heads, strict=True))
    if not fans:
        return mesh, 0
    return replace(mesh, faces=np.concatenate([mesh.faces, *fans])), len(fans)


def _boundary_loops(faces: Int[np.ndarray, "f 3"]) -> list[list[int]]:
    """List the holes as rings of vertices, in the winding of a face that fills them."""
    edges = edges_of(faces)
    lone = edges.border
    onward: dict[int, list[int]] = {}
    for tail, head in zip(edges.end[lone], edges.start[lone], strict=True):
        onward.setdefault(int(tail), []).append(int(head))
    loops = []
    for first in list(onward):
        while onward.get(first):
            loops += _walk(first, onward)
    return loops


def _walk(first: int, onward: dict[int, list[int]]) -> list[list[int]]:
    # Where two holes meet in a vertex the path drops each ring as it closes, so that
    # every ring visits a vertex once.
    path = [first]
    position = {first: 0}
    loops = []
    while onward.get(path[-1]):
        vertex = onward[path[-1]].pop()
        if vertex not in position:
            position[vertex] = len(path)
            path.append(vertex)
            continue
        loops.append(path[position[vertex] :])
        for dropped in path[position[vertex] + 1 :]:
            del position[dropped]
        path = path[: position[vertex] + 1]
    return loops


def _best_fan(
    vertices: Float[np.ndarray, "v 3"],
    loop: list[int],
    used_edges: set[tuple[int, int]],
    max_area: float,
) -> Int[np.ndarray, "t 3"] | None:
    """Fan of minimal area over a ring, or None where none is valid."""
    best = None
    best_area = max_area
    for start in range(len(loop)):
        ring = loop[start:] + loop[:start]
        spokes = [(ring[0], tip) for tip in ring[2:-1]]
        if len(ring) < 3 or any(
            s in used_edges or s[::-1] in used_edges for s in spokes
        ):
            continue
        fan = np.array([(ring[0], *side) for side in pairwise(ring[1:])])
        a, b, c = np.moveaxis(vertices[fan], 1, 0)
        doubled_areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        area = float(0.5 * doubled_areas.sum())
        if area < best_area:
            best = fan
            best_area = area
    return best
