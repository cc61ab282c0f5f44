"""Fragments of a sheet: what one node has of the surface with one normal."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..arrays import numbered
from ..geometry.vectors import row_dot, unit_vectors
from ..voxels.fragment_pieces import FragmentPieces
from .surface import Surface, summed_rows


_MAX_SPREAD = float(np.cos(np.radians(5)))
"""Cosine of the angle within which normals are merged into one fragment."""


class SheetFragments(NamedTuple):
    """Pieces of one face of the sheet: one node, one part and nearly one normal."""

    node: Int[np.ndarray, " s"]
    """Node; sorted."""
    position: Float[np.ndarray, "s 3"]
    """Mean position by area [m]."""
    normal: Float[np.ndarray, "s 3"]
    """Unit normal of the front."""
    area: Float[np.ndarray, " s"]
    """Area [m^2]; the areas of a node and part add up to `SheetCells.area`."""
    part: Int[np.ndarray, " s"]
    """Part of the mesh."""
    of_corner: Int[np.ndarray, "t 3"]
    """Fragment of the third of every triangle that is nearest to each corner."""
    pieces: FragmentPieces
    """Part of every face of the mesh in each fragment."""


def surface_fragments(
    surface: Surface, vertex_node: Int[np.ndarray, " v"]
) -> SheetFragments:
    """Merge the thirds of triangles of one node, one part and nearly one normal."""
    parts = int(surface.part.max()) + 1
    corner_node = vertex_node[surface.faces]
    # Thirds of one face of the mesh have one normal: these are compared.
    origins = int(surface.origin.max()) + 1
    key = (corner_node * origins + surface.origin[:, None]).ravel()
    entries = numbered(key)
    entry = entries.number
    triangle = entries.first // 3
    node = entries.value // origins
    part = surface.part[triangle]
    group = _similar_normals(node * parts + part, surface.normal[triangle])
    # Numbered in the order of their nodes.
    count = int(group.max()) + 1
    group_node = np.zeros(count, np.int64)
    group_node[group] = node
    order = np.argsort(group_node, kind="stable")
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    fragment = rank[group][entry]
    area = np.repeat(surface.area / 3, 3)
    total = np.bincount(fragment, area, count)
    # A face that welding has collapsed may have no third with an area.
    weight = np.where(total[fragment] > 0, area, 1.0)
    weights = np.bincount(fragment, weight, count)
    moment = summed_rows(fragment, surface.thirds.reshape(-1, 3), count, weight)
    normal = summed_rows(fragment, np.repeat(surface.normal, 3, axis=0), count, weight)
    group_part = np.zeros(count, np.int64)
    group_part[rank[group]] = part
    return SheetFragments(
        node=group_node[order],
        position=moment / weights[:, None],
        normal=unit_vectors(normal),
        area=total,
        part=group_part,
        of_corner=fragment.reshape(-1, 3),
        pieces=FragmentPieces(
            fragment=rank[group],
            normal=surface.normal[triangle],
            share=np.bincount(entry, weight / weights[fragment], len(triangle)),
        ),
    )


def _similar_normals(
    key: Int[np.ndarray, " k"], normal: Float[np.ndarray, "k 3"]
) -> Int[np.ndarray, " k"]:
    """Group entries of one key whose normals are within an angle of the first one's."""
    group = np.full(len(key), -1)
    groups = 0
    waiting = np.arange(len(key))
    while len(waiting):
        leaders = numbered(key[waiting])
        first = leaders.first
        number = leaders.number
        leader = waiting[first][number]
        similar = (
            row_dot(normal.take(waiting, 0), normal.take(leader, 0)) >= _MAX_SPREAD
        )
        # The leader itself, whatever rounding does to its length.
        similar |= leader == waiting
        group[waiting[similar]] = groups + number[similar]
        groups += len(first)
        waiting = waiting[~similar]
    return group
