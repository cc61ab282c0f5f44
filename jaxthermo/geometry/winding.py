"""Turn faces so that neighbours agree and closed parts point outward."""

import numpy as np
from jaxtyping import Bool, Float, Int

from .connectivity import (
    connected_labels,
    edge_pairs,
    edges_of,
    is_closed,
    part_labels,
)
from .mesh import Mesh


# Below this volume over area^1.5 an open part is a sheet, which has no inside.
_SHEET = 1e-3


def consistent_winding(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
    """Turn the fewest faces such that neighbours agree across every two-face edge.

    Each face stands twice in a graph, as it is and turned; a link joins the two states
    that agree. A part's two components are its two windings, so one labelling solves
    all parts at once. A part where they coincide (a Moebius band) is left as it is.
    """
    edges = edges_of(faces)
    pairs = edge_pairs(edges)
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
    as_is, turned = label[:count], label[count:]
    # Each part is known by the lower label of its two windings.
    part = np.minimum(as_is, turned)
    off = (as_is != part) & (as_is != turned)
    outvoted = np.bincount(part, off, 2 * count) > np.bincount(part, ~off, 2 * count)
    one_sided = np.bincount(part, as_is == turned, 2 * count) > 0
    return _flip(faces, (off ^ outvoted[part]) & ~one_sided[part])


def outward_winding(mesh: Mesh) -> Int[np.ndarray, "f 3"]:
    """Turn each outermost part outward, and all that lies inside it along with it.

    Turning a nest as a whole keeps the sense of its parts to each other: a cavity stays
    a cavity, whichever way the file had the outer surface.
    """
    labels = part_labels(mesh.faces)
    parts = int(labels.max(initial=-1)) + 1
    volumes = part_volumes(mesh, labels, parts)
    areas = np.bincount(labels, np.linalg.norm(mesh.area_vectors, axis=1), parts)
    closed = is_closed(edges_of(mesh.faces), labels, parts)
    inward = volumes < -np.where(closed, 0.0, _SHEET) * areas**1.5
    if not inward.any():
        return mesh.faces
    lower, upper = _part_bounds(mesh, labels, parts)
    triangles, outermost = mesh.triangles, np.arange(parts)
    for outer in np.argsort(-np.prod(upper - lower, axis=1), kind="stable"):
        if outermost[outer] != outer:
            continue
        boxed = (lower > lower[outer]).all(1) & (upper < upper[outer]).all(1)
        # Being inside matters only where it changes whether the part is turned.
        boxed &= (outermost == np.arange(parts)) & (inward != inward[outer])
        surface = triangles[labels == outer] if boxed.any() else triangles[:0]
        for inner in np.flatnonzero(boxed):
            point = triangles[np.argmax(labels == inner)].mean(0)
            if abs(winding_number(surface, point)) > 0.5:
                outermost[inner] = outer
    return _flip(mesh.faces, inward[outermost][labels])


def part_volumes(
    mesh: Mesh, labels: Int[np.ndarray, "f"], parts: int
) -> Float[np.ndarray, "parts"]:
    """Signed volume of each part about its own centre [m^3]."""
    centre = mesh.triangles.mean(1)
    weight = np.bincount(labels, minlength=parts)
    origin = np.stack(
        [np.bincount(labels, axis, parts) / weight for axis in centre.T], axis=1
    )
    share = ((centre - origin[labels]) * mesh.area_vectors).sum(1) / 3.0
    return np.bincount(labels, share, parts)


def winding_number(
    triangles: Float[np.ndarray, "f 3 3"], point: Float[np.ndarray, "3"]
) -> float:
    """How often a surface goes round a point [-]: the sum of solid angles over 4 pi.

    Van Oosterom and Strackee, "The solid angle of a plane triangle" (1983). It stays
    near a whole number for surfaces with small holes, where counting hits does not.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    triple = (a * np.cross(b, c)).sum(1)
    base = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la
    base += (c * a).sum(1) * lb
    return float(np.arctan2(triple, base).sum() / (2.0 * np.pi))


def _part_bounds(
    mesh: Mesh, labels: Int[np.ndarray, "f"], parts: int
) -> tuple[Float[np.ndarray, "parts 3"], Float[np.ndarray, "parts 3"]]:
    lower, upper = np.full((parts, 3), np.inf), np.full((parts, 3), -np.inf)
    np.minimum.at(lower, labels, mesh.triangles.min(1))
    np.maximum.at(upper, labels, mesh.triangles.max(1))
    return lower, upper


def _flip(
    faces: Int[np.ndarray, "f 3"], which: Bool[np.ndarray, "f"]
) -> Int[np.ndarray, "f 3"]:
    return np.where(which[:, None], faces[:, [0, 2, 1]], faces)
