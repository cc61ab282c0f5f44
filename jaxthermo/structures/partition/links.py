"""Links between groups of voxels: areas, distances and normals of shared faces.

The voxel faces that two groups share are replaced by one flat face. With A_i their area
across axis i, it has the area A = |(A_x, A_y, A_z)|, which does not grow with the steps
of a staircase, at the distance sum_i A_i d_i / A along its normal from each centre.

Non-orthogonal correction: of the vector d from node i to node j the part n . d crosses
the face with normal n; the rest s lies along it. With the gradient g the difference
across the face is T_j - T_i - g . s over the distance n . d, exact for any linear
temperature. The two-point flux uses T_j - T_i over a length between n . d and |d|
(`link_distance`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...geometry.vectors import unit_vectors
from ...voxels.cut_voxels import CutVoxels
from ..joined import JoinedStructure
from ..structure import AbstractStructure, Links


# Smallest distance from a centre to a face [voxels]: the centre of a concave group may
# lie beyond its face.
_MIN_DISTANCE = 0.25

_CHUNK_FACES = 1_000_000
"""Number of faces per chunk, which bounds the size of temporaries."""


def link_distance(
    normal: Float[np.ndarray, " e"], straight: Float[np.ndarray, " e"]
) -> Float[np.ndarray, " e"]:
    """Length of the heat path between two centres: (n . d + max(|d|, n . d)) / 2.

    From the distances along the normal of the shared face, n . d, and straight, |d|,
    which may be 0 for concave groups.
    """
    # The normal distance is exact for heat flow along the normal, but conducts too well
    # along the face where centres are displaced along it (coarse next to fine); |d|
    # errs the other way. The mean had the smallest maximal error on a statue heated
    # from three sides, in octrees, over cores and between random cells.
    return (normal + np.maximum(straight, normal)) / 2


def block_links(
    labels: Int[np.ndarray, "x y z"],
    centre: Float[np.ndarray, "n 3"],
    pitch: float,
    cut: CutVoxels | None = None,
) -> Links:
    """Link each pair of groups that share voxel faces; -1 in the labels is no group.

    Centres are in voxels from the corner of the lattice, the pitch in metres. Faces of
    cut voxels count with their open areas.
    """
    side, plane, share = _shared_faces(labels, count=len(centre), cut=cut)
    # Chunks end between pairs: the faces of a pair are summed in one of them.
    begin = np.searchsorted(side, side[::_CHUNK_FACES] // 6 * 6)
    begin = np.union1d(0, begin)
    end = np.append(begin[1:], len(side))
    chunks = [
        _links(
            side[i:j],
            plane=plane[i:j],
            share=None if share is None else share[i:j],
            centre=centre,
        )
        for i, j in zip(begin, end, strict=True)
    ]
    links = joined_links(chunks)
    links = links._replace(area=links.area * pitch**2).lengthened(pitch)
    if cut is None:
        return links
    return _with_links_over_edges(
        links, cut=cut, labels=labels, centre=centre * pitch, pitch=pitch
    )


def _with_links_over_edges(
    links: Links,
    cut: CutVoxels,
    labels: Int[np.ndarray, "x y z"],
    centre: Float[np.ndarray, "n 3"],
    pitch: float,
) -> Links:
    """Add conduction between voxels that share only an edge; lengths in m."""
    over = cut.links.selected(np.flatnonzero(cut.links.over_edge))
    ends = [labels[tuple(cell.T)] for cell in (over.voxel, over.voxel + over.step)]
    first = np.minimum(*ends)
    second = np.maximum(*ends)
    apart = np.flatnonzero((first >= 0) & (first < second))
    key = first[apart].astype(np.int64) * len(centre) + second[apart]
    key, pair_of_link = np.unique(key, return_inverse=True)
    # Like a face, over the distance of the two voxels.
    area = np.bincount(pair_of_link.reshape(-1), over.extra[apart], len(key))
    area = np.sqrt(2) * pitch**2 * area
    src, dst = np.divmod(key, len(centre))
    half = np.linalg.norm(centre[dst] - centre[src], axis=1) / 2
    present = links.src.astype(np.int64) * len(centre) + links.dst
    link = np.searchsorted(present, key)
    is_present = np.append(present, -1)[link] == key
    links.area[link[is_present]] += area[is_present]
    added = Links(
        src=src.astype(np.int32),
        dst=dst.astype(np.int32),
        area=area,
        distance_src=half,
        distance_dst=half,
    ).selected(~is_present)
    order = np.argsort(np.concatenate([present, key[~is_present]]), kind="stable")
    return joined_links([links, added]).selected(order)


def joined_links(links: list[Links]) -> Links:
    """All links of a list, one after the other."""
    return Links(*(np.concatenate(column) for column in zip(*links, strict=True)))


class _SharedFaces(NamedTuple):
    """Voxel faces between different groups, sorted by `side`."""

    side: Int[np.ndarray, " k"]
    """Key 6 (src n + dst) + 2 axis + (1 if dst is the upper one)."""
    plane: Int[np.ndarray, " k"]
    """Plane of the face across its axis."""
    share: Float[np.ndarray, " k"] | None
    """Open area [voxel faces]; None without cut voxels, where every face is open."""


def _shared_faces(
    labels: Int[np.ndarray, "x y z"], count: int, cut: CutVoxels | None
) -> _SharedFaces:
    # One more voxel at the upper ends, so that the next along an axis always exists.
    padded = np.pad(labels, (0, 1), constant_values=-1)
    flat = padded.reshape(-1)
    shape = padded.shape
    sides = []
    planes = []
    shares = []
    for axis in range(3):
        jump = int(np.prod(shape[axis + 1 :]))
        below = flat[:-jump]
        above = flat[jump:]
        shared = below != above
        shared &= below >= 0
        shared &= above >= 0
        face = np.flatnonzero(shared)
        below = below[face]
        above = above[face]
        planes.append((face // jump % shape[axis] + 1).astype(np.int32))
        if cut is not None:
            shares.append(cut.links.open_across(face, shape, axis))
        # In place: these arrays are among the largest of the build.
        side = np.minimum(below, above).astype(np.int64)
        side *= count
        side += np.maximum(below, above)
        side *= 6
        side += 2 * axis + (below < above)
        sides.append(side)
        del face, below, above, shared
    side = np.concatenate(sides)
    del sides, padded, flat
    # Nearly sorted where groups are small: a stable sort merges the runs.
    order = np.argsort(side, kind="stable")
    share = None if cut is None else np.concatenate(shares)[order]
    return _SharedFaces(
        side=side[order], plane=np.concatenate(planes)[order], share=share
    )


def _links(
    side: Int[np.ndarray, " k"],
    plane: Int[np.ndarray, " k"],
    share: Float[np.ndarray, " k"] | None,
    centre: Float[np.ndarray, "n 3"],
) -> Links:
    start = _starts(side)
    if share is None:
        faces = np.diff(start, append=len(side))
        mean_plane = np.add.reduceat(plane, start, dtype=float) / faces
    else:
        faces = np.add.reduceat(share, start)
        mean_plane = np.add.reduceat(plane * share, start) / faces
    side = side[start]
    pair, face = np.divmod(side, 6)
    src, dst = np.divmod(pair, len(centre))
    axis = face // 2
    sign = face % 2 * 2 - 1
    to_src = np.maximum(sign * (mean_plane - centre[src, axis]), _MIN_DISTANCE)
    to_dst = np.maximum(sign * (centre[dst, axis] - mean_plane), _MIN_DISTANCE)

    on_axis = _starts(side // 2)
    squares = np.add.reduceat(faces, on_axis) ** 2.0
    area = np.sqrt(np.add.reduceat(squares, _starts(pair[on_axis])))
    start = _starts(pair)
    src = src[start]
    dst = dst[start]
    to_src = np.add.reduceat(faces * to_src, start) / area
    to_dst = np.add.reduceat(faces * to_dst, start) / area
    normal = to_src + to_dst
    straight = np.linalg.norm(centre[dst] - centre[src], axis=1)
    links = Links(
        src=src.astype(np.int32),
        dst=dst.astype(np.int32),
        area=area,
        distance_src=to_src,
        distance_dst=to_dst,
    )
    return links.lengthened(link_distance(normal, straight) / normal)


def _starts(ordered: Int[np.ndarray, " k"]) -> Int[np.ndarray, " u"]:
    return np.flatnonzero(np.diff(ordered, prepend=-1))


def voxel_links(
    labels: Int[np.ndarray, "x y z"], pitch: float, cut: CutVoxels | None = None
) -> Links:
    """Link single voxels over shared faces, without the sort of `block_links`.

    A label is the rank of a voxel in lattice order, -1 for no node; the pitch is in m.
    Links of cut voxels have their open areas, and some are over edges.
    """
    # One more voxel at the upper ends, so that the next along an axis always exists.
    padded = np.pad(labels, (0, 1), constant_values=-1)
    _, y, z = padded.shape
    flat = padded.reshape(-1)
    voxel = np.flatnonzero(flat >= 0)
    # Along z, y and x, so that neighbours come in rising order and links are sorted.
    next_node = np.stack([flat[voxel + jump] for jump in (1, z, y * z)], axis=1)
    linked = next_node >= 0
    node = np.arange(len(voxel), dtype=np.int32)
    dst = next_node[linked]
    half = np.full(len(dst), pitch / 2)
    src = np.repeat(node, np.count_nonzero(linked, axis=1))
    area = np.full(len(dst), pitch**2)
    links = Links(src=src, dst=dst, area=area, distance_src=half, distance_dst=half)
    if cut is None:
        return links
    for axis, column in enumerate((2, 1, 0)):
        row = np.flatnonzero(linked[:, column])
        opened = cut.links.open_across(voxel[row], padded.shape, axis)
        # Links of a node come in the order of these columns.
        link_of_row = np.cumsum(linked.reshape(-1)).reshape(linked.shape)[:, column] - 1
        links.area[link_of_row[row]] *= opened
    centre = np.argwhere(labels >= 0) * pitch
    return _with_links_over_edges(
        links, cut=cut, labels=labels, centre=centre, pitch=pitch
    )


_MIN_NORMAL_FRACTION = 0.5
"""Smallest n . d / |d|: at slanted cuts it would vanish, and the time step with it."""

# Smallest |s| / |d| that is corrected.
_MIN_OFFSET = 1e-9


class NonOrthogonalLinks(NamedTuple):
    """Links whose nodes are displaced along their face."""

    link: Int[np.ndarray, " k"]
    """Indices of the links."""
    offset: Float[np.ndarray, "k 3"]
    """Displacement s along the face, from `src` to `dst` [m]."""
    length_ratio: Float[np.ndarray, " e"]
    """Length of the two-point flux over n . d, for every link [-]."""


def non_orthogonal_links(structure: AbstractStructure) -> NonOrthogonalLinks:
    """Find the links of a structure that need the non-orthogonal correction."""
    links = structure.links()
    location = structure.nodes().location
    normal = _face_normals(structure)
    step = location[links.dst] - location[links.src]
    straight = np.linalg.norm(step, axis=1)
    across = np.einsum("ei,ei->e", step, normal)
    across = np.maximum(across, _MIN_NORMAL_FRACTION * straight)
    # s includes what n . d lacks to the minimum, so that d = (n . d) n + s still holds.
    offset = step - across[:, None] * normal
    displaced = np.linalg.norm(offset, axis=1) > _MIN_OFFSET * straight
    link = np.flatnonzero(displaced & normal.any(axis=1))
    ratio = np.ones(len(step))
    ratio[link] = (link_distance(across, straight) / across)[link]
    return NonOrthogonalLinks(link=link, offset=offset[link], length_ratio=ratio)


def link_axes(structure: AbstractStructure) -> Float[np.ndarray, "e 3"]:
    """Squared direction cosines of each link, sum 1.

    The direction is the normal of the shared voxel faces, or the line from centre to
    centre of nodes that share none, such as voxels over an edge.
    """
    if isinstance(structure, JoinedStructure):
        axes = [link_axes(part) for part in structure.parts]
        return np.concatenate(axes)[structure.link_order]
    upward, downward = _face_counts(structure)
    across = upward + downward
    links = structure.links()
    centre = structure.nodes().centre
    step = centre[links.dst] - centre[links.src]
    across = np.where(across.any(axis=1, keepdims=True), across, step)
    squared = np.square(across)
    return squared / squared.sum(axis=1, keepdims=True)


def _face_normals(structure: AbstractStructure) -> Float[np.ndarray, "e 3"]:
    """Unit normal of the shared voxel faces of each link, from `src` to `dst`.

    Zero without a shared face, or where the faces cancel.
    """
    upward, downward = _face_counts(structure)
    return unit_vectors(upward - downward)


def _face_counts(structure):
    """Shared voxel faces of every link along x, y, z, with `dst` above and below."""
    links = structure.links()
    count = structure.node_count

    def pair_key(first, second):
        low = np.minimum(first, second).astype(np.int64)
        return low * count + np.maximum(first, second)

    key = pair_key(links.src, links.dst)
    order = np.argsort(key, kind="stable")
    # One more entry, so that a key beyond the last finds one.
    ranked = np.append(key[order], -1)
    upward, downward = np.zeros((2, len(key), 3))
    for axis, (below, above) in enumerate(_faces_between_nodes(structure)):
        face = pair_key(below, above)
        index = np.searchsorted(ranked[:-1], face)
        is_linked = ranked[index] == face
        link = order[index[is_linked]]
        rises = links.src[link] == below[is_linked]
        upward[:, axis] = np.bincount(link[rises], minlength=len(key))
        downward[:, axis] = np.bincount(link[~rises], minlength=len(key))
    return upward, downward


def _faces_between_nodes(structure):
    """Nodes below and above every voxel face between two nodes, for each axis."""
    solid = structure.grid.solid
    node = np.full(solid.shape, -1, np.int32)
    node[solid] = structure.voxel_node()
    for axis in range(3):
        line = np.moveaxis(node, axis, 0)
        below = line[:-1]
        above = line[1:]
        shared = (below != above) & (below >= 0) & (above >= 0)
        yield below[shared], above[shared]
