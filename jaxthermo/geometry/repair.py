"""Mend what a scan or an exporter leaves behind, and count each kind of defect."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Int

from .connectivity import edges_of, part_labels
from .holes import fill_small_holes
from .mesh import Mesh
from .winding import consistent_winding, outward_winding


MAX_HOLE_EDGES = 8


def repair_mesh(mesh: Mesh, *, max_hole_edges: int = MAX_HOLE_EDGES) -> Mesh:
    """Weld, clean, orient and close a mesh; `repairs` counts what was done.

    Equal vertices become one; faces that use a vertex twice and copies of a face go;
    winding becomes consistent and outward, where a part inside another that points the
    other way stays a cavity; holes of few edges and little area are filled; vertices
    that no face uses go. A face of zero area between three distinct vertices stays: its
    neighbours would gape without it.
    """
    counts = {"unused_vertices": len(mesh.vertices) - len(np.unique(mesh.faces))}
    mesh, counts["merged_vertices"] = _merge_vertices(mesh)
    mesh, counts["degenerate_faces"] = _drop(mesh, _is_degenerate(mesh.faces))
    mesh, counts["duplicate_faces"] = _drop(mesh, _is_duplicate(mesh.faces))
    aligned = consistent_winding(mesh.faces)
    closed, counts["filled_holes"] = fill_small_holes(
        replace(mesh, faces=aligned), max_hole_edges
    )
    outward = outward_winding(closed)
    turned = outward[: len(mesh.faces)] != mesh.faces
    counts["flipped_faces"] = int(turned.any(1).sum())
    mesh = _drop_unused(replace(closed, faces=outward))
    before = mesh.repairs
    total = {kind: before.get(kind, 0) + counts[kind] for kind in counts}
    return replace(mesh, repairs={kind: n for kind, n in total.items() if n})


def _merge_vertices(mesh: Mesh) -> tuple[Mesh, int]:
    # Adding zero turns -0.0 into 0.0; float64 rows sort fastest column by column.
    points = mesh.vertices + 0.0
    order = np.lexsort(points.T)
    ordered = points[order]
    is_new = np.ones(len(points), bool)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(1)
    group = np.empty(len(points), np.int64)
    group[order] = np.cumsum(is_new) - 1
    # The first of each group in file order stands for it, so order is kept.
    first = np.full(int(is_new.sum()), len(points))
    np.minimum.at(first, group, np.arange(len(points)))
    used = np.unique(mesh.faces)
    merged = len(used) - len(np.unique(group[used]))
    return replace(mesh, vertices=points, faces=first[group][mesh.faces]), merged


def _drop(mesh: Mesh, unwanted: Bool[np.ndarray, "f"]) -> tuple[Mesh, int]:
    return replace(mesh, faces=mesh.faces[~unwanted]), int(unwanted.sum())


def _is_degenerate(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, "f"]:
    return (faces == np.roll(faces, 1, axis=1)).any(1)


def _is_duplicate(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, "f"]:
    """Copies of an earlier face: the same way round, or turned and not a wall.

    Two faces back to back are a wall between two parts, and stay, unless their whole
    part is doubled (a two-sided export) or they leave an edge with an odd use.
    """
    lowest = faces.argmin(1)
    turned = np.take_along_axis(faces, (lowest[:, None] + np.arange(3)) % 3, axis=1)
    way = turned[:, 1] > turned[:, 2]
    corners, same = np.unique(np.sort(faces, 1), axis=0, return_inverse=True)
    same = same.reshape(-1)
    _, first = np.unique(2 * same + way, return_index=True)
    copy = np.ones(len(faces), bool)
    copy[first] = False
    kept = np.flatnonzero(~copy)
    partners = np.bincount(same[kept], minlength=len(corners))[same[kept]] == 2
    if partners.any():
        labels = part_labels(faces[kept])
        singles = np.bincount(labels[~partners], minlength=int(labels.max()) + 1)
        odd = edges_of(faces[kept])
        uneven = (odd.uses[odd.edge] % 2 == 1).reshape(-1, 3).any(1)
        suspect = partners & (uneven | (singles[labels] == 0))
        _, earliest = np.unique(same[kept], return_index=True)
        later = np.ones(len(kept), bool)
        later[earliest] = False
        copy[kept[suspect & later]] = True
    return copy


def _drop_unused(mesh: Mesh) -> Mesh:
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    number = np.cumsum(used) - 1
    return replace(mesh, vertices=mesh.vertices[used], faces=number[mesh.faces])
